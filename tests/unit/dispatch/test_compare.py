"""A comparison on storms alike: every number against one worked out by hand, and what it states."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import resilience as rs
from resilience.arrays import Floats
from resilience.case.critical import critical_loads
from resilience.case.days import held_out
from resilience.dispatch.registry import DISPATCHERS
from resilience.evaluation.clairvoyant import Replay, clairvoyant
from resilience.evaluation.columns import AC_COLUMNS, COLUMNS
from resilience.evaluation.compare import compare, parse_error
from resilience.fragility.draw import sample_bell
from resilience.fragility.outages.bell import Bell
from resilience.models.backends.base import Solution
from resilience.models.backends.highs import Highs
from resilience.models.microgrid import Microgrid
from resilience.simulation.forecast import ForecastError, sample_outlook
from resilience.simulation.observation import Observation
from resilience.simulation.setting import Setting
from resilience.simulation.simulate import simulate
from resilience.simulation.world import World
from resilience.testing import small_case

LIKELY = np.array([0.75, 0.25])


def tiny(**more: Any) -> World:
    """Four half hours; in the second scenario, of probability 1/4, the last two are islanded.

    0.6 MW to shed at 5 $/MWh and 0.4 MW critical at 10; 1 $/MWh from the grid; 0.5 MWh of storage,
    empty. Idle pays 2 $ in calm, and 1 + 1 h * (0.6 * 5 + 0.4 * 10) = 8 $ in the storm. The
    clairvoyant fills the storage for 0.5 $ in the storm only, serves the critical load and 0.1 MWh
    of the other: 1 + 0.5 + 0.5 * 5 = 4 $. Rule 0.9 buys 0.45 MWh in both, and gives it in the first
    slot of the island: sheds 0.05 + 0.3 MWh of the one load and 0.2 MWh of the critical one.
    """
    case = small_case(
        slots=4,
        step_min=30.0,
        buses=2,
        lines=[(1, 2, 0.01, 0.01)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        load=[
            {"bus": "2", "p_max_mw": 0.6, "shed_cost_per_mwh": 5.0},
            {"bus": "2", "p_max_mw": 0.4, "shed_cost_per_mwh": 10.0, "critical": True},
        ],
        ess=[{"bus": "2", "p_max_mw": 1.0, "e_mwh": 0.5, "soc_initial": 0.0}],
        grid=[{"import_max_mw": 9.0, "import_cost_per_mwh": 1.0}],
        **more,
    )
    down = np.zeros((1, 4, 2), bool)
    down[0, 2:, 1] = True
    return World.build(Microgrid.build(case, "copperplate"), rs.Scenarios(("1-2",), down, LIKELY))


@pytest.fixture(scope="module")
def report() -> rs.Report:
    return rs.evaluate(tiny(), ["idle"], ac=True)


def test_the_clairvoyant_bound_is_that_of_its_multipliers(monkeypatch: pytest.MonkeyPatch) -> None:
    """A solver whose multipliers are a little off, and which says that its bound is far above."""
    world = tiny()
    assert clairvoyant(world).objective == pytest.approx([2.0, 4.0])
    solve = Highs.solve

    def careless(solver: Highs) -> Solution:
        found = solve(solver)
        assert found.duals is not None
        noise = np.random.default_rng(5).normal(size=len(found.duals.rows))
        off = replace(found.duals, rows=found.duals.rows + 0.001 * noise)
        return replace(found, bound=found.objective + 1000.0, duals=off)

    monkeypatch.setattr(Highs, "solve", careless)
    found = clairvoyant(world).objective
    assert (found < np.array([2.0, 4.0]) - 0.01).all()
    assert (found > np.array([0.0, 2.0])).all()


BY_HAND = {
    "cost_per_day": (3.5 * 12, 3.1375 * 12, 2.5 * 12),
    "cvar95_day": (8, 5.2, 4),
    "cvar95_per_day": (8 * 12, 5.2 * 12, 4 * 12),
    "worst_per_day": (8 * 12, 5.2 * 12, 4 * 12),
    "worst_day": (8, 5.2, 4),
    "gap_percent": (40.0, 25.5, 0.0),
    "score": (-0.3625 / 0.6375, 0.0, 1.0),
    "over_rule_per_day": (0.3625 * 12, 0.0, -0.6375 * 12),
    "over_rule_carriers": (1, 0, 2),
    "perfect_information_per_day": (12.0, 0.6375 * 12, 0.0),
    "end_energy_mwh": (0.0, 0.75 * 0.45, 0.0),
    "shed_mwh_per_day": (0.25 * 12, 0.25 * 0.55 * 12, 0.25 * 0.5 * 12),
    "shed_mw_slots_per_day": (0.5 * 12, 0.25 * 1.1 * 12, 0.25 * 1.0 * 12),
    "eens_mwh": (0.25, 0.25 * 0.55, 0.125),
    "lolp": (0.125, 0.125, None),
    "lolp_episodes": (0.25, 0.25, 0.25),
    "lole_h_per_day": (3.0, 3.0, None),
    "served_percent": (87.5, 93.125, 93.75),
    "critical_served_percent": (87.5, 93.75, 100.0),
    "critical_whole": (0.75, 0.75, 1.0),
    "critical_lasts_h": (0.75 * 2.0 + 0.25 * 1.0, 0.75 * 2.0 + 0.25 * 1.5, 2.0),
    "asidi_h_per_day": (3.0, 0.25 * 12 * (0.6 * (0.35 / 0.6) + 0.4 * (0.2 / 0.4)), None),
    "trapezoid_phi_per_h": (-0.5, None, None),
    "trapezoid_lambda": (0.25, 0.25, None),
    "trapezoid_e_h": (0.25, 0.125, None),
    "trapezoid_pi_per_h": (0.0, 0.0, None),
    "trapezoid_area": (0.875, 0.93125, 0.9375),
    "asifi_per_day": (3.0, 3.0, None),
}


@pytest.mark.parametrize("column", BY_HAND)
def test_columns_are_what_they_are_by_hand(report: rs.Report, column: str) -> None:
    frame = report.frame()
    for name, value in zip(("idle", "rule-0.9", "clairvoyant"), BY_HAND[column], strict=True):
        if value is not None:
            assert frame.loc[name, column] == pytest.approx(value, abs=1e-9), name


def test_every_column_is_there_and_explained(report: rs.Report) -> None:
    everywhere = [c for c in COLUMNS if c not in ("over_comb_percent", "over_dual_percent")]
    assert list(report.frame().columns) == [*everywhere, *AC_COLUMNS]
    page = Path(__file__).parents[3] / "docs" / "concepts" / "evaluation.md"
    text = page.read_text(encoding="utf-8")
    missing = [column for column in (*COLUMNS, *AC_COLUMNS) if f"`{column}`" not in text]
    assert not missing


def test_times_are_taken_apart(report: rs.Report) -> None:
    times = report.frame()[["build_s", "build_cpu_s", "ms_per_decision", "cpu_ms_per_decision"]]
    assert (times >= 0).all(axis=None)
    assert times["build_s"].loc["clairvoyant"] > 0
    assert times["ms_per_decision"].loc["idle"] > 0


def test_a_mean_over_episodes_that_are_not_alike_is_no_interquartile_mean(
    report: rs.Report,
) -> None:
    assert report.frame()["iqm_per_day"].isna().all()


def test_the_end_credit_is_worth_the_energy_left() -> None:
    world = tiny(terminal_value_per_mwh=2.0)
    run = simulate(world, DISPATCHERS["rule-0.9"](world.setting))
    assert run.objective(2.0) == pytest.approx([2.45 - 2 * 0.45, 5.2])
    assert rs.evaluate(world, ["idle"]).end_value_per_mwh == 2.0


def test_critical_loads_are_marked_or_have_priority() -> None:
    load = {"p_max_mw": 1.0, "shed_cost_per_mwh": 1.0}
    grid = [{"import_max_mw": 1.0, "import_cost_per_mwh": 1.0}]
    first = small_case(load=[load, load | {"priority": 2.0}], grid=grid)
    assert critical_loads(first).tolist() == [False, True]
    second = small_case(load=[load | {"critical": True}, load | {"priority": 2.0}], grid=grid)
    assert critical_loads(second).tolist() == [True, False]
    assert not critical_loads(small_case(load=[load, load], grid=grid)).any()


@pytest.fixture(scope="module")
def day() -> World:
    """One day, two storms."""
    case = held_out(rs.load_case("ieee33-tou"), 1)
    return World.build(
        Microgrid.build(case, "copperplate"),
        sample_bell(case, Bell(), 2, 5),
        end_value_per_mwh=0.12,
    )


@pytest.fixture(scope="module")
def short() -> World:
    """Two days, three storms each."""
    case = held_out(rs.load_case("ieee33-tou"), 2)
    return World.build(
        Microgrid.build(case, "copperplate"),
        sample_bell(case, Bell(), 3, 5),
        end_value_per_mwh=0.12,
    )


def test_days_begin_at_midnight_wherever_the_horizon_does(short: World) -> None:
    case = short.microgrid.case.replace(start=short.microgrid.case.start.replace(hour=18), slots=96)
    bell = Bell(centres=(90, 10))
    world = World.build(Microgrid.build(case, "copperplate"), sample_bell(case, bell, 4, 1))
    assert np.flatnonzero(np.diff(world.day)).tolist() == [23]
    assert world.scenarios.centre is not None
    np.testing.assert_array_equal(world.centre(23), world.scenarios.centre[0])
    np.testing.assert_array_equal(world.centre(24), world.scenarios.centre[1])


def test_daily_costs_add_up(short: World) -> None:
    found = rs.evaluate(short, ["rule"])
    for name, measured in found.measures.items():
        whole = measured.daily_cost.sum(0)
        np.testing.assert_allclose(whole, found.trajectories[name].cost.sum(0))
        cost, day, episode = measured.worst_day
        assert cost == measured.daily_cost.max() == measured.daily_cost[day, episode]
        assert measured.daily_cost.shape == (2, 3)


def test_a_reset_run_is_its_days_alone_and_says_so(short: World) -> None:
    """The bound of a reset path is the sum of the bounds of its days; so is the rule's cost."""
    found = rs.evaluate(replace(short, reset_daily=True), ["rule"])
    assert "reset every midnight" in found.warnings[0]
    assert found.summary()["reset_daily"]
    assert found.summary()["warnings"]
    assert not rs.evaluate(short, ["rule"]).warnings
    bounds, costs = np.zeros(3), np.zeros(3)
    case, storms = short.microgrid.case, short.scenarios
    for day in range(2):
        alone = case.replace(start=case.start.replace(day=case.start.day + day), slots=96)
        down = storms.down[:, 96 * day : 96 * (day + 1)]
        assert storms.centre is not None
        mine = rs.Scenarios(storms.lines, down, storms.probability, storms.centre[[day]])
        world = World.build(Microgrid.build(alone, "copperplate"), mine, end_value_per_mwh=0.12)
        bounds += clairvoyant(world).objective
        costs += simulate(world, DISPATCHERS["rule"](world.setting)).objective(0.12)
    np.testing.assert_allclose(found.bound, bounds, rtol=1e-9)
    np.testing.assert_allclose(found.objective["rule"], costs, rtol=1e-9)
    np.testing.assert_allclose(found.objective["clairvoyant"], found.bound, rtol=1e-7)


