"""How long loads last without the grid: by hand, and start by start in a world of its own."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from statistics import NormalDist

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import resilience as rs
from resilience.case import Case
from resilience.cli.app import app
from resilience.dispatch.registry import DISPATCHERS
from resilience.errors import UsageError
from resilience.evaluation.measures.metrics import time_to_first_shed
from resilience.evaluation.survival import survive
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.microgrid import Microgrid
from resilience.simulation.simulate import simulate
from resilience.simulation.world import World
from resilience.testing.cases import DeviceKeys, small_case

STORE = {"bus": "2", "p_max_mw": 3.0, "e_mwh": 8.0, "soc_min": 0.25, "soc_initial": 1.0,
         "efficiency_discharge": 0.9}  # fmt: skip


def store(
    ess: Sequence[DeviceKeys] = (STORE,),
    generator: Sequence[DeviceKeys] = (),
    tanks: Sequence[DeviceKeys] = (),
) -> Case:
    """1 MW of critical and 0.5 MW of other load, a full store of 6 MWh, and a grid."""
    return small_case(
        slots=24,
        buses=2,
        lines=[(1, 2, 0.01, 0.02)],
        tanks=tanks,
        load=[
            {"bus": "2", "p_max_mw": 1.0, "shed_cost_per_mwh": 9.0, "critical": True},
            {"bus": "2", "p_max_mw": 0.5, "shed_cost_per_mwh": 3.0},
        ],
        ess=ess,
        generator=generator,
        grid=[{"import_max_mw": 4.0, "import_cost_per_mwh": 0.2}],
    )


def test_a_full_store_lasts_as_long_as_its_energy() -> None:
    """6 MWh of which 0.9 arrive: 5.4 MWh, for 1.5 MW 3.6 h, so the fourth hour is not served."""
    found = survive(store(), (2, 3, 4, 6))
    assert len(found.all_h) == 24
    whole = found.ahead_h >= 6
    assert found.all_h[whole].tolist() == [3.0] * 19
    # Of the fourth hour 0.9 MWh are left, which the dearer load takes; it lacks 0.1 MWh.
    assert found.critical_h is not None
    assert found.critical_h[whole].tolist() == [3.0] * 19
    table = found.frame()
    assert table["all_served"].tolist() == [1.0, 1.0, 0.0, 0.0]
    assert table["starts"].tolist() == [23, 22, 21, 19]
    small = store(ess=[STORE | {"soc_min": 0.2}])
    longer = survive(small, (6,))
    assert longer.critical_h is not None
    assert longer.critical_h[0] == 4.0  # 5.76 MWh: 1.26 in the fourth hour
    assert longer.all_h[0] == 3.0


def test_fuel_lasts_as_long_as_the_tank_and_comes_by_hours_of_the_outage() -> None:
    """3 m³ of 0.5 m³/MWh for 1.5 MW are 4 h, and 1.5 m³ after 3 h two more."""
    unit = {
        "bus": "2",
        "p_max_mw": 2.0,
        "cost_per_mwh": 0.5,
        "tank": "tank1",
        "fuel_m3_per_mwh": 0.5,
    }
    tank = {"capacity_m3": 5.0, "initial_m3": 3.0}
    dry = survive(store(ess=[], generator=[unit], tanks=[tank]), (8,), method="greedy")
    assert dry.all_h[dry.ahead_h >= 8].tolist() == [4.0] * 17
    fed = tank | {"delivery": [{"hour": 3.0, "amount_m3": 1.5}]}
    later = survive(store(ess=[], generator=[unit], tanks=[fed]), (8,), method="greedy")
    assert later.all_h[later.ahead_h >= 8].tolist() == [6.0] * 17


@pytest.mark.parametrize(("method", "hours"), [("rule-0.9", 30.0), ("greedy", 6.0)])
def test_a_start_is_what_a_world_that_begins_there_does(method: str, hours: float) -> None:
    """33 buses with three quarters of their generators, from some hours of the profiles on."""
    case = rs.load_case("ieee33")
    for unit in case.generator:
        case = case.with_generator(unit.name, p_max_mw=0.75 * unit.p_max_mw)
    found = survive(case, (hours,), method=method, every_h=7)
    slots = int(4 * hours)
    assert 0.0 < found.frame()["all_served"].iloc[0] < 1.0
    for k in (0, 11, 60, 150):
        start = found.start[k].astype("datetime64[s]").item()
        island = case.replace(start=start, slots=slots, grid=[], outages=())
        calm = Scenarios((), np.zeros((0, slots, 1), bool), np.ones(1))
        world = World.build(Microgrid.build(island, "copperplate"), calm)
        shed = simulate(world, DISPATCHERS[method](world.setting)).shed
        alone = time_to_first_shed(shed, island.step_h)[0]
        assert found.all_h[k] == alone


def test_the_interval_is_wilsons_of_outages_that_do_not_overlap() -> None:
    """24 starts of 2 h on one day are worth one outage."""
    row = survive(store(), (2,)).frame().iloc[0]
    z = NormalDist().inv_cdf(0.975)
    assert row["all_high"] == 1.0
    assert row["all_low"] == pytest.approx(1.0 / (1.0 + z**2), abs=1e-12)


@pytest.mark.parametrize(
    ("durations", "every_h", "message"),
    [((), 1.0, "durations none h"), ((48.0,), 1.0, "48 h; allowed"), ((2.0,), 0.3, "every 0.3 h")],
)
def test_what_cannot_be_asked(durations: tuple[float, ...], every_h: float, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        survive(store(), durations, every_h=every_h)


def test_a_case_without_loads_has_nothing_to_survive() -> None:
    with pytest.raises(UsageError, match=r"(?s)no loads.*hint: \[\[load\]\]"):
        survive("analytic/arbitrage", (6, 12))


def test_the_command_prints_a_row_per_duration() -> None:
    run = CliRunner().invoke(app, ["survive", "ieee33", "--durations", "6,24", "--every-h", "24"])
    assert run.exit_code == 0, run.output
    assert "all served" in run.output
    assert "No load is critical" in run.output
    asked = CliRunner().invoke(
        app, ["survive", "ieee33", "--durations", "6", "--every-h", "24", "--json"]
    )
    row = json.loads(asked.stdout)["durations"][0]
    assert row["duration_h"] == 6.0
    assert row["critical_served"] is None
    wrong = CliRunner().invoke(app, ["survive", "ieee33", "--durations", "6,x"])
    assert isinstance(wrong.exception, UsageError)


def test_a_saved_survival_is_the_one_that_was_saved(tmp_path: Path) -> None:
    survival = survive(store(), (2, 4))
    loaded = rs.load_survival(survival.save(tmp_path / "run"))
    assert loaded.case.equals(survival.case)
    assert loaded.summary() == survival.summary()
    pd.testing.assert_frame_equal(loaded.starts(), survival.starts())
    readme = (tmp_path / "run" / "README.md").read_text(encoding="utf-8")
    assert all(path.name in readme for path in (tmp_path / "run").iterdir() if path.suffix != ".md")
    starts = pd.read_parquet(tmp_path / "run" / "starts.parquet")
    starts.assign(all_h=0.0).to_parquet(tmp_path / "run" / "starts.parquet")
    with pytest.raises(UsageError, match=r"run holds no survival.*contradict"):
        rs.load_survival(tmp_path / "run")
    with pytest.raises(UsageError, match="holds no survival; allowed"):
        rs.load_survival(tmp_path)


def test_a_saved_survival_is_drawn_and_replaced_by_its_kind_only(tmp_path: Path) -> None:
    run = tmp_path / "run"
    command = ["survive", "ieee33", "--durations", "6", "--every-h", "48", "--out", str(run)]
    first = CliRunner().invoke(app, command)
    assert first.exit_code == 0, first.output
    assert first.stdout.splitlines()[-1] == f"tables: {run}"
    again = CliRunner().invoke(app, [*command, "--seed", "1"])
    assert again.exit_code == 0, again.output
    for name in ("plot", "report"):
        shown = CliRunner().invoke(app, [name, str(run)])
        assert shown.exit_code == 0, shown.output
        assert Path(shown.stdout.strip()).is_file()
    stormy = CliRunner().invoke(app, ["plot", str(run), "--method", "rule"])
    assert isinstance(stormy.exception, UsageError)
    assert "holds a survival, no comparison" in str(stormy.exception)
    with pytest.raises(UsageError, match="holds a survival; allowed: an earlier plan"):
        rs.solve("analytic/arbitrage", "lp").save(run)


def test_the_picture_shows_both_kinds_of_loads() -> None:
    figure = rs.plot_survival(survive(store(), (2, 4)))
    labels = figure.axes[0].get_legend_handles_labels()[1]
    assert labels == ["all loads", "critical loads"]


def test_usual_durations_are_those_that_the_profiles_have() -> None:
    hours = survive(store()).durations_h
    assert hours == (6.0, 12.0, 24.0)
