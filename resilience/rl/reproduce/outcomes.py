"""One experiment, run or read: its world, its contenders, its figures."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from resilience.case import Case
from resilience.case.days import held_out
from resilience.digest import code, digest_of
from resilience.dispatch.registry import POLICY_FILE, REFERENCE, Factory, factory_of
from resilience.errors import UsageError
from resilience.evaluation.compare import evaluate
from resilience.evaluation.comparison import BOUND
from resilience.evaluation.report import Report
from resilience.evaluation.verdict import verdict
from resilience.fragility.draw import sample_case
from resilience.parts import load_part, save_part
from resilience.progress import phase
from resilience.rl.failed import with_failed
from resilience.rl.reproduce.experiments import Contender, Effort, Experiment
from resilience.rl.reproduce.figures import Figures, figures
from resilience.rl.reproduce.trained import is_finished, seed_folders, trained_runs
from resilience.rl.training.curves import load_curves
from resilience.simulation.forecast import lasting_outlook
from resilience.simulation.world import World, microgrid_with_fallible_lines

STORM_SEED = 0
FIGURES_FOLDER, RUNS_FOLDER = "figures", "runs"
WITHOUT_EFFECT = frozenset(("path", "source", "rebuild"))
"""Fields of a case that say where it comes from."""


@dataclass(frozen=True)
class Outcome:
    """What came out of an experiment.

    Attributes:
        name: of the experiment.
        title: what it is about.
        variant: what sets it apart from those of the same title.
        case: name of the case.
        setting: the rules, in words.
        rows: the contenders, then the rule 0.9 and the clairvoyant.
        telling: whether the case can tell methods apart, in words.
        notes: what was left out, in words.
    """

    name: str
    title: str
    variant: str
    case: str
    setting: tuple[str, ...]
    rows: tuple[Figures, ...]
    telling: str
    notes: tuple[str, ...] = ()

    def plain(self) -> dict[str, Any]:
        """As plain data for JSON."""
        return {**asdict(self), "rows": [row.plain() for row in self.rows]}

    @classmethod
    def of_plain(cls, data: Mapping[str, Any]) -> Outcome:
        """From what `plain` gave."""
        tuples = {name: tuple(data[name]) for name in ("setting", "notes")}
        rows = tuple(Figures.of_plain(row) for row in data["rows"])
        return cls(**{**data, **tuples, "rows": rows})


@dataclass(frozen=True)
class Entrant:
    """A contender that is ready to act.

    Attributes:
        contender: which.
        factories: by name in the comparison, one per training.
        runs: folders of its trainings; empty where there are none.
        training_cpu_s: of one training, mean; None where there is none.
    """

    contender: Contender
    factories: Mapping[str, Factory]
    runs: tuple[Path, ...] = ()
    training_cpu_s: float | None = None


def outcome(case: Case, experiment: Experiment, scale: Effort, folder: Path) -> Outcome:
    """Runs an experiment; what of its trainings is missing is trained.

    Args:
        case: the experiment's, without its changes.
        experiment: which.
        scale: how much is spent.
        folder: where trainings and figures are.
    """
    case = changed(case, experiment)
    acting, absent = _in_case(case, experiment)
    entrants = [entrant(case, contender, experiment, scale, folder) for contender in acting]
    with phase(f"experiment {experiment.name}"):
        makers = {name: make for e in entrants for name, make in e.factories.items()}
        report = evaluate(world(case, experiment, scale), makers, ac=True)
    result = Outcome(
        experiment.name,
        experiment.title,
        experiment.variant,
        case.name,
        report.setting,
        _rows(report, entrants),
        verdict(report)[-1] if experiment.recourse == "economic" else "",
        tuple(
            f"{contender.label}: left out, {case.name} has {len(case.ess)} agents"
            for contender in absent
        ),
    )
    save_part(_figures_path(case, experiment, scale, folder, entrants), result.plain())
    return result


def stored_outcome(
    case: Case, experiment: Experiment, scale: Effort, folder: Path
) -> Outcome | None:
    """What `outcome` gave before; None where it, or a training it is of, is not there."""
    case = changed(case, experiment)
    acting, _ = _in_case(case, experiment)
    runs = [run for c in acting for run in contender_runs(case, c, experiment, scale, folder)]
    if not all(map(is_finished, runs)):
        return None
    entrants = [entrant(case, contender, experiment, scale, folder) for contender in acting]
    stored = load_part(_figures_path(case, experiment, scale, folder, entrants))
    return None if stored is None else Outcome.of_plain(stored)


def _in_case(case: Case, experiment: Experiment) -> tuple[list[Contender], list[Contender]]:
    """The contenders with agents left in the case, and those without."""
    contenders, n = experiment.contenders, len(case.ess)
    return [c for c in contenders if c.failed < n], [c for c in contenders if c.failed >= n]


def _figures_path(
    case: Case, experiment: Experiment, scale: Effort, folder: Path, entrants: list[Entrant]
) -> Path:
    digest = experiment_digest(case, experiment, scale, entrants)
    return folder / FIGURES_FOLDER / f"{experiment.name}-{digest}.json"


def experiment_digest(
    case: Case, experiment: Experiment, scale: Effort, entrants: Sequence[Entrant]
) -> str:
    """Of all that an outcome depends on: code, case, its test days, scale, and policies."""
    policies = [
        hashlib.sha256((run / POLICY_FILE).read_bytes()).hexdigest()
        for e in entrants
        for run in e.runs
    ]
    facts = [code(), experiment, scale, held_out(case, scale.days), policies]
    return digest_of(facts, WITHOUT_EFFECT)[:12]


def _rows(report: Report, entrants: list[Entrant]) -> tuple[Figures, ...]:
    rows = [
        figures(report, e.contender.label, list(e.factories), e.training_cpu_s, e.contender.paper)
        for e in entrants
    ]
    return (*rows, *(figures(report, name, [name]) for name in (REFERENCE, BOUND)))


def changed(case: Case, experiment: Experiment) -> Case:
    """The case with the changes of an experiment."""
    price = experiment.shed_cost_per_mwh
    if price is None or all(load.shed_cost_per_mwh == price for load in case.load):
        return case
    loads = [load.model_copy(update={"shed_cost_per_mwh": price}) for load in case.load]
    return case.replace(load=loads)


def world(case: Case, experiment: Experiment, scale: Effort, episodes: int | None = None) -> World:
    """The world of an experiment, over its test days.

    Args:
        case: with the changes of the experiment.
        experiment: which.
        scale: how many days and storms.
        episodes: only the first storms; None: all.
    """
    case = held_out(case, scale.days)
    storms = sample_case(case, scale.draws, STORM_SEED)
    if episodes is not None:
        storms = storms.chosen(np.arange(episodes))
    is_off = experiment.load != 0.0 or experiment.pv != 0.0
    outlook = lasting_outlook(case, experiment.load, experiment.pv, storms.n) if is_off else None
    return World.build(
        microgrid_with_fallible_lines(case, storms, "copperplate"),
        storms,
        outlook=outlook,
        recourse=experiment.recourse,
    )


def entrant(
    case: Case, contender: Contender, experiment: Experiment, scale: Effort, folder: Path
) -> Entrant:
    """A contender ready to act, trained where it learns.

    Raises:
        UsageError: a case that nothing can be trained on.
    """
    if not contender.learns:
        return Entrant(contender, {contender.label: factory_of(contender.dispatcher)})
    runs = trained_runs(case, contender, scale, _seeds(experiment, scale), folder / RUNS_FOLDER)
    units = [unit.name for unit in case.ess[: contender.failed]]
    factories: dict[str, Factory] = {}
    for seed, run in enumerate(runs):
        make = factory_of(f"{contender.dispatcher}:{run}")
        factories[f"{contender.label} #{seed}"] = with_failed(make, units) if units else make
    seconds = [curve.cpu_s[-1] for run in runs for curve in load_curves(run)]
    if not seconds:
        raise UsageError(f"{runs[0].parent} holds no finished training", hint="delete it")
    return Entrant(contender, factories, tuple(runs), float(np.mean(seconds)))


def contender_runs(
    case: Case, contender: Contender, experiment: Experiment, scale: Effort, folder: Path
) -> list[Path]:
    """Where a contender's trainings are, or will be; arguments as for `entrant`."""
    if not contender.learns:
        return []
    return seed_folders(case, contender, scale, _seeds(experiment, scale), folder / RUNS_FOLDER)


def _seeds(experiment: Experiment, scale: Effort) -> int:
    return scale.variant_seeds if experiment.trains_anew else scale.seeds
