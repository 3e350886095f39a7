"""Kinds of files that results are kept in: plans, comparisons, trajectories, curves, caches."""

from __future__ import annotations

import io
import json
import tomllib
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from hypothesis import strategies as st

import resilience as rs
from resilience.dispatch.rules import Greedy
from resilience.dispatch.sddp import cache
from resilience.dispatch.sddp.model import Cuts
from resilience.dispatch.sddp.training import Trained
from resilience.errors import UsageError
from resilience.evaluation.comparison import Comparison, load_comparison
from resilience.parts import load_part, save_part
from resilience.simulation.simulate import simulate
from resilience.simulation.trajectory import Trajectory
from resilience.simulation.trajectory_file import load_trajectory, save_trajectory
from resilience.testing import small_world
from tests.faults.test_injected import island, storms
from tests.fuzz.changes import (
    arrays_changed,
    bytes_changed,
    data_changed,
    parquet_changed,
    table_changed,
)
from tests.fuzz.kinds import Files, Kind, saved, some_file


@st.composite
def json_changed(draw: st.DrawFn, data: bytes) -> bytes:
    """JSON with other data, or other bytes."""
    text = json.dumps(draw(data_changed(json.loads(data))), default=str).encode()
    return draw(bytes_changed(text)) if draw(st.integers(0, 4)) == 0 else text


@st.composite
def toml_changed(draw: st.DrawFn, data: bytes) -> bytes:
    """TOML with other data, or other bytes."""
    try:
        changed = draw(data_changed(tomllib.loads(data.decode()), times=True))
        return tomli_w.dumps(changed).encode()
    except (TypeError, ValueError, RecursionError):
        return draw(bytes_changed(data))


def file_changed(name: str, data: bytes) -> st.SearchStrategy[bytes]:
    """A file of a folder of results, changed as its suffix says."""
    match Path(name).suffix:
        case ".json":
            return json_changed(data)
        case ".toml":
            return toml_changed(data)
        case ".parquet":
            return parquet_changed(data)
        case ".npz":
            return npz_changed(data)
        case ".csv":
            return table_changed(data.decode())
    return bytes_changed(data)


def npz_changed(data: bytes) -> st.SearchStrategy[bytes]:
    """An .npz file with other arrays."""
    with np.load(io.BytesIO(data)) as file:
        arrays = {name: file[name] for name in file.files}
    is_text = "about" in arrays and arrays["about"].dtype.kind == "U"
    return arrays_changed(arrays, "about" if is_text else "")


def only_read(files: Files) -> st.SearchStrategy[Files]:
    """Changes of a file that is read again: of tables those in Parquet."""
    read = {name: data for name, data in files.items() if Path(name).suffix != ".csv"}
    return some_file(file_changed)(read)


def sound_plan(plan: rs.Plan | rs.ScenarioPlan) -> None:
    json.dumps(plan.summary(), allow_nan=False)
    for name in plan.tables:
        assert plan.frame(name).shape[1] == len(plan.tables[name].labels)
        assert np.isfinite(plan.tables[name].values).all() or name in ("variables", "voltage")
    assert np.isfinite(plan.objective)


def sound_trajectory(trajectory: Trajectory) -> None:
    for values in (trajectory.cost, trajectory.energy, trajectory.storage, trajectory.flows):
        assert np.isfinite(values).all()
    assert trajectory.energy.shape[1] == trajectory.cost.shape[0] + 1
    assert trajectory.flows.shape[0] == len(trajectory.columns)


def sound_comparison(compared: Comparison) -> None:
    assert set(compared.objective) == set(compared.trajectories)
    assert {"greedy", "rule-0.9", "clairvoyant"} <= set(compared.objective)
    for costs in compared.objective.values():
        assert costs.shape == compared.bound.shape == (compared.scenarios.n,)


def write_plan(folder: Path) -> None:
    rs.solve(island(), "lp").save(folder / "run")


def write_scenario_plan(folder: Path) -> None:
    case = island().replace(outages=(), generator=())
    rs.solve(case, "stochastic", scenarios=storms()).save(folder / "run")


