"""Every kind of output killed at its file operations: a program, since what is killed is a process.

    python -m tests.faults.kills FOLDER [SHARE [KIND ...]]

A line of JSON per kind, fresh and over an earlier result: how many operations it takes, at how many
of them it was killed, and what was wrong then. SHARE is that of the operations that are tried, 1.0
for all of them, in an order that is drawn once.
"""

from __future__ import annotations

import hashlib
import io
import json
import random
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import redirect_stdout, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import resilience as rs
from resilience.case.measured.series import Measured, write_measured_case
from resilience.files import HIDDEN
from resilience.parts import load_part, save_part
from resilience.results import KINDS, PARTS_FOLDER, settle
from resilience.simulation.trajectory_file import load_trajectory, save_trajectory
from resilience.testing import small_world
from tests.faults.killing import forked, killed_at, operations

Write = Callable[[Path], object]


@dataclass(frozen=True)
class Kind:
    """An output of the package.

    Attributes:
        name: how it is called here.
        path: name of its file or folder.
        earlier: writes an earlier one; None where one is never replaced.
        later: writes the one that is killed.
        read: the package's own reader; it may put in place what was finished.
        seen: what a reader gets of it, where that is not all that lies there.
    """

    name: str
    path: str
    earlier: Write | None
    later: Write
    read: Write
    seen: Callable[[Path], Any] = field(default_factory=lambda: contents)


def main(root: Path, share: float, names: list[str]) -> None:
    """Prints a line per kind and start."""
    for kind in kinds(root / "sources"):
        if names and kind.name not in names:
            continue
        for start in ("fresh", "over") if kind.earlier else ("fresh",):
            print(json.dumps(tried(kind, start, root / "places", share)), flush=True)


def tried(kind: Kind, start: str, root: Path, share: float) -> dict[str, Any]:
    """Kills a kind at its operations, one after another, and says what is wrong then."""
    shutil.rmtree(root, ignore_errors=True)
    place = {name: root / name / kind.path for name in ("earlier", "later", "count", "killed")}
    place["earlier"].parent.mkdir(parents=True)
    before: Path | None = None
    if start == "over":
        assert kind.earlier is not None
        before = place["earlier"]
        kind.earlier(before)
    copied(before, place["later"])
    kind.later(place["later"])
    old, new = contents(place["earlier"]), contents(place["later"])
    views = kind.seen(place["earlier"]), kind.seen(place["later"])
    assert old != new
    assert views[0] != views[1]
    copied(before, place["count"])
    total = operations(root / "count", partial(kind.later, place["count"]))
    numbers = list(range(1, total + 1))
    chosen = sorted(random.Random(total).sample(numbers, max(round(share * total), 1)))
    faults = []
    for number in chosen:
        copied(before, place["killed"])
        assert killed_at(root / "killed", number, partial(kind.later, place["killed"]))
        texts = wrong(kind, place["killed"], old, new, views)
        faults += [f"{number}: {text}" for text in texts]
    return {"kind": kind.name, "start": start, "operations": total, "killed": len(chosen),
            "faults": faults}  # fmt: skip


def copied(source: Path | None, target: Path) -> None:
    """Makes the parent of the target hold a copy of the source, or nothing."""
    shutil.rmtree(target.parent, ignore_errors=True)
    target.parent.mkdir()
    if source is not None and source.is_dir():
        shutil.copytree(source, target)
    elif source is not None:
        shutil.copy2(source, target)


def wrong(kind: Kind, place: Path, old: Any, new: Any, views: tuple[Any, Any]) -> Iterator[str]:
    """What is wrong after a kill, after reading, and after the same command; `views` are what a
    reader gets of the old and the new.
    """
    seen = contents(place)
    yield from lost(kind, place, *views)
    if isinstance(seen, dict) and seen.get(PARTS_FOLDER) != (old or {}).get(PARTS_FOLDER):
        yield "parts are not what they were"
    if contents(place) != new and forked(partial(kind.later, place)) != 0:
        yield "the same command fails"
    if contents(place) != new:
        yield "the same command gives another result"
    if kind.earlier is None:
        forked(partial(quietly, kind.later, place))  # refuses, since it is there
    elif forked(partial(kind.earlier, place)) != 0:
        yield "it is not replaced again"
    if litter := [str(p) for p in place.parent.rglob("*") if p.name.startswith(HIDDEN)]:
        yield f"litter stays: {litter}"
    if others := [path.name for path in place.parent.iterdir() if path != place]:
        yield f"something else stays: {others}"


def lost(kind: Kind, place: Path, old: Any, new: Any) -> Iterator[str]:
    """What is wrong before and after reading."""
    seen, marks = kind.seen(place), {kind.mark for kind in KINDS.values()}
    if isinstance(seen, dict) and marks & set(seen) and seen not in (old, new):
        yield f"beside a summary there are files of another result: {sorted(seen)}"
    if place.exists():
        forked(partial(quietly, kind.read, place))
    read = kind.seen(place)
    if read not in (old, new, None, {}):
        yield "what is read is neither the earlier result nor the new one"
    if not read and old:
        yield "the earlier result is lost"


def quietly(read: Write, place: Path) -> None:
    """Reads what may not be there."""
    with suppress(rs.ResilienceError):
        read(place)


def contents(path: Path) -> Any:
    """Digests of the files of a folder, or of a file; parts of a comparison as one entry."""
    if path.is_file():
        return hashlib.sha256(path.read_bytes()).hexdigest()
    if not path.is_dir():
        return None
    files = {
        file.relative_to(path).as_posix(): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in path.rglob("*")
        if file.is_file() and not any(n.startswith(HIDDEN) for n in file.relative_to(path).parts)
    }
    parts = {name: digest for name, digest in files.items() if name.startswith(PARTS_FOLDER)}
    return {n: d for n, d in files.items() if n not in parts} | (
        {PARTS_FOLDER: parts} if parts else {}
    )


