"""What to build before the storm, on the terminal: the plan, what it saves, and beside what."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from resilience.planning.hardening.draws import StrengthOption
from resilience.planning.hardening.program import Option
from resilience.planning.hardening.report import Hardening
from resilience.planning.hardening.sites import UnitOption
from resilience.text.grid import grid
from resilience.text.plan import percent

if TYPE_CHECKING:
    from rich.console import Console


def print_hardening(hardening: Hardening, console: Console) -> None:
    """Prints what to build, what each part of it saves, and how all of it does in new storms."""
    from rich.text import Text

    h = hardening
    head = f"  {h.storms} storms, seed {h.seed}, {h.risk}"
    console.print(Text.assemble((h.case.name, "bold"), head), highlight=False)
    console.print(_verdict(h), highlight=False)
    unit = "$" if h.years is None else "$/year"
    heads = ("", "cost $", "fails", f"alone {unit}", f"last {unit}")
    console.print(grid("what to build", _chosen(h), *heads))
    title = "a storm that the plan has not seen"
    console.print(grid(title, _judged(h), "", *_shown(h)), highlight=False)
    if len(h.season.names) > 1:
        columns = ("", "a year", "nothing $", "plan $")
        console.print(grid("a storm of each, on average", _by_storm(h), *columns))
    if len(h.frontier) > 1:
        heads = ("budget $", "spent $", f"objective {unit}", f"proven {unit}", "built")
        console.print(grid("other budgets", _frontier(h), *heads))
    for line in (*_remarks(h), *h.notes):
        console.print(line, highlight=False)


def _verdict(h: Hardening) -> str:
    limit = f" of {h.budget:,.10g} $" if math.isfinite(h.budget) else ""
    unit = "$" if h.years is None else "$ a year"
    shortfall = "" if h.status == "optimal" else f", {percent(h.wanted_gap)} wanted"
    return (
        f"{len(h.chosen)} of {len(h.options)} options for {h.cost:,.10g} ${limit}: "
        f"objective {h.choice.value:.2f} {unit}, bound {h.choice.bound:.2f} {unit}, "
        f"gap {percent(h.choice.gap)}{shortfall}"
    )


def _chosen(h: Hardening) -> list[tuple[str, ...]]:
    """What is built, what saves most beside the others first."""
    order = sorted(np.flatnonzero(h.choice.chosen), key=lambda k: -h.beside[k])
    return [
        (
            _words(h.options[k]),
            f"{h.options[k].cost:,.10g}",
            "" if np.isnan(h.fails[k]) else f"{h.fails[k]:.1%}",
            "" if np.isnan(h.alone[k]) else f"{h.alone[k]:.2f}",
            f"{h.beside[k]:.2f}",
        )
        for k in order
    ]


def _words(option: Option) -> str:
    """Its name, and of a unit what it is and where."""
    return f"{option.label}, {option.place}" if isinstance(option, UnitOption) else option.label


def _shown(h: Hardening) -> list[str]:
    """Names of the sets; greedy only where it is not the plan."""
    same = (h.sets["greedy"] == h.sets["plan"]).all()
    return [name for name in h.sets if name != "greedy" or not same]


MEASURED = {
    "cost, $": ("cost", 0),
    "not served, MWh": ("shed_mwh", 1),
    "critical, MWh": ("critical_mwh", 1),
    "critical, h": ("critical_h", 1),
    "a customer, h": ("customer_h", 2),
    "saved, $": ("saved", 0),
}
"""By its words, a column of `Hardening.comparison` and the digits to show."""


def _judged(h: Hardening) -> list[tuple[str, ...]]:
    """A row per measure, a column per set."""
    rows_by_set = {str(name): row for name, row in h.comparison().iterrows()}
    table = [
        {str(key): float(value) for key, value in rows_by_set[name].items()} for name in _shown(h)
    ]
    rows: list[tuple[str, ...]] = [("options", *(f"{row['built']:.0f}" for row in table))]
    for words, (column, digits) in MEASURED.items():
        pairs = [(row[column], row[f"{column}_error"]) for row in table]
        if np.isnan([value for value, _ in pairs]).all():
            continue  # nobody knows: no load says how many customers it has
        rows.append((words, *(_with_error(*pair, digits) for pair in pairs)))
    worst = f"worst {100 * (1 - h.risk.alpha):.3g} %, $"
    rows.insert(2, (worst, *(f"{row['cvar']:.0f}" for row in table)))
    return [*rows, *_of_a_year(h)]


def _of_a_year(h: Hardening) -> list[tuple[str, ...]]:
    """What is built and what storms cost in a year, where it is said how many come."""
    if h.years is None:
        return []
    table = h.yearly().loc[_shown(h)]
    net = [_with_error(*pair, 0) for pair in zip(table["saved"], table["saved_error"], strict=True)]
    return [
        ("built, $/year", *(f"{value:.0f}" for value in table["built"])),
        ("storms, $/year", *(f"{value:.0f}" for value in table["storms"])),
        ("saved net, $/year", *net),
    ]


def _with_error(value: float, error: float, digits: int) -> str:
    shown = f"{value:.{digits}f}"
    return shown if math.isnan(error) or not error else f"{shown} ± {error:.{digits}f}"


def _by_storm(h: Hardening) -> list[tuple[str, ...]]:
    return [
        (str(name), f"{row['per_year']:g}", f"{row['nothing']:.0f}", f"{row['plan']:.0f}")
        for name, row in h.by_storm().iterrows()
    ]


def _frontier(h: Hardening) -> list[tuple[str, ...]]:
    return [
        (
            f"{budget:,.10g}" if math.isfinite(float(str(budget))) else "any",
            f"{row['spent']:,.10g}",
            f"{row['value']:.2f}",
            f"{row['bound']:.2f}",
            str(row["built"]),
        )
        for budget, row in h.frontier_frame().iterrows()
    ]


def _remarks(h: Hardening) -> list[str]:
    sample, unseen = h.in_sample["plan"], h.out_of_sample["plan"]
    same = (h.sets["greedy"] == h.sets["plan"]).all()
    greedy = "finds the same" if same else "takes another way"
    lines = [
        f"± is the standard error over {h.new_storms} storms, seed {h.new_seed}; what is saved is "
        f"paired, storm by storm. naive: the lines most likely to fail; greedy, what saves most "
        f"per $ one by one, {greedy}.",
        f"The storms that the plan was made for cost {sample.value(h.risk):.1f} $ with it, new "
        f"ones {unseen.value(h.risk):.1f} $: a plan may look better where it was chosen.",
        f"With as many crews as needed the former would cost {h.without_crews:.1f} $.",
    ]
    best, unit = h.next_best, "$" if h.years is None else "$ a year, its own cost paid"
    if best is not None:
        saved = float(h.beside[h.options.index(best)])
        lines.append(
            f"Next best: {_words(best)} for {best.cost:,.10g} $ would save {saved:.2f} {unit}."
        )
    return [*lines, *_left_alone(h)]


def _left_alone(h: Hardening) -> list[str]:
    """What the line that fails most often would save, where it is not built."""
    k = int(np.argmax(np.nan_to_num(h.fails)))
    option = h.options[k]
    built = {chosen.line for chosen in h.chosen if isinstance(chosen, StrengthOption)}
    if not isinstance(option, StrengthOption) or option.line in built:
        return []
    head = f"{option.line} fails most often, in {h.fails[k]:.0%} of storms, and is not built"
    unit = "$" if h.years is None else "$ a year"
    alone, beside = h.alone[k], h.beside[k]
    if max(alone, beside) < 0.0:
        return [f"{head}: it would cost {-max(alone, beside):.2f} {unit} more than it saves."]
    return [
        f"{head}: it would save {alone:.2f} {unit} alone and {beside:.2f} {unit} beside the plan, "
        "as sources behind it stand in for it, or other lines fail with it."
    ]
