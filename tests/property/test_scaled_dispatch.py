"""Dispatchers act alike on a case in kW, in GW, and in another currency.

What is scaled is as in `test_scale`. Decisions may be tied, so costs are compared.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import resilience as rs
from resilience.arrays import Floats
from resilience.dispatch.registry import DISPATCHERS
from resilience.dispatch.sddp.book import Book
from resilience.dispatch.sddp.training import Settings
from resilience.evaluation.clairvoyant import clairvoyant
from resilience.fragility.draw import sample_bell
from resilience.fragility.outages.bell import Bell
from resilience.models.microgrid import Microgrid
from resilience.simulation.simulate import simulate
from resilience.simulation.world import World
from tests.property.test_scale import scaled

SCALES = [(1e-3, 1.0), (18.0, 1.0), (1.0, 1e-6), (1e-3, 3e4)]
BELL = Bell(duration_slots=(9, 21), centres=(56,), overnight=False)
METHODS = ("rule", "mpc-blind", "mpc", "stochastic", "stochastic-cvar")


def document() -> dict[str, Any]:
    """A store on a feeder of three buses with two breakpoints, a day; no sun is too much."""
    hours = np.arange(24)
    return {
        "slots": 24,
        "buses": 3,
        "lines": [(1, 2, 0.011, 0.013), (2, 3, 0.017, 0.019)],
        "line_tables": [{"name": "1-2", "breakpoint": True}, {"name": "2-3", "breakpoint": True}],
        "profiles": {
            "sun": (np.maximum(0.0, np.sin((hours - 6) * np.pi / 12)) * 0.93).round(3).tolist(),
            "demand": (0.6 + 0.3 * np.sin((hours - 13) * np.pi / 9)).round(3).tolist(),
            # No two hours alike: when to charge is no tie.
            "price": (0.9 + 0.013 * ((hours * 7) % 24)).round(3).tolist(),
        },
        "load": [
            {"bus": "2", "p_max_mw": 0.71, "profile": "demand", "shed_cost_per_mwh": 11.3},
            {"bus": "3", "p_max_mw": 0.43, "profile": "demand", "shed_cost_per_mwh": 17.9},
        ],
        "pv": [{"bus": "3", "p_max_mw": 0.23, "profile": "sun"}],
        "ess": [
            {"bus": "2", "p_max_mw": 0.61, "e_mwh": 2.1, "soc_initial": 0.23,
             "efficiency_charge": 0.94, "efficiency_discharge": 0.91,
             "degradation_cost_per_mwh": 0.11},
        ],
        "grid": [{"import_max_mw": 2.3, "import_cost_per_mwh": 1.7, "price_profile": "price"}],
        "terminal_value_per_mwh": 0.35,
    }  # fmt: skip


def world(power: float, price: float) -> World:
    """The scaled case in six storms."""
    case = scaled(document(), power, price)
    return World.build(Microgrid.build(case, "copperplate"), sample_bell(case, BELL, 6, 3))


def cost_of(storms: World, method: str) -> Floats:
    """(storms,) $, of one scenario after the other; of a dear method three of the six."""
    n = 3 if method.startswith("stochastic") else storms.scenarios.n
    alone = [storms.with_scenarios(np.array([k])) for k in range(n)]
    return np.array([simulate(one, DISPATCHERS[method](one.setting)).cost.sum() for one in alone])


@pytest.mark.parametrize("method", METHODS)
def test_a_dispatcher_acts_alike_in_every_unit(method: str) -> None:
    right = cost_of(world(1.0, 1.0), method)
    assert np.ptp(right) > 0.05 * right.mean(), "storms that differ"
    # On an island, one that looks at nothing else sheds in whichever hour of its window.
    untied = right < 1.1 * right.min() if method == "mpc-blind" else right > 0.0
    for power, price in SCALES:
        found = cost_of(world(power, price), method) / (power * price)
        np.testing.assert_allclose(
            found[untied], right[untied], rtol=2e-5, err_msg=f"{power:g}, {price:g}"
        )


def test_the_bound_is_the_same_in_every_unit() -> None:
    right = clairvoyant(world(1.0, 1.0)).objective
    for power, price in SCALES:
        found = clairvoyant(world(power, price)).objective / (power * price)
        np.testing.assert_allclose(found, right, rtol=2e-6, err_msg=f"{power:g}, {price:g}")


@pytest.mark.parametrize("algorithm", ["extensive", "lshaped"])
@pytest.mark.parametrize("risk", ["mean", "cvar:0.8:0.4"])
def test_a_plan_over_scenarios_is_the_same_in_every_unit(algorithm: str, risk: str) -> None:
    unit = {"bus": "3", "p_max_mw": 0.31, "p_min_mw": 0.11, "min_up_h": 3, "cost_per_mwh": 4.3}
    unit |= {"start_cost": 0.9, "no_load_cost_per_h": 0.37}

    def answer(power: float, price: float) -> Floats:
        case = scaled(document() | {"generator": [unit]}, power, price)
        storms = sample_bell(case, BELL, 4, 3)
        plan = rs.solve(
            case, "stochastic", scenarios=storms, algorithm=algorithm, risk=risk, relative_gap=1e-6
        )
        assert plan.status == "optimal"
        return np.array([plan.objective, plan.bound])

    right = answer(1.0, 1.0)
    for power, price in SCALES:
        found = answer(power, price) / (power * price)
        np.testing.assert_allclose(found, right, rtol=4e-6, err_msg=f"{power:g}, {price:g}")


def test_cuts_are_trained_as_far_in_every_unit() -> None:
    """Ties are broken otherwise in other units, so paths differ, not where they lead to."""
    settings = Settings(iterations=90, patience=12, tolerance=1e-3)

    def bounds(power: float, price: float) -> Floats:
        case = scaled(document(), power, price)
        book = Book(case, BELL, outcomes=1, settings=settings, cache=False)
        return book.cut_set(56, np.array([0.35 * price] * book.fleet.n)).trained.bounds

    right = bounds(1.0, 1.0)
    assert settings.patience < len(right) < settings.iterations
    for power, price in SCALES:
        found = bounds(power, price) / (power * price)
        assert settings.patience < len(found) < settings.iterations, (power, price)
        np.testing.assert_allclose(found[-1], right[-1], rtol=2e-3, err_msg=f"{power:g}, {price:g}")
