"""However the work is split, interrupted or shipped elsewhere, the numbers are the same."""

from __future__ import annotations

import pickle
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import resilience as rs
from resilience.arrays import Floats
from resilience.case.days import held_out
from resilience.digest import code
from resilience.dispatch.registry import DISPATCHERS
from resilience.dispatch.rules import Idle
from resilience.evaluation import runs
from resilience.evaluation.engines import spread
from resilience.evaluation.store import Store
from resilience.fragility.draw import sample_bell
from resilience.fragility.outages.bell import Bell
from resilience.models.microgrid import Microgrid
from resilience.progress import NOTICE
from resilience.simulation.forecast import ForecastError, sample_outlook
from resilience.simulation.observation import Observation
from resilience.simulation.setting import Setting
from resilience.simulation.simulate import simulate
from resilience.simulation.world import World
from resilience.testing import small_case

METHODS = ["rule", "mpc-blind"]


@pytest.fixture(scope="module")
def world() -> World:
    """Half a day with outages, forecast errors, and four scenarios."""
    case = held_out(rs.load_case("ieee33-tou"), 1).replace(slots=24)
    storms = sample_bell(case, Bell(centres=(8, 12), height=0.3), 4, 7)
    outlook = sample_outlook(case, ForecastError(), 4, 11)
    return World.build(
        Microgrid.build(case, "copperplate"), storms, end_value_per_mwh=0.1, outlook=outlook
    )


def same(one: rs.Report, other: rs.Report) -> None:
    assert one.objective.keys() == other.objective.keys()
    np.testing.assert_array_equal(one.bound, other.bound)
    for name, run in one.trajectories.items():
        for key in ("cost", "energy", "storage", "flows", "spill", "left_mwh"):
            np.testing.assert_array_equal(getattr(run, key), getattr(other.trajectories[name], key))


@pytest.fixture(scope="module")
def alone(world: World) -> rs.Report:
    return rs.evaluate(world, METHODS)


def test_processes_change_nothing(world: World, alone: rs.Report) -> None:
    same(alone, rs.evaluate(world, METHODS, workers=2))


@pytest.mark.slow
def test_dask_changes_nothing(world: World, alone: rs.Report) -> None:
    pytest.importorskip("distributed", reason="the extra `dask` is not installed")
    same(alone, rs.evaluate(world, METHODS, workers=2, engine="dask"))


@pytest.mark.slow
def test_ray_changes_nothing(world: World, alone: rs.Report) -> None:
    pytest.importorskip("ray", reason="the extra `ray` is not installed")
    same(alone, rs.evaluate(world, METHODS, workers=2, engine="ray"))


@pytest.mark.parametrize("at", [[2], [3, 1]])
def test_an_episode_does_not_know_of_others(world: World, alone: rs.Report, at: list[int]) -> None:
    """Some scenarios alone give the numbers that they give among all."""
    some = rs.evaluate(world.with_scenarios(np.array(at)), METHODS)
    np.testing.assert_array_equal(some.bound, alone.bound[at])
    for name in METHODS:
        np.testing.assert_allclose(some.objective[name], alone.objective[name][at], rtol=1e-12)
    np.testing.assert_array_equal(
        some.trajectories["mpc-blind"].storage, alone.trajectories["mpc-blind"].storage[:, :, at]
    )


def test_scenarios_keep_their_numbers(world: World) -> None:
    part = world.with_scenarios(np.array([3, 1]))
    assert part.index.tolist() == [3, 1]
    assert part.with_scenarios(np.array([1])).index.tolist() == [1]
    assert world.index.tolist() == [0, 1, 2, 3]
    assert part.outlook is not None
    assert world.outlook is not None
    np.testing.assert_array_equal(part.outlook.error[:, :, 0], world.outlook.error[:, :, 3])


class Drawn:
    """Acts at random, with a stream per scenario as `Setting.numbers` are for."""

    batched = True

    def __init__(self, setting: Setting) -> None:
        self.name = "drawn"
        self.streams = [np.random.default_rng([5, k]) for k in setting.numbers]

    def act(self, seen: Observation) -> Floats:
        units = len(seen.energy)
        return np.stack([rng.normal(size=units) for rng in self.streams], axis=1)


