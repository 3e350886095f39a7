"""`reproduce`: all experiments of the source paper on one case, each run once and then read.

DIR/summary.json      every figure with its interval, and what the paper prints
DIR/statistics.csv    the same, a row per experiment, method and figure
DIR/figures/          an experiment each, called after a digest of all that it depends on
DIR/runs/             trainings, likewise; `resilience plot` draws their learning curves
DIR/storm-DIGEST/     the comparison that the day with an outage is from
DIR/case/             the case and its profiles, where measured ones are asked for
"""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from resilience.case import Case, load_case
from resilience.case.measured.series import Measured, read_measured, write_measured_case
from resilience.progress import interruptible, notice, phase
from resilience.results import REPRODUCTION, check_replaceable, replacing, write_summary
from resilience.rl.reproduce.experiments import (
    EXPERIMENTS,
    FULL,
    METHODS,
    QUICK,
    Effort,
    Experiment,
)
from resilience.rl.reproduce.outage_day import OutageDay, outage_day
from resilience.rl.reproduce.outcomes import Outcome, entrant, outcome, stored_outcome
from resilience.rl.reproduce.published import OPEN
from resilience.rl.training.curves import load_curves

TABLE_FILE, CASE_FOLDER = "statistics.csv", "case"


@dataclass(frozen=True)
class LearningSummary:
    """How the trainings of a learner went, on validation days; gaps are over the bound there.

    Attributes:
        label: whose.
        runs: folder of the trainings, a `seed-K` in it each.
        cpu_s: of one training, mean.
        first_gap, best_gap, last_gap: relative, the median of the trainings: of the first
            validation, of the best one, which is what acts, and of the last one.
        worst_gap: the best of the worst training.
    """

    label: str
    runs: str
    cpu_s: float
    first_gap: float
    best_gap: float
    last_gap: float
    worst_gap: float


@dataclass(frozen=True)
class Reproduction:
    """What came out of all experiments.

    Attributes:
        case: name of the case.
        scale: how much was spent.
        outcomes: of the experiments, in their order.
        learning: of the learners.
        storm: a day with an outage.
        folder: where everything is.
        notes: what was done to profiles, in words.
    """

    case: str
    scale: Effort
    outcomes: tuple[Outcome, ...]
    learning: tuple[LearningSummary, ...]
    storm: OutageDay
    folder: Path
    notes: tuple[str, ...] = ()

    def summary(self) -> dict[str, Any]:
        """As plain data for JSON."""
        return {
            "case": self.case,
            "scale": asdict(self.scale),
            "experiments": [outcome.plain() for outcome in self.outcomes],
            "learning": [asdict(curve) for curve in self.learning],
            "storm": asdict(self.storm),
            "open": [dict(zip(("setting", "paper", "here"), row, strict=True)) for row in OPEN],
            "notes": list(self.notes),
        }

    def rows(self) -> Iterator[dict[str, Any]]:
        """An entry per experiment, method and figure."""
        for result in self.outcomes:
            for row in result.rows:
                for name, value in row.statistics.items():
                    yield {
                        "experiment": result.name,
                        "method": row.label,
                        "runs": row.runs,
                        "figure": name,
                        "mean": value.mean,
                        "low": value.low,
                        "high": value.high,
                        "paper": row.published(name),
                    }

    def save(self) -> None:
        """Writes `summary.json` and `statistics.csv`, both or none."""
        rows = list(self.rows())
        with replacing(self.folder, REPRODUCTION) as target:
            write_summary(target, REPRODUCTION, self.summary())
            with (target / TABLE_FILE).open("w", encoding="utf-8", newline="") as file:
                writer = csv.DictWriter(file, list(rows[0]))
                writer.writeheader()
                writer.writerows(rows)