class Listener:
    """Notes what it is told; charges nothing."""

    def __init__(self, setting: Setting) -> None:
        self.name = "listener"

    def act(self, seen: Observation) -> Floats:
        assert (seen.centre == -1).all()
        return np.zeros_like(seen.energy)


def test_operators_are_told_no_centre_where_it_is_unknown(short: World) -> None:
    found = rs.evaluate(replace(short, known_centre=False), {"listener": Listener})
    assert not found.summary()["known_centre"]
    assert "storm centre: unknown" in found.setting
    with pytest.raises(AssertionError):
        rs.evaluate(short, {"listener": Listener})


@pytest.mark.parametrize("name", sorted(set(DISPATCHERS) - {"stochastic", "sddp", "comb"}))
def test_nobody_beats_the_bound_where_forecasts_err(day: World, name: str) -> None:
    """The bound knows the truth; a run is paid by the truth, and planned by what is expected."""
    case = day.microgrid.case
    outlook = sample_outlook(case, ForecastError(0.1, 0.9), 2, 9)
    world = replace(day, outlook=outlook)
    bound = clairvoyant(world)
    run = simulate(world, DISPATCHERS[name](world.setting))
    assert (run.objective(0.12) >= bound.objective - 1e-6).all()
    replayed = simulate(world, Replay("clairvoyant", bound.charging))
    np.testing.assert_allclose(replayed.objective(0.12), bound.objective, rtol=1e-7)
    every = np.arange(case.slots)
    name = case.load[0].profile or ""
    truth = world.profile(name, every)
    assert np.abs(truth - case.profile(name)[:, None]).max() > 0.01
    np.testing.assert_array_equal(world.forecast(7)(name, every[7:8]), truth[7:8])