def kinds(sources: Path) -> Iterator[Kind]:
    """All outputs but trainings, see `tests.unit.rl.killed`."""
    from resilience.plots.style import write_figure
    from tests.faults.test_injected import island, storms

    plan = rs.solve(island(), "lp")
    other = rs.solve(island().replace(outages=()), "milp")
    yield Kind("plan", "run", other.save, plan.save, rs.load_plan)
    case = island().replace(outages=(), generator=())
    over: Any = rs.solve(case, "stochastic", scenarios=storms())
    blind: Any = rs.solve(case, "mpc-blind", scenarios=storms())
    yield Kind("plan over scenarios", "run", blind.save, over.save, rs.load_scenario_plan)
    yield from comparisons(sources)
    first, second = (rs.hazard("ieee33_koinu", n=5, seed=seed) for seed in (3, 4))
    yield Kind("hazard", "run", first.save, second.save, settle)
    lasting, shorter = (rs.survive(island(), hours) for hours in ([1.0, 2.0], [1.0]))
    yield Kind("survival", "run", lasting.save, shorter.save, rs.load_survival)
    built = [
        rs.harden(
            "ieee33_rammasun", spend, storms=2, new_storms=2, factor=1.5, lines=["12-13"],
            step_min=360.0,
        )
        for spend in (0.0, 1.0)
    ]  # fmt: skip
    yield Kind("choice of what to build", "run", built[0].save, built[1].save, settle)
    for suffix in ("npz", "csv"):
        yield Kind(
            f"scenarios {suffix}", f"storms.{suffix}", first.scenarios.save, second.scenarios.save,
            lambda path: path.read_bytes(),
        )  # fmt: skip
    yield Kind("case", "mine.toml", None, new_case, rs.load_case)
    yield measured_case()
    yield from reproductions()
    # The first drawing settles the layout: those after it are the same to the letter.
    figures = [rs.plot_plan(drawn, sources / "first.png") for drawn in (other, plan)]
    yield Kind(
        "picture", "plan.png", partial(write_figure, figures[0]), partial(write_figure, figures[1]),
        lambda path: path.read_bytes(),
    )  # fmt: skip


def new_case(path: Path) -> None:
    """The starter case of a network, as the command writes it."""
    from resilience.cli.case import new

    with redirect_stdout(io.StringIO()):
        new("case9", path)


def measured_case() -> Kind:
    """A case that follows measured series, with its profiles: whoever reads it reads both."""
    times = pd.date_range("2022-06-30 22:00", periods=4 * 96, freq="15min", tz="UTC")
    rising = np.arange(3.0, 3.0 + len(times))
    series = [Measured(times, 15.0, {"load": mw, "solar": mw}) for mw in (rising, rising**2)]
    earlier, later = (partial(write_measured_case, "ieee33", measured) for measured in series)

    def seen(place: Path) -> Any:
        file = place / "case.toml"
        try:
            return rs.load_case(file).profile("load").tolist() if file.is_file() else None
        except rs.ResilienceError as error:
            return str(error)

    return Kind("measured case", "mine", earlier, later, seen, seen)


def reproductions() -> Iterator[Kind]:
    """The summary and table of a reproduction, and the figures of an experiment."""
    from resilience.evaluation.measures.intervals import MeanInterval
    from resilience.rl.reproduce.experiments import QUICK
    from resilience.rl.reproduce.figures import Figures
    from resilience.rl.reproduce.outage_day import OutageDay
    from resilience.rl.reproduce.outcomes import Outcome
    from resilience.rl.reproduce.run import Reproduction

    interval = MeanInterval(12.5, 11.25, 13.5, 0.95, 3)
    rows = tuple(
        Figures(label, 3, {"average": interval}, 7.0, 0.5, 0.0125, 6.75, 0.875, None)
        for label in ("rule 0.5", "rule 0.9")
    )
    outcomes = [
        Outcome(name, "title", "", "small", ("setting",), rows, "telling") for name in ("a", "b")
    ]
    first, second = (
        Reproduction("small", QUICK, (o,), (), OutageDay("storm", "rule", 3, ()), Path("nowhere"))
        for o in outcomes
    )
    yield Kind(
        "reproduction", "run", lambda path: replace(first, folder=path).save(),
        lambda path: replace(second, folder=path).save(), settle,
    )  # fmt: skip
    earlier, later = (partial(save_part, values=outcome.plain()) for outcome in outcomes)
    yield Kind("part of a reproduction", "methods.json", earlier, later, load_part)


def comparisons(sources: Path) -> Iterator[Kind]:
    """A comparison over another one with its parts, and such a part."""
    world = replace(small_world(), outlook=None)
    sources.mkdir(parents=True, exist_ok=True)
    first = rs.evaluate(world, ["greedy"], out=sources / "run")
    second = rs.evaluate(world, ["idle", "greedy"])

    def earlier(place: Path) -> None:
        if not place.is_dir():
            shutil.copytree(sources / "run" / PARTS_FOLDER, place / PARTS_FOLDER)
        first.save(place)

    yield Kind("comparison", "run", earlier, second.save, rs.load_comparison)
    idle, greedy = (partial(save_trajectory, second.trajectories[n]) for n in ("idle", "greedy"))
    yield Kind("part of a comparison", "greedy.npz", idle, greedy, load_trajectory)


if __name__ == "__main__":
    main(Path(sys.argv[1]), float(sys.argv[2]) if len(sys.argv) > 2 else 1.0, sys.argv[3:])
