"""The page of two results held against each other."""

from __future__ import annotations

from collections.abc import Iterable

from resilience.pages.document import number, render
from resilience.revisions.runs import FigureChange, RunDiff
from resilience.text.revision import figure_rows


def diff_page(difference: RunDiff) -> str:
    """The page as text."""
    return render(
        "diff.html.j2",
        difference.summary(),
        {"charts": {}},
        title=f"{difference.before} against {difference.after}",
        difference=difference,
        verdict=_verdict(difference),
        figures=[
            (f"{name}, {unit}", *cells) for name, unit, *cells in _changed(difference.figures)
        ],
        same=[figure.name for figure in difference.figures if not figure.differs],
        shed=[(name, *cells) for name, _, *cells in _changed(difference.shed_by_load)],
    )


def _changed(figures: Iterable[FigureChange]) -> list[tuple[str, ...]]:
    return figure_rows(figure for figure in figures if figure.differs)


def _verdict(difference: RunDiff) -> list[str]:
    keys = len(difference.case)
    case = f"{keys} key{'s' * (keys != 1)} of the case differ{'s' * (keys == 1)}."
    sentences = [case if keys else "The cases are the same."]
    by_name = {figure.name: figure for figure in difference.figures}
    for name in ("objective", "shed", "expected shedding"):
        if name in by_name:
            sentences.append(_sentence(by_name[name]))
    actions = len(difference.actions)
    if actions:
        sentences.append(f"{actions} of the things to do are others.")
    return sentences


def _sentence(figure: FigureChange) -> str:
    if not figure.differs or figure.change is None:
        return f"{figure.name.capitalize()} is the same."
    way = "rises" if figure.change > 0 else "falls"
    return (
        f"{figure.name.capitalize()} {way} by {number(abs(figure.change), 3)} {figure.unit}, from "
        f"{number(figure.before, 3)} to {number(figure.after, 3)}."
    )