def test_forecast_errors_have_a_seed_of_their_own_and_are_stated() -> None:
    settings: dict[str, Any] = {"days": 1, "draws": 2, "seed": 3}
    found = compare("ieee33", ["idle"], forecast_error="0.05,0.9", **settings)
    exact = compare("ieee33", ["idle"], **settings)
    np.testing.assert_array_equal(found.scenarios.down, exact.scenarios.down)
    assert found.summary()["forecast_error"] == "sigma 0.05, correlation 0.9"
    assert exact.summary()["forecast_error"] == "none"
    assert (found.bound != exact.bound).all()
    outlook = found.world.outlook
    assert outlook is not None
    own = sample_outlook(found.case, ForecastError(0.05, 0.9), 2, 3)
    assert (outlook.error[:, 0] != own.error[:, 0]).all()
    again = compare("ieee33", ["idle"], forecast_error="0.05,0.9", **settings)
    np.testing.assert_array_equal(found.objective["idle"], again.objective["idle"])


def test_forecast_errors_by_name() -> None:
    assert parse_error("ar1") == ForecastError(0.025, 0.97)
    assert parse_error("gaussian") == ForecastError(0.025, 0.0)
    assert parse_error("0.1,0.5") == ForecastError(0.1, 0.5)
    assert parse_error("none") is parse_error(None) is None
    assert parse_error("0.1,0.5,0.7") == ForecastError(0.1, 0.5, 0.7)
    assert parse_error("feeder") == ForecastError(0.1, 0.97, 0.7)
    for text in ("often", "0.1", "0.1,0.2,0.3,0.4", "a,b", "0.0_1,0.5", "٠.1,0.5"):
        with pytest.raises(rs.UsageError, match="cannot be read"):
            parse_error(text)
    with pytest.raises(rs.UsageError, match="correlation"):
        parse_error("0.1,1.0")