def reproduce(
    case: str | Path = "ieee33",
    *,
    quick: bool = False,
    profiles: Sequence[str | Path] = (),
    area: str | None = None,
    out: str | Path = "reproduction",
    scale: Effort | None = None,
    experiments: Sequence[Experiment] | None = None,
    save: bool = True,
) -> Reproduction:
    """Runs the source paper's experiments; what was run before is read.

    Args:
        case: the case, by name or file; the mesh is a case of its own.
        quick: few days, storms and seeds, and half of the paper's training.
        profiles: exports of ENTSO-E with load and solar power, in place of the case's profiles.
        area: where they have several.
        out: folder for everything.
        scale: how much is spent, in place of `quick`.
        experiments: which; all of the paper's if omitted.
        save: whether `summary.json` and `statistics.csv` are written, too, once all is there.

    Raises:
        CaseError: the case has mistakes.
        UsageError: profiles that cannot be read, a case that nothing can be trained on, or a folder
            that is a file or holds a result of another kind.
        FileError: a folder that cannot be written to.
    """
    folder, scale = Path(out), scale or (QUICK if quick else FULL)
    check_replaceable(folder, REPRODUCTION)
    experiments = EXPERIMENTS if experiments is None else experiments
    with interruptible(lambda: f"what is finished is in {folder}; the same command goes on"):
        result = _reproduction(case, profiles, area, folder, scale, experiments)
        if save:
            result.save()
    return result


def _reproduction(
    case: str | Path,
    profiles: Sequence[str | Path],
    area: str | None,
    folder: Path,
    scale: Effort,
    experiments: Sequence[Experiment],
) -> Reproduction:
    """What `reproduce` returns; arguments as there."""
    notes: list[str] = []
    cases = {
        name: load_case(_followed(name, profiles, area, folder, notes) if profiles else name)
        for name in dict.fromkeys([str(case), *(e.case for e in experiments if e.case)])
    }
    asked_for = cases[str(case)]
    with phase("experiments"):
        pairs = [(cases[e.case or str(case)], e) for e in experiments]
        outcomes = _outcomes(pairs, scale, folder)
    return Reproduction(
        case=asked_for.name,
        scale=scale,
        outcomes=outcomes,
        learning=tuple(
            _learning(entrant(asked_for, c, METHODS, scale, folder).runs, c.label, folder)
            for c in METHODS.contenders
            if c.learns
        ),
        storm=outage_day(asked_for, scale, folder),
        folder=folder,
        notes=tuple(dict.fromkeys(notes)),
    )


def _outcomes(
    pairs: Sequence[tuple[Case, Experiment]], scale: Effort, folder: Path
) -> tuple[Outcome, ...]:
    """Of every experiment in its case; those that are there are read first, and counted."""
    done: dict[int, Outcome] = {}

    def share() -> str:
        return f"{len(done)} of {len(pairs)} experiments are in {folder}"

    with interruptible(lambda: f"{share()}; the same command goes on"):
        for k, (case, experiment) in enumerate(pairs):
            if (stored := stored_outcome(case, experiment, scale, folder)) is not None:
                done[k] = stored
        if done:
            notice(share() if len(done) == len(pairs) else f"{share()}; the others are run")
        for k, (case, experiment) in enumerate(pairs):
            if k not in done:
                done[k] = outcome(case, experiment, scale, folder)
    return tuple(done[k] for k in range(len(pairs)))


def _followed(
    name: str, profiles: Sequence[str | Path], area: str | None, folder: Path, notes: list[str]
) -> Path:
    """File of the case that follows measured profiles; what was done to them goes to `notes`."""
    measured: Measured = read_measured(profiles, load_case(name).step_min, area)
    notes += measured.notes
    notes.append(
        f"profiles: {', '.join(map(str, profiles))}, each per unit of its maximum, the same shape "
        "for all loads and for all PV"
    )
    return write_measured_case(name, measured, folder / CASE_FOLDER / Path(name).stem)


def _learning(runs: Sequence[Path], label: str, folder: Path) -> LearningSummary:
    curves = [curve for run in runs for curve in load_curves(run)]
    gaps: Mapping[str, list[float]] = {
        "first": [float(curve.gap[0]) for curve in curves],
        "best": [float(curve.gap.min()) for curve in curves],
        "last": [float(curve.gap[-1]) for curve in curves],
    }
    return LearningSummary(
        label=label,
        runs=str(runs[0].parent.relative_to(folder)),
        cpu_s=float(np.mean([curve.cpu_s[-1] for curve in curves])),
        first_gap=float(np.median(gaps["first"])),
        best_gap=float(np.median(gaps["best"])),
        last_gap=float(np.median(gaps["last"])),
        worst_gap=max(gaps["best"]),
    )
