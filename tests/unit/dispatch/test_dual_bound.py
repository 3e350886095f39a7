"""A clairvoyant who pays for what it foresees: a bound for everybody who does not."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import resilience as rs
from resilience.dispatch.comb import comb_optimum
from resilience.dispatch.registry import factory_of
from resilience.errors import CertificateError, UsageError
from resilience.evaluation.bounds.dual_bound import beyond_dual_bound, prove_dual_bound
from resilience.evaluation.bounds.penalties import PenalisedProgram
from resilience.evaluation.clairvoyant import Replay, clairvoyant
from resilience.fragility.draw import sample_case
from resilience.simulation.simulate import simulate
from resilience.simulation.trajectory import Trajectory
from resilience.simulation.world import World, microgrid_with_fallible_lines
from tests.unit.dispatch.blackouts import world

BLIND = ("idle", "rule-0.9", "greedy", "mpc-blind", "mpc", "stochastic", "comb")
BELL = {"probability": 0.7, "centres": (40, 64), "duration_slots": (8, 20), "sigma_slots": 6.0}


def done(judged: World, name: str) -> Trajectory:
    return simulate(judged, factory_of(name)(judged.setting))


def stormy(n: int, days: int = 2, seed: int = 0, **changes: Any) -> World:
    """Days of ieee33-tou with a bell of its own."""
    case = rs.load_case("ieee33-tou").replace(slots=96 * days, outages=(), outage=BELL | changes)
    storms = sample_case(case, n, seed)
    return World.build(microgrid_with_fallible_lines(case, storms, "copperplate"), storms)


def test_it_closes_half_of_the_way_to_the_comb_and_never_passes_it() -> None:
    """Over all ends with their probabilities, so that nothing is an estimate."""
    judged = world()
    foresight = float(judged.scenarios.probability @ clairvoyant(judged).objective)
    optimum = comb_optimum(judged.setting)
    drawn = replace(judged, scenarios=replace(judged.scenarios, seed=0))
    bound = float(drawn.scenarios.probability @ prove_dual_bound(drawn, {}).optimum)
    assert foresight + 0.5 * (optimum - foresight) < bound < optimum + 1e-6 * abs(optimum)


@pytest.mark.parametrize("scale", [0.0, 1.0, 30.0])
def test_no_policy_pays_on_average_whatever_the_slopes(scale: float) -> None:
    """Exactly, over all ends: what a penalty takes from one end it gives to another."""
    judged = world()
    program = PenalisedProgram(judged)
    slopes = scale * np.random.default_rng(1).normal(size=program.shape)
    for name in BLIND:
        paid = program.paid(slopes, done(judged, name))
        assert abs(judged.scenarios.probability @ paid) < 1e-9 * (1.0 + scale), name
    known = clairvoyant(judged)
    foreseen = simulate(judged, Replay("clairvoyant", known.decision))
    paid = program.paid(slopes, foreseen)
    assert scale == 0.0 or abs(judged.scenarios.probability @ paid) > 1e-3


@pytest.mark.parametrize("scale", [0.0, 5.0])
def test_cost_and_penalties_never_lie_below_the_penalised_optimum(scale: float) -> None:
    judged = world()
    program = PenalisedProgram(judged)
    slopes = scale * np.random.default_rng(2).random(program.shape)
    optimum = program.optimum(slopes)
    if scale == 0.0:
        assert optimum == pytest.approx(clairvoyant(judged).objective, rel=1e-9)
    for name in BLIND:
        trajectory = done(judged, name)
        total = trajectory.objective(judged.end_value_per_mwh) + program.paid(slopes, trajectory)
        assert (total > optimum - 1e-6 * np.abs(optimum)).all(), name


def test_the_subgradient_is_one() -> None:
    """The mean is concave in the slopes: no point lies above the plane of another."""
    program, rng = PenalisedProgram(world()), np.random.default_rng(3)
    a, b = (3.0 * rng.random(program.shape) for _ in range(2))
    plane = program.value(a) + (program.gradient(a) * (b - a)).sum()
    assert program.value(b) <= plane + 1e-6


BELLS: list[dict[str, Any]] = [
    {},
    {"refail": True, "shared_shift": True},
    {"overnight": False},
    {"duration_law": "lognormal", "duration_slots": (8, 80)},
    {"common_draw": True, "centre_error_slots": 6},
]


@pytest.mark.parametrize(
    ("changes", "known"),
    [(changes, False) for changes in BELLS]
    + [(changes, True) for changes in BELLS[:-1]]
    + [pytest.param(BELLS[-1], True, marks=pytest.mark.exhaustive)],
)
def test_surprises_of_a_bell_have_no_mean(changes: dict[str, Any], known: bool) -> None:
    """Not overall, nor weighted by anything that was known: which lines were down, and the hour."""
    judged = replace(stormy(24, seed=5, **changes), known_centre=known)
    surprise = PenalisedProgram(judged).surprise
    lines = [judged.microgrid.case.network.line(name) for name in judged.scenarios.lines]
    down, slots = ~judged.line_up[lines], judged.microgrid.case.slots
    any_down = np.asarray(down.any(axis=0))
    weights = [
        np.ones_like(surprise),
        down * 1.0,
        np.expand_dims(any_down, 0) * 1.0,
        np.expand_dims(~any_down & (np.arange(slots) % 96 > 48)[:, None], 0) * 1.0,
        np.broadcast_to((judged.day * 1.0)[None, :, None], surprise.shape),
    ]
    for weight in weights:
        totals = (weight * surprise).sum(axis=(0, 1))
        assert abs(totals.mean()) < 4.5 * totals.std(ddof=1) / np.sqrt(len(totals)) + 1e-12


def test_a_bell_has_a_bound_that_nobody_blind_undercuts() -> None:
    judged = stormy(4, days=1)
    trajectories = {name: done(judged, name) for name in ("rule-0.9", "mpc")}
    dual = prove_dual_bound(judged, trajectories)
    objective = {n: t.objective(judged.end_value_per_mwh) for n, t in trajectories.items()}
    dual.check(objective, 1.0)
    foresight = float(judged.scenarios.probability @ clairvoyant(judged).objective)
    assert dual.mean(objective) <= min(float(v.mean()) for v in objective.values())
    assert dual.mean(objective) > foresight - 0.05 * abs(foresight)
    cheaper = {name: values - 100.0 for name, values in objective.items()}
    with pytest.raises(CertificateError, match="less than the penalised optimum"):
        dual.check(cheaper, 1.0)


def test_where_there_is_none_it_is_said() -> None:
    judged = world()
    assert "not drawn from the case" in beyond_dual_bound(judged)
    assert "reset every midnight" in beyond_dual_bound(replace(stormy(1), reset_daily=True))
    with pytest.raises(UsageError, match="storm on its track"):
        rs.compare("ieee33_rammasun", ["rule"], draws=2, dual_bound=True)


def test_a_comparison_prints_it() -> None:
    case = world().microgrid.case
    report = rs.compare(case, ["rule", "stochastic"], draws=6, dual_bound=True)
    frame = report.frame()["over_dual_percent"]
    assert frame["stochastic"] >= -1e-9
    assert frame["rule"] > frame["comb"] >= -1e-9
    assert np.isnan(frame["clairvoyant"])
    per_day = report.summary()["dual_bound_per_day"]
    assert per_day > report.summary()["bound_per_day"]