def test_differences_are_between_any_two_methods(short: World) -> None:
    found = rs.evaluate(short, ["rule", "idle", "greedy"])
    frame = found.differences()
    assert len(frame) == 5 * 4 / 2
    assert (frame["per_day"] >= 0).all()
    for _, pair in frame.iterrows():
        mean = (found.objective[pair["method"]] - found.objective[pair["other"]]).mean() / 2
        assert pair["per_day"] == pytest.approx(mean)
        assert pair["low"] <= mean <= pair["high"]
        assert pair["excludes_zero"] == (pair["low"] > 0 or pair["high"] < 0)


def test_values_of_looking_further(day: World) -> None:
    """What the blind window costs more than the fan, and what foresight would save of the fan."""
    found = rs.evaluate(day.with_scenarios(np.array([1])), ["mpc-blind", "stochastic"])
    (one,) = found.value_of_stochastic_solution()
    blind, many = (found.objective[name].mean() for name in ("mpc-blind", "stochastic"))
    assert (one["deterministic"], one["stochastic"]) == ("mpc-blind", "stochastic")
    assert one["per_day"] == pytest.approx(blind - many)
    assert float(one["per_day"]) > 0
    information = found.frame().loc["stochastic", "perfect_information_per_day"]
    assert information == pytest.approx(many - found.bound.mean())


def test_a_report_is_saved_whole(report: rs.Report, tmp_path: Path) -> None:
    report.save(tmp_path / "report")
    folder = tmp_path / "report"
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["physics"] == "copperplate"
    assert {row["method"] for row in summary["methods"]} == set(report.objective)
    assert summary["methods"][0]["iqm_per_day"] is None
    assert summary["certificates"]["idle"]["not_converged"] == 0
    assert summary["infrastructure"]["lambda_share"] == pytest.approx(0.25)
    episodes = pd.read_parquet(folder / "episodes.parquet")
    assert episodes["idle"].tolist() == pytest.approx([2, 8])
    each = pd.read_parquet(folder / "per_episode.parquet").set_index(["method", "episode"])
    assert each.loc[("idle", 1), "ens_mwh"] == pytest.approx(1.0)
    assert each.loc[("idle", 1), "first_critical_shed_h"] == pytest.approx(1.0)
    days = pd.read_parquet(folder / "per_day.parquet")
    assert days.query("method == 'idle'")["operating_cost"].tolist() == pytest.approx([2, 8])
    slots = pd.read_parquet(folder / "slots" / "rule-0.9.parquet")
    assert slots.loc[(1, 2), "storage[ess1]"] == pytest.approx(0.9)
    assert slots.loc[(1, 2), "load.shed[load1]"] == pytest.approx(0.1)
    assert slots["cost"].sum() == pytest.approx(2.45 + 5.2)
    again = rs.load_case(folder / "case.toml")
    assert again.equals(report.case)