def write_comparison(folder: Path) -> None:
    world = small_world()
    rs.evaluate(world, ["greedy", "rule-0.9"]).save(folder / "run")


def write_trajectory(folder: Path) -> None:
    world = small_world()
    save_trajectory(simulate(world, Greedy(world.setting)), folder / "greedy.npz")


RESULTS = {
    "plan": Kind(
        saved(write_plan), only_read, lambda folder: rs.load_plan(folder / "run"), sound_plan, "run"
    ),
    "plan over scenarios": Kind(
        saved(write_scenario_plan),
        only_read,
        lambda folder: rs.load_scenario_plan(folder / "run"),
        sound_plan,
        "run",
    ),
    "comparison": Kind(
        saved(write_comparison),
        only_read,
        lambda folder: load_comparison(folder / "run"),
        sound_comparison,
        "run",
        slow=True,
    ),
    "trajectory": Kind(
        saved(write_trajectory),
        some_file(file_changed),
        lambda folder: load_trajectory(folder / "greedy.npz"),
        sound_trajectory,
        "greedy.npz",
    ),
}


def sound_curves(curves: Any) -> None:
    for curve in curves:
        assert np.isfinite(curve.cpu_s).all()
        assert len(curve.cpu_s) == len(curve.gap) > 0


def write_run(folder: Path) -> None:
    lines = ["iteration,cpu_s,loss,cost_per_day,gap", "3,1.5,7.5,30.25,0.9", "6,3.0,6.5,28.5,0.2"]
    (folder / "run").mkdir()
    (folder / "run" / "curve.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    config = {"case": "island", "method": "apg", "seed": 2, "band": "anchors"}
    (folder / "run" / "config.json").write_text(json.dumps(config), encoding="utf-8")


def read_curves(folder: Path) -> Any:
    from resilience.rl.training.curves import load_curves

    return load_curves(folder / "run")


RESULTS["learning curve"] = Kind(
    saved(write_run), some_file(file_changed), read_curves, sound_curves, "run"
)


CUTS, CUTS_KEY = "cuts.npz", "digest of what they are of"


def few_cuts() -> Trained:
    """Two slots with two and one modes, one to three cuts each."""
    rng = np.random.default_rng(3)
    counts = iter((1, 3, 2, 2))

    def cuts() -> Cuts:
        n = next(counts)
        return Cuts(rng.normal(size=n), rng.normal(size=(n, 2)), rng.normal(size=(n, 1)))

    return Trained([[cuts(), cuts()], [cuts()]], cuts(), np.array([3.5, 4.25]))


def load_cuts(folder: Path) -> Trained:
    cuts = cache.load(folder / CUTS, CUTS_KEY)
    if cuts is None:
        raise UsageError("no such cuts")
    return cuts


def sound_cuts(cuts: Trained) -> None:
    """Those that were saved, and nothing else."""
    wanted = few_cuts()
    assert [len(slot) for slot in cuts.cuts] == [2, 1]
    everything, all_wanted = ([*chain(*t.cuts), t.root] for t in (cuts, wanted))
    for one, other in zip(everything, all_wanted, strict=True):
        for name in ("alpha", "beta", "gamma"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    np.testing.assert_array_equal(cuts.bounds, wanted.bounds)


PART, FIGURES = "figures.json", {"name": "methods", "rows": [{"mean": 3.5, "low": None}, "text"]}


def load_figures(folder: Path) -> Any:
    figures = load_part(folder / PART)
    if figures is None:
        raise UsageError("no such part")
    return figures


def sound_figures(figures: Any) -> None:
    assert figures == FIGURES


RESULTS |= {
    "cuts": Kind(
        saved(lambda folder: cache.save(folder / CUTS, CUTS_KEY, few_cuts())),
        some_file(file_changed),
        load_cuts,
        sound_cuts,
    ),
    "figures": Kind(
        saved(lambda folder: save_part(folder / PART, FIGURES)),
        some_file(file_changed),
        load_figures,
        sound_figures,
    ),
}
