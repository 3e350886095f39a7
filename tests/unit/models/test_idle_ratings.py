"""Ratings that nothing can reach: which they are, and that plans without them cost the same."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import resilience as rs
from resilience.case import Case
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.idle_ratings import without_idle_ratings
from resilience.models.microgrid import Microgrid
from resilience.planning.scenarios import program as scenario_program
from resilience.planning.scenarios.plan import ScenarioPlan
from resilience.simulation.world import microgrid_with_fallible_lines
from resilience.testing import small_case

MARGIN = 1.1
"""Of a limit over what is proven."""


def feeder(ratings: list[float], **more: Any) -> Case:
    """1-2-3-4, a grid of 3 MW at 1, loads of 0.5 and 0.6 at 3 and 4, storage of 0.3 MW at 4."""
    tables: dict[str, Any] = {
        "load": [
            {"bus": "3", "p_max_mw": 0.5, "profile": "demand", "shed_cost_per_mwh": 100.0},
            {"bus": "4", "p_max_mw": 0.6, "profile": "demand", "shed_cost_per_mwh": 90.0},
        ],
        "grid": [{"import_max_mw": 3.0, "import_cost_per_mwh": 10.0}],
        "profiles": {"demand": [0.5, 1.0, 0.8, 0.6]},
        "ess": [{"bus": "4", "p_max_mw": 0.3, "p_min_mw": -0.3, "e_mwh": 0.6, "soc_initial": 0.5}],
    }
    return small_case(
        slots=4,
        buses=4,
        lines=[(1, 2, 0.0, 0.0), (2, 3, 0.0, 0.0), (3, 4, 0.0, 0.0)],
        line_tables=[
            {"name": f"{k + 1}-{k + 2}", "rating_mva": rating} for k, rating in enumerate(ratings)
        ],
        **(tables | more),
    )


def rated(case: Case) -> list[str]:
    """Names of the lines that remain lines."""
    return list(without_idle_ratings(Microgrid.build(case, "copperplate")).network.line_names)


def test_a_rating_is_idle_from_what_either_side_can_do_on() -> None:
    """Behind 1-2 and 2-3 stand 1.1 MW of load and 0.3 of storage, behind 3-4 0.6 and 0.3."""
    behind = [MARGIN * 1.4, MARGIN * 1.4, MARGIN * 0.9]
    assert rated(feeder([mva + 1e-6 for mva in behind])) == []
    for k, mva in enumerate(behind):
        less = [m + 1e-6 for m in behind]
        less[k] = mva - 1e-6
        assert rated(feeder(less)) == [f"{k + 1}-{k + 2}"]


def test_a_line_that_may_fail_stays_a_line() -> None:
    case = feeder([9.0, 9.0, 9.0], outages=["2-3@01:00-02:00"])
    microgrid = without_idle_ratings(Microgrid.build(case, "copperplate"))
    assert microgrid.network.line_names == ("2-3",)
    assert microgrid.bus_of.tolist() == [0, 0, 1, 1]
    assert microgrid.fallible.tolist() == [True]
    assert microgrid.lines_of.tolist() == [case.network.line("2-3")]


def test_what_the_horizon_never_asks_for_does_not_count() -> None:
    """Half of the load at most: 0.55 and 0.3 of storage behind the first lines."""
    half = {"demand": [0.5, 0.4, 0.3, 0.5]}
    case = feeder([MARGIN * 0.85 + 1e-6, MARGIN * 0.85 - 1e-6, MARGIN * 0.9], profiles=half)
    assert rated(case) == ["2-3"]


@pytest.mark.parametrize("seed", range(12))
def test_plans_over_scenarios_cost_the_same(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Some ratings bind, some cannot, of random feeders in which storms take one line."""
    rng = np.random.default_rng(seed)
    hit, idle = rng.choice(3, 2, replace=False)
    ratings = rng.choice([0.4, 0.8, 2.0, 5.0], 3)
    ratings[idle] = 5.0
    case = feeder(
        ratings.tolist(),
        generator=[{"bus": "2", "p_max_mw": float(rng.uniform(0.1, 0.8)), "cost_per_mwh": 40.0}],
    )
    down = rng.random((1, 4, 5)) < 0.5
    down[:, 0] = False
    scenarios = Scenarios((f"{hit + 1}-{hit + 2}",), down, np.full(5, 0.2))
    microgrid = microgrid_with_fallible_lines(case, scenarios, "copperplate")
    fewer = without_idle_ratings(microgrid).network.line_names
    assert scenarios.lines[0] in fewer
    assert f"{idle + 1}-{idle + 2}" not in fewer

    def cost() -> float:
        plan = rs.solve(case, "stochastic", scenarios=scenarios)
        assert isinstance(plan, ScenarioPlan)
        assert max(plan.audit.values()) < 1e-9
        return plan.objective

    reduced = cost()
    monkeypatch.setattr(scenario_program, "without_idle_ratings", lambda microgrid: microgrid)
    assert reduced == pytest.approx(cost(), rel=1e-7)
