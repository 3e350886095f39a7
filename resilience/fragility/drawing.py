"""`scenarios`: storms for a case, as many as wanted, reduced to a few if that is asked for."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from resilience.fragility.draw import draw
from resilience.fragility.outages.reduction import load_behind_mw, reduced
from resilience.fragility.storm_means import moments

if TYPE_CHECKING:
    from resilience.case import Case
    from resilience.fragility.outages.bell import BellSettings
    from resilience.fragility.outages.scenarios import Scenarios


def scenarios(  # noqa: PLR0913 every one is an option of the command line
    case: Case | str | Path,
    n: int = 200,
    *,
    seed: int = 0,
    days: int | None = None,
    track: str | Path | None = None,
    storm: str | None = None,
    averaging_s: float | None = None,
    agency: str | None = None,
    shift: float = 0.0,
    reduce: int | None = None,
    **bell: Unpack[BellSettings],
) -> Scenarios:
    """Storms: which line is down when, in `n` scenarios, for `solve`, `compare` and `survive`.

    They come from the case's own blackout, storm or bell, or from a track. `Scenarios.save` writes
    the file that `--scenarios` takes.

    Args:
        case: a case, its file, or the name of an installed one.
        n: how many.
        seed: of the draw; the same seed gives the same storms.
        days: whole days, of the bell only; the case's horizon if omitted.
        track: file of a storm in place of the case's.
        storm: which one, of several in the file.
        averaging_s: of the file's winds, s, where it does not say.
        agency: whose winds, of several in the file, or where it does not say.
        shift: of the common strength of a storm's poles, in standard deviations.
        reduce: to how many weighted scenarios that keep the means of all; not at all if omitted.
        bell: settings of the bell, as `sigma_slots=6`; any of them asks for it.

    Raises:
        CaseError: the case has mistakes, or none of what would be drawn.
        UsageError: options that do not go together, or out of range.
    """
    from resilience.case import Case, load_case

    case = case if isinstance(case, Case) else load_case(case)
    drawn = draw(
        case, n, seed, days=days, shift=shift,
        track=track, storm=storm, averaging_s=averaging_s, agency=agency, **bell,
    )  # fmt: skip
    if reduce is None:
        return drawn
    load_mw = load_behind_mw(case, drawn.lines)
    return reduced(drawn, reduce, load_mw=load_mw, means=moments(case, drawn))