def test_one_physics_for_everybody() -> None:
    """A voltage band of 0.9 pu lets 0.19 / (2 * 0.15) MW through the line: idle sheds the rest.

    The clairvoyant serves it from storage: 0.55 MWh for two hours, of 0.73 MWh that lack.
    """
    case = small_case(
        buses=2,
        lines=[(1, 2, 0.15, 0.0)],
        load=[{"bus": "2", "p_max_mw": 1.0, "shed_cost_per_mwh": 9.0}],
        ess=[{"bus": "2", "p_max_mw": 1.0, "e_mwh": 1.0, "soc_initial": 0.55}],
        grid=[{"import_max_mw": 9.0, "import_cost_per_mwh": 1.0}],
    )
    storms = rs.Scenarios((), np.zeros((0, 2, 1), bool), np.ones(1))
    through = 0.19 / 0.3
    lack = 2.0 * (1.0 - through)
    found = rs.evaluate(World.build(Microgrid.build(case, "lindistflow"), storms), ["idle"])
    assert found.summary()["physics"] == "lindistflow"
    assert found.objective["idle"] == pytest.approx([2.0 * through + 9.0 * lack], rel=1e-6)
    assert found.bound == pytest.approx([2.0 * through + 9.0 * (lack - 0.55)], rel=1e-6)
    assert found.objective["clairvoyant"] == pytest.approx(found.bound, rel=1e-6)
    free = rs.evaluate(World.build(Microgrid.build(case, "copperplate"), storms), ["idle"])
    assert free.objective["idle"] == pytest.approx([2.0])


def test_nobody_beats_the_bound_on_the_network(day: World) -> None:
    microgrid = Microgrid.build(day.microgrid.case.replace(slots=24), "lindistflow")
    storms = sample_bell(microgrid.case, Bell(centres=(8, 12), height=0.3), 2, 7)
    found = rs.evaluate(World.build(microgrid, storms, end_value_per_mwh=0.12), ["rule", "greedy"])
    for cost in found.objective.values():
        assert (cost >= found.bound - 1e-6).all()
    np.testing.assert_allclose(found.objective["clairvoyant"], found.bound, rtol=1e-6)


def test_physics_that_nothing_simulates_is_refused() -> None:
    with pytest.raises(rs.UsageError, match="steps lindistflow or copperplate, not distflow"):
        compare("ieee33", ["idle"], days=1, draws=1, physics="distflow")


def test_scenarios_may_come_from_a_file_and_must_fit(tmp_path: Path) -> None:
    case = held_out(rs.load_case("ieee33"), 1)
    storms = sample_bell(case, Bell(), 2, 4)
    storms.save(tmp_path / "storms.npz")
    found = compare("ieee33", ["idle"], days=1, scenarios=tmp_path / "storms.npz")
    np.testing.assert_array_equal(found.scenarios.down, storms.down)
    with pytest.raises(rs.UsageError, match="scenarios of 96 slots; allowed: 192"):
        compare("ieee33", ["idle"], days=2, scenarios=storms)


def test_the_bound_cannot_be_played() -> None:
    with pytest.raises(rs.UsageError, match="a method is called 'clairvoyant'"):
        rs.evaluate(tiny(), {"clairvoyant": Listener})
    assert set(rs.evaluate(tiny(), ["clairvoyant"]).objective) == {"rule-0.9", "clairvoyant"}


def test_a_method_may_have_a_name_of_ones_own() -> None:
    renamed = rs.evaluate(tiny(), {"mine": "rule", "rule": "rule"})
    np.testing.assert_array_equal(renamed.objective["mine"], renamed.objective["rule"])
    with pytest.raises(rs.UsageError, match="'rull' is unknown"):
        rs.evaluate(tiny(), {"mine": "rull"})
    with pytest.raises(rs.UsageError, match=r"(?s)'mine' is int; allowed.*hint: "):
        rs.evaluate(tiny(), {"mine": 3})  # type: ignore[dict-item]
