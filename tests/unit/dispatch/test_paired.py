"""Pairs of methods day by day: days add up, and are varied where they are storms of their own."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime

import numpy as np
import pytest

import resilience as rs
from resilience.arrays import Floats
from resilience.evaluation.comparison import BOUND, Comparison
from resilience.evaluation.measures.intervals import mean_interval
from resilience.evaluation.paired import (
    bound_by_day,
    cost_by_day,
    difference,
    over_bound,
    varies_days,
)
from resilience.evaluation.verdict import few_events, verdict
from resilience.models.microgrid import Microgrid
from resilience.simulation.trajectory import Trajectory
from resilience.simulation.world import World
from resilience.testing import small_case
from tests.unit.plots.stormy import chain

VALUE = 0.5  # $/MWh


def comparison(
    costs: dict[str, Floats], *, probability: Floats | None = None, start: int = 0
) -> Comparison:
    """Four days; costs in $ are (episodes, 96), in hours from `start`; random stored energy."""
    n = len(next(iter(costs.values())))
    case = chain(slots=96).replace(start=datetime(2021, 3, 4, start))
    days = 4 + (start > 0)
    rng, likely = np.random.default_rng(5), np.full(n, 1.0 / n)
    runs = {
        name: Trajectory(
            name=name,
            cost=cost.T,
            energy=np.concatenate([np.full((1, 1, n), 2.0), rng.uniform(0, 4, (1, 96, n))], axis=1),
            storage=np.zeros((1, 96, n)),
            flows=np.zeros((1, 96, n)),
            columns=("load.shed[load1]",),
            step_h=1.0,
            seconds=0.0,
        )
        for name, cost in costs.items()
    }
    scenarios = rs.Scenarios(
        ("1-2",),
        np.zeros((1, 96, n), bool),
        likely if probability is None else probability,
        np.full((days, n), 20),
    )
    objective = {name: run.objective(VALUE) for name, run in runs.items()}
    bound = np.min(list(objective.values()), axis=0) - 1.0
    return Comparison(case, scenarios, runs, objective, bound, VALUE)


@pytest.fixture
def pair() -> Comparison:
    rng = np.random.default_rng(3)
    names = ("mpc", "rule-0.9", BOUND)
    return comparison({name: rng.exponential(1.0, (6, 96)) for name in names})


def by_hand(compared: Comparison, name: str) -> Floats:
    """(episodes, days) with loops: hours of a date, energy at its midnights."""
    run = compared.trajectories[name]
    table = np.zeros((compared.scenarios.n, 4))
    for k in range(compared.scenarios.n):
        for day in range(4):
            hours = range(24 * day, 24 * day + 24)
            gained = run.energy[0, 24 * day + 24, k] - run.energy[0, 24 * day, k]
            table[k, day] = sum(run.cost[t, k] for t in hours) - VALUE * gained
    return table


def test_days_add_up_and_what_was_stored_at_first_is_shared(pair: Comparison) -> None:
    for name in pair.objective:
        found = cost_by_day(pair, name)
        np.testing.assert_allclose(found.sum(1), pair.objective[name])
        np.testing.assert_allclose(found, by_hand(pair, name) - VALUE * 2.0 / 4.0)
    np.testing.assert_allclose(bound_by_day(pair).sum(1), pair.bound)


def test_the_interval_is_that_of_the_table_of_days(pair: Comparison) -> None:
    expected = mean_interval(by_hand(pair, "mpc") - by_hand(pair, "rule-0.9"))
    found = difference(pair, "mpc", "rule-0.9")
    assert found.mean == pytest.approx(expected.mean)
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high))
    assert (found.n, found.days) == (6, 4)
    turned = difference(pair, "rule-0.9", "mpc")
    assert (turned.low, turned.high) == pytest.approx((-found.high, -found.low))
    mean = float((pair.objective["mpc"] - pair.bound).mean()) / 4.0
    assert over_bound(pair, "mpc").mean == pytest.approx(mean)


def test_one_storm_on_the_horizon_is_no_days(pair: Comparison) -> None:
    """Where a scenario is one storm, its second day is none that might have been its first."""
    storms = replace(pair.scenarios, centre=None)
    found = difference(replace(pair, scenarios=storms), "mpc", "rule-0.9")
    expected = mean_interval((pair.objective["mpc"] - pair.objective["rule-0.9"]) / 4.0)
    assert (found.low, found.high) == pytest.approx((expected.low, expected.high))
    assert found.days == 1


def test_days_cut_by_the_horizon_are_no_days(pair: Comparison) -> None:
    rng = np.random.default_rng(3)
    costs = {name: rng.exponential(1.0, (6, 96)) for name in ("mpc", "rule-0.9")}
    late = comparison(costs, start=18)
    assert cost_by_day(late, "mpc").shape == (6, 5)
    np.testing.assert_allclose(cost_by_day(late, "mpc").sum(1), late.objective["mpc"])
    assert difference(late, "mpc", "rule-0.9").days == 1
    # The bound's path is not among these: its days are alike.
    np.testing.assert_allclose(bound_by_day(late), np.outer(late.bound, [6, 24, 24, 24, 18]) / 96)


def test_few_days_are_these_alone() -> None:
    rng = np.random.default_rng(3)
    mpc = rng.exponential(1.0, (6, 96))
    found = comparison({"mpc": mpc, "rule-0.9": mpc + rng.exponential(1.0, (6, 96))})
    short = replace(found, case=found.case.replace(slots=72))
    runs = {
        name: replace(run, cost=run.cost[:72], energy=run.energy[:, :73])
        for name, run in found.trajectories.items()
    }
    objective = {name: run.objective(VALUE) for name, run in runs.items()}
    short = replace(short, trajectories=runs, objective=objective, bound=np.full(6, -9.0))
    assert not varies_days(short)
    assert varies_days(found)
    more = mean_interval((objective["mpc"] - objective["rule-0.9"]) / 3.0)
    found_interval = difference(short, "mpc", "rule-0.9")
    assert (found_interval.low, found_interval.high) == pytest.approx((more.low, more.high))
    assert "over 6 episodes of these 3 days alone is" in " ".join(verdict(short))


def test_weights_of_storms_are_kept() -> None:
    rng = np.random.default_rng(3)
    likely = np.array([0.5, 0.3, 0.2])
    costs = {name: rng.exponential(1.0, (3, 96)) for name in ("mpc", "rule-0.9")}
    weighed = comparison(costs, probability=likely)
    more = (weighed.objective["mpc"] - weighed.objective["rule-0.9"]) / 4.0
    found = difference(weighed, "mpc", "rule-0.9")
    assert found.mean == pytest.approx(float(likely @ more))
    assert found.low < found.mean < found.high


def test_one_episode_is_one_path_whatever_its_days() -> None:
    rng = np.random.default_rng(3)
    costs = {name: rng.exponential(1.0, (1, 96)) for name in ("mpc", "rule-0.9")}
    found = difference(comparison(costs), "mpc", "rule-0.9")
    assert np.isnan([found.low, found.high]).all()


def test_a_reset_adds_up_too(pair: Comparison) -> None:
    runs = {k: replace(v, left_mwh=np.arange(6.0)) for k, v in pair.trajectories.items()}
    objective = {k: v.objective(VALUE) for k, v in runs.items()}
    reset = replace(pair, trajectories=runs, objective=objective)
    np.testing.assert_allclose(cost_by_day(reset, "mpc").sum(1), objective["mpc"])


def test_few_events_are_said_where_the_number_stands() -> None:
    """Two of 32 day-episodes hold the whole difference: 30 $ and 20 $, shed on two evenings."""
    calm = np.ones((8, 96))
    dear = calm.copy()
    dear[1, 20], dear[4, 44] = 31.0, 21.0
    found = comparison({"mpc": calm, "rule-0.9": dear, BOUND: calm - 0.01})
    energy = found.trajectories["mpc"].energy
    runs = {name: replace(run, energy=energy) for name, run in found.trajectories.items()}
    objective = {name: run.objective(VALUE) for name, run in runs.items()}
    found = replace(found, trajectories=runs, objective=objective, bound=objective[BOUND])
    words = " ".join(verdict(found))
    assert "over 8 episodes and their 4 days is" in words
    assert "Few events: 2 of 32 day-episodes carry 80 % of it." in words
    assert few_events(found) == (
        "Few events make the difference to rule-0.9; other storms may turn it: mpc (2 of 32 "
        "day-episodes carry 80 %)."
    )


def test_few_events_are_a_warning_of_the_report() -> None:
    """In one of eight episodes the grid is lost: a full battery of 4 MWh serves what an idle one
    sheds. Stored energy is worth what it costs, so nothing else is dearer.
    """
    case = small_case(
        slots=24,
        buses=2,
        lines=[(1, 2, 0.01, 0.01)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        grid=[{"import_max_mw": 9.0, "import_cost_per_mwh": 1.0}],
        ess=[{"bus": "2", "p_max_mw": 2.0, "e_mwh": 4.0, "soc_initial": 0.0}],
        load=[{"bus": "2", "p_max_mw": 1.0, "shed_cost_per_mwh": 50.0}],
    )
    down = np.zeros((1, 24, 8), bool)
    down[0, 8:12, 3] = True
    storms = rs.Scenarios(("1-2",), down, np.full(8, 0.125), np.full((1, 8), 20))
    world = World.build(Microgrid.build(case, "copperplate"), storms, end_value_per_mwh=1.0)
    report = rs.evaluate(world, ["idle"])
    (warning,) = report.warnings
    assert "idle (1 of 8 episodes carries 80 %)" in warning
    assert report.summary()["warnings"] == [warning]
    frame = report.frame()
    assert frame.loc["idle", "over_rule_carriers"] == 1
    assert frame.loc["idle", "cvar95_day"] == pytest.approx(report.objective["idle"].max())
    assert report.differences()["few_events"].any()
