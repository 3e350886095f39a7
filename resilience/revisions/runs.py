"""`diff`: two plans, or two comparisons, and what is different in case, figures and actions."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from resilience.case import Case
from resilience.errors import UsageError
from resilience.evaluation.comparison import is_comparison, load_comparison
from resilience.files import reading
from resilience.planning.plan import Plan, load_plan
from resilience.planning.reading.instructions import Instruction
from resilience.planning.records import CertifiedPlan
from resilience.planning.scenarios.files import holds_scenario_plan, load_scenario_plan
from resilience.planning.scenarios.plan import ScenarioPlan
from resilience.results import COMPARISON, PLAN, SCENARIO_PLAN, SUMMARY_FILE
from resilience.revisions.cases import KeyChange, case_changes

SAME, UNSEEN = 1e-6, 5e-5
"""Difference up to which figures are the same: a share of them, or less than is printed."""
SAME_MW, SAME_POWER = 1e-4, 0.01
"""The same of powers that somebody is asked for: MW, or a share of the greater."""
METHOD_FIGURES = {
    "cost_per_day": ("cost", "$/day"),
    "shed_mwh_per_day": ("shed", "MWh/day"),
    "gap_percent": ("gap", "%"),
    "worst_per_day": ("worst episode", "$/day"),
    "critical_served_percent": ("critical loads served", "%"),
}
"""Columns of a comparison that are held against each other, with their words and units."""


@dataclass(frozen=True)
class FigureChange:
    """A figure of both results.

    Attributes:
        name: of what.
        unit: of the values.
        before, after: None where a result has no such figure.
    """

    name: str
    unit: str
    before: float | None
    after: float | None

    @property
    def change(self) -> float | None:
        """After less before; None where one of them is missing."""
        if self.before is None or self.after is None:
            return None
        return self.after - self.before

    @property
    def differs(self) -> bool:
        """Whether it is another figure, beyond rounding."""
        if self.before is None or self.after is None:
            return self.before != self.after
        size = max(abs(self.before), abs(self.after))
        return abs(self.after - self.before) > max(SAME * size, UNSEEN)


@dataclass(frozen=True)
class ActionChange:
    """What one unit is asked to do otherwise.

    Attributes:
        do: the verb.
        unit: who.
        before, after: from when to when at how many MW, as text; empty where nothing is asked.
    """

    do: str
    unit: str
    before: tuple[str, ...]
    after: tuple[str, ...]


@dataclass(frozen=True)
class RunDiff:
    """Two results of one kind held against each other.

    Attributes:
        before, after: what they are called, as a rule their folders.
        kind: of both.
        case: keys of the cases that differ.
        figures: that both, or one of them, have, the most important first.
        actions: that differ; none of comparisons.
        shed_by_load: MWh of every load of which either sheds anything.
    """

    before: str
    after: str
    kind: str
    case: tuple[KeyChange, ...]
    figures: tuple[FigureChange, ...]
    actions: tuple[ActionChange, ...] = ()
    shed_by_load: tuple[FigureChange, ...] = ()

    def summary(self) -> dict[str, Any]:
        """Everything as plain data; `change` is after less before."""

        def rows(figures: Iterable[FigureChange]) -> list[dict[str, Any]]:
            return [{**asdict(figure), "change": figure.change} for figure in figures]

        return {
            "before": self.before,
            "after": self.after,
            "kind": self.kind,
            "case": [asdict(change) for change in self.case],
            "figures": rows(self.figures),
            "actions": [asdict(change) for change in self.actions],
            "shed_by_load": rows(self.shed_by_load),
        }


def diff(before: str | Path | CertifiedPlan, after: str | Path | CertifiedPlan) -> RunDiff:
    """What is different between two plans, or two comparisons.

    Args:
        before: a folder that `solve --out` or `compare --out` wrote, or a plan.
        after: likewise, of the same kind.

    Raises:
        UsageError: a folder without such a result, results of two kinds, or a plan that was kept
            without its case.
    """
    old, new = (_run(run, word) for run, word in ((before, "before"), (after, "after")))
    if old.kind != new.kind:
        raise UsageError(
            f"{old.name} is a {old.kind}, {new.name} a {new.kind}; allowed: two of one kind",
            hint="plans, plans over scenarios and comparisons each have figures of their own",
        )
    return RunDiff(
        before=old.name,
        after=new.name,
        kind=old.kind,
        case=tuple(case_changes(old.case, new.case)),
        figures=_joined(old.figures, new.figures),
        actions=_actions(old, new),
        shed_by_load=_joined(old.shed, new.shed, missing=0.0),
    )


Figures = Mapping[tuple[str, str], float]
"""Figures by name and unit."""


@dataclass(frozen=True)
class _Run:
    """One of the two results, as far as it is compared."""

    name: str
    kind: str
    case: Case
    figures: Figures
    shed: Figures
    plan: CertifiedPlan | None = None


def _run(run: str | Path | CertifiedPlan, word: str) -> _Run:
    if isinstance(run, CertifiedPlan):
        return _of_plan(run, word)
    folder = Path(run)
    if is_comparison(folder):
        return _of_comparison(folder)
    if holds_scenario_plan(folder):
        return _of_plan(load_scenario_plan(folder), str(folder))
    return _of_plan(load_plan(folder), str(folder))


def _of_plan(plan: CertifiedPlan, name: str) -> _Run:
    if plan.case is None:
        raise UsageError(
            f"{name} was kept without its case; allowed: a plan with it",
            hint="keep case.toml beside it",
        )
    figures = {("objective", "$"): plan.objective}
    if plan.certificate.bound is not None:
        figures["proven bound", "$"] = plan.certificate.bound
    figures["operating cost", "$"] = plan.totals.operating_cost
    figures["worth of the energy left", "$"] = plan.totals.terminal_credit
    shed: dict[tuple[str, str], float] = {}
    if isinstance(plan, Plan):
        figures["shed", "MWh"] = plan.shed_mwh
        figures |= {(f"cost {term}", "$"): spent for term, spent in plan.costs.items()}
        for load, reasons in plan.shed_by_load.items():
            shed[load, "MWh"] = sum(reasons.values())
        return _Run(name, PLAN.name, plan.case, figures, shed, plan)
    if isinstance(plan, ScenarioPlan):
        figures["expected shedding", "MWh"] = plan.expected_shed_mwh
        figures["probability of shedding", "%"] = 100.0 * plan.shed_probability
        figures["worst scenario", "$"] = plan.worst_cost
        figures["mean of the worst 5 %", "$"] = plan.cvar_95_cost
    return _Run(name, SCENARIO_PLAN.name, plan.case, figures, shed, plan)


def _of_comparison(folder: Path) -> _Run:
    compared = load_comparison(folder)
    figures: dict[tuple[str, str], float] = {}
    with reading(folder / SUMMARY_FILE, "summary of a comparison"):
        summary = json.loads((folder / SUMMARY_FILE).read_text(encoding="utf-8"))
        for row in summary["methods"]:
            for column, (words, unit) in METHOD_FIGURES.items():
                if row.get(column) is not None:
                    figures[f"{row['method']}: {words}", unit] = float(row[column])
    return _Run(str(folder), COMPARISON.name, compared.case, figures, {})


def _joined(old: Figures, new: Figures, missing: float | None = None) -> tuple[FigureChange, ...]:
    """Figures of both; `missing`: what one that is not there stands for."""
    keys = dict.fromkeys([*old, *new])
    return tuple(
        FigureChange(name, unit, old.get((name, unit), missing), new.get((name, unit), missing))
        for name, unit in keys
    )


def _actions(old: _Run, new: _Run) -> tuple[ActionChange, ...]:
    """By verb and unit, in the order of the second plan."""
    before, after = _instructions(old), _instructions(new)
    keys = dict.fromkeys([*after, *before])
    pairs = {key: (before.get(key, []), after.get(key, [])) for key in keys}
    return tuple(
        ActionChange(do, unit, _texts(old.case, earlier), _texts(new.case, later))
        for (do, unit), (earlier, later) in pairs.items()
        if not _alike(earlier, later)
    )


def _instructions(run: _Run) -> dict[tuple[str, str], list[Instruction]]:
    """What every unit is asked to do, by verb and unit."""
    grouped: dict[tuple[str, str], list[Instruction]] = {}
    for item in run.plan.instructions() if run.plan is not None else ():
        grouped.setdefault((item.verb, item.unit), []).append(item)
    return grouped


def _alike(earlier: list[Instruction], later: list[Instruction]) -> bool:
    """Whether both ask for the same times, and for powers that nobody could tell apart."""
    if [(a.first, a.stop) for a in earlier] != [(b.first, b.stop) for b in later]:
        return False
    powers = [
        (p, q)
        for a, b in zip(earlier, later, strict=True)
        for p, q in ((a.low_mw, b.low_mw), (a.high_mw, b.high_mw))
        if not math.isnan(p)  # of switches
    ]
    return all(math.isclose(p, q, rel_tol=SAME_POWER, abs_tol=SAME_MW) for p, q in powers)


def _texts(case: Case, items: list[Instruction]) -> tuple[str, ...]:
    """From when to when, and at how many MW."""
    return tuple(_text(case, item) for item in items)


def _text(case: Case, item: Instruction) -> str:
    text = case.window.label(item.first)
    if item.stop > item.first:
        text += f"–{case.window.end_label(item.stop)}"
    if math.isnan(item.high_mw):
        return text
    low, high = (f"{mw:.3g}" for mw in (item.low_mw, item.high_mw))
    return f"{text} {low if low == high else f'{low} to {high}'} MW"