def test_random_dispatchers_repeat_themselves_in_any_split(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = rs.evaluate(world, {"drawn": Drawn})
    monkeypatch.setattr(runs, "STEPPED_AT_ONCE", 1)
    np.testing.assert_allclose(
        rs.evaluate(world, {"drawn": Drawn}, workers=2).objective["drawn"],
        whole.objective["drawn"],
        rtol=1e-12,
    )


def test_a_world_travels(world: World) -> None:
    again = pickle.loads(pickle.dumps(world))
    run, other = (simulate(w, DISPATCHERS["rule"](w.setting)) for w in (world, again))
    np.testing.assert_array_equal(run.cost, other.cost)


class Stop(BaseException):
    pass


def test_an_interrupted_run_goes_on(
    world: World, alone: rs.Report, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Everything that was finished before the interruption is read, nothing else."""
    begun: list[str] = []
    run = runs.Part.run

    def counted(part: runs.Part, on_slot: Callable[[], None] | None = None) -> rs.Trajectory:
        if len(begun) == 3:
            raise Stop
        begun.append(part.name)
        return run(part, on_slot)

    monkeypatch.setattr(runs.Part, "run", counted)
    with pytest.raises(Stop):
        rs.evaluate(world, METHODS, out=tmp_path / "report")
    kept = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "report/parts").iterdir()}
    assert begun == ["clairvoyant", "rule", "mpc-blind"]
    assert len(kept) == 3
    assert not (tmp_path / "report" / "summary.json").exists()
    begun.clear()
    monkeypatch.setattr(runs.Part, "run", lambda part, on_slot=None: begun.append(part.name)
                        or run(part, on_slot))  # fmt: skip
    same(alone, rs.evaluate(world, METHODS, out=tmp_path / "report"))
    assert begun == ["mpc-blind"] * 3 + ["rule-0.9"]
    after = {p.name: p.stat().st_mtime_ns for p in (tmp_path / "report/parts").iterdir()}
    assert kept.items() <= after.items()
    assert (tmp_path / "report" / "summary.json").is_file()


def test_ctrl_c_says_what_is_there_and_the_next_call_what_it_found(
    world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(NOTICE)
    begun: list[str] = []
    run = runs.Part.run

    def stopped(part: runs.Part, on_slot: Callable[[], None] | None = None) -> rs.Trajectory:
        if len(begun) == 3:
            raise KeyboardInterrupt
        begun.append(part.name)
        return run(part, on_slot)

    monkeypatch.setattr(runs.Part, "run", stopped)
    folder = tmp_path / "report"
    with pytest.raises(KeyboardInterrupt) as stop:
        rs.evaluate(world, METHODS, out=folder)
    assert str(stop.value) == f"3 of 7 parts are in {folder}; the same command goes on"
    begun.clear()
    with pytest.raises(KeyboardInterrupt, match="6 of 7 parts are in"):
        rs.evaluate(world, METHODS, out=folder)
    assert f"3 of 7 parts found in {folder}" in caplog.text
    begun.clear()
    with pytest.raises(KeyboardInterrupt, match="nothing was written; with --out FOLDER"):
        rs.evaluate(world, METHODS)


def test_one_more_method_does_only_that(
    world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rs.evaluate(world, ["rule"], out=tmp_path / "report")
    begun: list[str] = []
    run = runs.Part.run
    monkeypatch.setattr(runs.Part, "run", lambda part, on_slot=None: begun.append(part.name)
                        or run(part, on_slot))  # fmt: skip
    found = rs.evaluate(world, ["rule", "idle"], out=tmp_path / "report")
    assert begun == ["idle"]
    assert set(found.objective) == {"rule", "idle", "rule-0.9", "clairvoyant"}


def test_a_part_is_called_after_all_that_it_depends_on(world: World, tmp_path: Path) -> None:
    store, rule = Store(tmp_path), DISPATCHERS["rule"]
    case = world.microgrid.case
    dearer = case.replace(grid=[case.grid[0].model_copy(update={"import_max_mw": 11.0})])
    changed = [
        world,
        replace(world, end_value_per_mwh=0.2),
        replace(world, known_centre=False),
        replace(world, reset_daily=True),
        replace(world, outlook=None),
        replace(world, scenarios=replace(world.scenarios, down=~world.scenarios.down)),
        world.with_scenarios(np.array([0])),
        World.build(Microgrid.build(dearer, "copperplate"), world.scenarios),
    ]
    names = [store.part_file("rule", w, rule) for w in changed]
    names += [store.part_file("idle", world, Idle), store.part_file("rule", world, Drawn)]
    assert len(set(names)) == len(names)
    assert names[0] == store.part_file("rule", pickle.loads(pickle.dumps(world)), rule)
    assert len(code()) == 64


def test_a_folder_with_something_else_is_refused_before_anything_runs(
    world: World, tmp_path: Path
) -> None:
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(rs.UsageError, match="not empty and holds no earlier result"):
        rs.evaluate(world, ["idle"], out=tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_engines_that_cannot_run_are_refused(world: World) -> None:
    with pytest.raises(rs.UsageError, match="engine 'slurm' is unknown"):
        rs.evaluate(world, ["idle"], engine="slurm")  # type: ignore[arg-type]
    with pytest.raises(rs.UsageError, match="workers is 0"):
        rs.evaluate(world, ["idle"], workers=0)
    if find_spec("ray") is None:
        with pytest.raises(rs.UsageError, match="not installed"):
            rs.evaluate(world, ["idle"], engine="ray")


def test_results_come_as_they_are_finished() -> None:
    found = dict(spread([partial(pow, k, 2) for k in range(5)], 2, "local"))
    assert found == {0: 0, 1: 1, 2: 4, 3: 9, 4: 16}


def test_a_case_without_storage_has_a_bound() -> None:
    case = small_case(
        load=[{"p_max_mw": 1.0, "shed_cost_per_mwh": 5.0}],
        grid=[{"import_max_mw": 0.6, "import_cost_per_mwh": 1.0}],
    )
    storms = rs.Scenarios((), np.zeros((0, 2, 1), bool), np.ones(1))
    found = rs.evaluate(World.build(Microgrid.build(case, "copperplate"), storms), ["idle"])
    assert found.bound == pytest.approx([2 * (0.6 + 0.4 * 5.0)])
    assert found.objective["idle"] == pytest.approx(found.bound)


FILE_OF_A_PART = """
from pathlib import Path
import resilience as rs
from resilience.case.days import held_out
from resilience.evaluation.store import Store
from resilience.fragility.draw import sample_case
from resilience.simulation.world import World, microgrid_with_fallible_lines

case = held_out(rs.load_case("ieee33-tou"), 2)
storms = sample_case(case, 2, 7)
world = World.build(microgrid_with_fallible_lines(case, storms, "copperplate"), storms)
print(Store(Path("somewhere")).part_file("rule", world, None))
"""


def test_a_part_is_called_alike_in_another_process() -> None:
    """Otherwise a comparison that was interrupted would begin anew."""
    command = [sys.executable, "-c", FILE_OF_A_PART]
    first, second = (
        subprocess.run(command, capture_output=True, text=True, check=True).stdout for _ in range(2)
    )
    assert first == second != ""
