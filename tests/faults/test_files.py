"""What was written and is no longer what it was is named, and never believed."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import resilience as rs
from resilience.dispatch.rules import Greedy
from resilience.errors import CertificateError, ResilienceError, UsageError
from resilience.evaluation.comparison import load_comparison
from resilience.progress import NOTICE
from resilience.simulation.audit import check_trajectory
from resilience.simulation.simulate import simulate
from resilience.simulation.trajectory import Trajectory
from resilience.simulation.trajectory_file import load_trajectory, save_trajectory
from resilience.simulation.world import World
from resilience.testing import small_world
from tests.faults.test_injected import island, storms


def changed(folder: Path, **values: Any) -> None:
    """Writes other values to `summary.json`."""
    path = folder / "summary.json"
    summary = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps(summary | values), encoding="utf-8")


def added(path: Path, row: int, column: str, by: float) -> None:
    """Adds to one number of a table."""
    table = pd.read_parquet(path)
    values = table[column].to_numpy(float).copy()
    values[row] += by
    table.assign(**{column: values}).to_parquet(path)


@pytest.fixture(scope="module")
def plan() -> rs.Plan:
    return rs.solve(island(), "lp")


@pytest.fixture(scope="module")
def scenario_plan() -> rs.ScenarioPlan:
    found = rs.solve(island().replace(outages=(), generator=()), "stochastic", scenarios=storms())
    assert isinstance(found, rs.ScenarioPlan)
    return found


WRONG: list[dict[str, Callable[[Any], Any]]] = [
    {"objective": lambda x: x - 2.5},
    {"operating_cost": lambda x: x + 0.75},
    {"bound": lambda x: x + 100.0},
    {"bound": lambda x: float("inf")},
    {"gap": lambda x: 0.375},
    {"status": lambda x: "proven"},
    {"audit": lambda x: x | {"balance.p": 3e-5}},
    {"energy_mwh": lambda x: x | {"demand": x["demand"] + 0.25}},
    {"costs": lambda x: x | {"load.shed": 7.5}},
    {"bound": lambda x: None, "gap": lambda x: None},  # and yet "optimal"
]


@pytest.mark.parametrize("wrong", WRONG, ids="-".join)
def test_a_summary_that_contradicts_itself_is_refused_with_its_folder(
    plan: rs.Plan, tmp_path: Path, wrong: dict[str, Callable[[Any], Any]]
) -> None:
    plan.save(tmp_path / "run")
    assert plan.status == "optimal"
    changed(tmp_path / "run", **{key: other(getattr(plan, key)) for key, other in wrong.items()})
    with pytest.raises(CertificateError, match="run contradicts itself"):
        rs.load_plan(tmp_path / "run")


def test_a_table_that_was_changed_is_refused(plan: rs.Plan, tmp_path: Path) -> None:
    plan.save(tmp_path / "run")
    path = tmp_path / "run" / "power.parquet"
    added(path, 2, str(plan.frame("power").columns[0]), 0.3)
    with pytest.raises(CertificateError, match="in the energy balance"):
        rs.load_plan(tmp_path / "run")


@pytest.mark.parametrize(
    ("key", "by"),
    [("objective", -2.5), ("bound", 100.0), ("clairvoyant_cost", 100.0), ("expected_cost", 0.5),
     ("value_of_perfect_information", 0.5), ("expected_operating_cost", 0.5)],
)  # fmt: skip
def test_a_plan_over_scenarios_that_contradicts_itself_is_refused(
    scenario_plan: rs.ScenarioPlan, tmp_path: Path, key: str, by: float
) -> None:
    scenario_plan.save(tmp_path / "run")
    changed(tmp_path / "run", **{key: getattr(scenario_plan, key) + by})
    with pytest.raises(CertificateError, match="run contradicts itself"):
        rs.load_scenario_plan(tmp_path / "run")


@pytest.mark.parametrize("column", ["cost", "clairvoyant_cost"])
def test_scenarios_that_were_changed_are_refused(
    scenario_plan: rs.ScenarioPlan, tmp_path: Path, column: str
) -> None:
    scenario_plan.save(tmp_path / "run")
    added(tmp_path / "run" / "scenarios.parquet", 1, column, 50.0)
    with pytest.raises(CertificateError, match="run contradicts itself"):
        rs.load_scenario_plan(tmp_path / "run")


@pytest.fixture(scope="module")
def run() -> Trajectory:
    world = small_world()
    return simulate(world, Greedy(world.setting))


def shifted(name: str, place: tuple[int, ...], by: float) -> Callable[[Trajectory], Trajectory]:
    def change(run: Trajectory) -> Trajectory:
        array = np.array(getattr(run, name))
        array[place] += by
        arrays: dict[str, Any] = {name: array}
        return replace(run, **arrays)

    return change


CHANGES: dict[str, Callable[[Trajectory], Trajectory]] = {
    "a cost": shifted("cost", (3, 1), -0.02),
    "stored energy": shifted("energy", (1, 4, 2), 0.05),
    "energy at the start": shifted("energy", (0, 0, 1), 0.05),
    "power of storage": shifted("storage", (1, 5, 0), 0.1),
    "a source": shifted("flows", (0, 2, 1), 0.1),
    "spilled power": shifted("spill", (6, 2), 0.2),
    "energy credited": shifted("left_mwh", (1,), 0.3),
    "no number": shifted("cost", (2, 2), np.nan),
    "an infinite cost": shifted("cost", (2, 2), np.inf),
    "a scenario less": lambda run: replace(run, cost=run.cost[:, :2]),
    "other sources": lambda run: replace(run, columns=run.columns[::-1]),
    "another step": lambda run: replace(run, step_h=0.5),
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_trajectory_that_cannot_have_happened_is_refused(run: Trajectory, change: str) -> None:
    check_trajectory(small_world(), run)
    with pytest.raises(CertificateError, match="the trajectory of 'greedy'"):
        check_trajectory(small_world(), CHANGES[change](run))


@pytest.mark.parametrize("change", ["no number", "an infinite cost", "a scenario less"])
def test_a_file_of_no_trajectory_is_named(run: Trajectory, tmp_path: Path, change: str) -> None:
    save_trajectory(CHANGES[change](run), tmp_path / "greedy.npz")
    with pytest.raises(UsageError, match=r"greedy\.npz holds no trajectory"):
        load_trajectory(tmp_path / "greedy.npz")


def test_any_byte_of_a_trajectory_may_be_lost(run: Trajectory, tmp_path: Path) -> None:
    """A file with a hole is refused by name, or is still the same trajectory."""
    path, rng = tmp_path / "greedy.npz", np.random.default_rng(11)
    save_trajectory(run, path)
    whole = path.read_bytes()
    for _ in range(60):
        torn = bytearray(whole)
        place = int(rng.integers(len(torn)))
        torn[place : place + int(rng.integers(1, 40))] = rng.bytes(int(rng.integers(0, 20)))
        path.write_bytes(torn)
        try:
            found = load_trajectory(path)
        except ResilienceError as error:
            assert "greedy.npz" in str(error)  # noqa: PT017 either of the two is right
        else:
            check_trajectory(small_world(), found)


@pytest.fixture
def world() -> World:
    return replace(small_world(), outlook=None)


def parts(folder: Path, method: str) -> list[Path]:
    return sorted((folder / "parts").glob(f"{method}-*.npz"))


def rewritten(path: Path, **change: Callable[[Any], Any]) -> None:
    """Writes other arrays to a part, with sound sums of bytes."""
    key = path.stem if path.parent.name == "parts" else ""
    trajectory = load_trajectory(path, key)
    values = {name: other(getattr(trajectory, name)) for name, other in change.items()}
    save_trajectory(replace(trajectory, **values), path, key)


@pytest.mark.parametrize(
    ("method", "change"),
    [("greedy", {"cost": lambda x: 0.5 * x}), ("clairvoyant", {"proven": lambda x: x + 100.0}),
     ("clairvoyant", {"proven": lambda x: None})],
    ids=["half the cost", "a higher bound", "no bound"],
)  # fmt: skip
def test_a_part_that_was_changed_ends_the_run_and_is_named(
    world: World, tmp_path: Path, method: str, change: dict[str, Callable[[Any], Any]]
) -> None:
    rs.evaluate(world, ["greedy"], out=tmp_path / "out")
    part = parts(tmp_path / "out", method)[0]
    rewritten(part, **change)
    with pytest.raises(CertificateError, match=part.name):
        rs.evaluate(world, ["greedy"], out=tmp_path / "out")


def test_a_part_that_cannot_be_read_is_made_anew(world: World, tmp_path: Path) -> None:
    before = rs.evaluate(world, ["greedy"], out=tmp_path / "out")
    for part, torn in zip(parts(tmp_path / "out", "greedy"), (b"", b"PK\x03\x04"), strict=False):
        part.write_bytes(torn)
    after = rs.evaluate(world, ["greedy"], out=tmp_path / "out")
    np.testing.assert_array_equal(after.objective["greedy"], before.objective["greedy"])


def doctored(path: Path) -> None:
    """Halves the costs in a part and leaves everything else as it is, its checksum too."""
    with np.load(path) as file:
        arrays: dict[str, Any] = dict(file)
    np.savez_compressed(path, **arrays | {"cost": 0.5 * arrays["cost"]})


def as_another(path: Path) -> None:
    """Puts a part in the place of one of another method."""
    path.write_bytes(parts(path.parents[1], "rule-0.9")[0].read_bytes())


@pytest.mark.parametrize("change", [doctored, as_another])
def test_a_part_that_is_not_what_was_written_is_made_anew(
    world: World, tmp_path: Path, change: Callable[[Path], None], caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(NOTICE)
    before = rs.evaluate(world, ["greedy"], out=tmp_path / "out")
    part = parts(tmp_path / "out", "greedy")[0]
    whole = part.read_bytes()
    change(part)
    assert part.read_bytes() != whole
    after = rs.evaluate(world, ["greedy"], out=tmp_path / "out")
    np.testing.assert_array_equal(after.objective["greedy"], before.objective["greedy"])
    assert "1 part there is damaged or was changed, and is made anew" in caplog.text


@pytest.mark.parametrize(("column", "by"), [("greedy", -1.5), ("bound", 100.0), ("greedy", np.nan)])
def test_a_comparison_that_was_changed_is_refused_with_its_folder(
    world: World, tmp_path: Path, column: str, by: float
) -> None:
    rs.evaluate(world, ["greedy"], out=tmp_path / "out")
    load_comparison(tmp_path / "out")
    added(tmp_path / "out" / "episodes.parquet", 2, column, by)
    with pytest.raises(CertificateError, match="out contradicts itself"):
        load_comparison(tmp_path / "out")


def test_a_trajectory_of_a_comparison_that_was_changed_is_refused(
    world: World, tmp_path: Path
) -> None:
    rs.evaluate(world, ["greedy"], out=tmp_path / "out")
    path = tmp_path / "out" / "trajectories" / "greedy.npz"
    rewritten(path, energy=lambda x: x + 0.05)
    with pytest.raises(CertificateError, match="out contradicts itself"):
        load_comparison(tmp_path / "out")
