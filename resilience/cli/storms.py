"""Commands about storms: `resilience scenarios` and `resilience hazard`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from resilience.cli import bell_options
from resilience.cli import options as given
from resilience.cli.terminal import written

BELL = frozenset(
    [
        "probability",
        "height",
        "sigma_slots",
        "duration_slots",
        "shift_slots",
        "shared_shift",
        "common_draw",
        "refail",
        "wrap",
        "overnight",
        "centre_error_slots",
        "rate",
    ]
)
"""Options that are settings of the bell under the same name."""

OF_A_DRAW = frozenset(["days", "track", "storm", "averaging_s", "shift"])
"""Options that `draw` has under the same name."""


def scenarios(
    context: typer.Context,
    case: given.CaseName,
    n: Annotated[int, typer.Option("-n", help="How many.")] = 200,
    seed: Annotated[int, typer.Option(help="The same seed draws the same scenarios.")] = 0,
    days: Annotated[
        int | None, typer.Option(help="Whole days from the start; the case's horizon if omitted.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="File to write: .npz keeps everything, .csv the outages.")
    ] = None,
    probability: bell_options.Probability = None,
    height: bell_options.Height = None,
    sigma_slots: bell_options.SigmaSlots = None,
    duration_slots: bell_options.DurationSlots = None,
    shift_slots: bell_options.ShiftSlots = None,
    shared_shift: bell_options.SharedShift = None,
    common_draw: bell_options.CommonDraw = None,
    refail: bell_options.Refail = None,
    wrap: bell_options.Wrap = None,
    overnight: bell_options.Overnight = None,
    centre: bell_options.Centre = None,
    centre_error_slots: bell_options.CentreErrorSlots = None,
    rate: bell_options.Rate = None,
    track: given.Track = None,
    storm: given.TrackStorm = None,
    averaging_s: given.Averaging = None,
    shift: bell_options.Shift = 0.0,
    reduce: bell_options.Reduce = None,
    as_json: given.AsJson = False,
) -> None:
    """Draw storms: which line is down when. What is not given here is the case's own."""
    from rich.console import Console

    from resilience import load_case
    from resilience.fragility import load_behind_mw, reduced, summary
    from resilience.fragility.draw import draw
    from resilience.fragility.outages.scenarios import check_suffix
    from resilience.text.scenarios import print_scenarios

    if out is not None:
        check_suffix(out)
    found = load_case(case)
    asked = {key: value for key, value in context.params.items() if key in BELL | OF_A_DRAW}
    drawn = draw(found, n, seed, centres=tuple(centre) if centre else None, **asked)
    if reduce is not None:
        drawn = reduced(drawn, reduce, load_mw=load_behind_mw(found, drawn.lines))
    if out is not None:
        drawn.save(out)
    if as_json:
        typer.echo(json.dumps(summary(drawn, found), indent=2, allow_nan=False))
        return
    print_scenarios(drawn, found, Console())
    written(("scenarios", out))


def hazard(
    case: given.CaseName,
    track: given.Track = None,
    storm: given.TrackStorm = None,
    averaging_s: given.Averaging = None,
    n: Annotated[int, typer.Option("-n", help="Storms drawn for islands.", min=1)] = 1000,
    seed: Annotated[int, typer.Option(help="Of these storms.", min=0)] = 0,
    out: given.HazardFolder = None,
    plot: given.HazardPicture = None,
    as_json: given.AsJson = False,
) -> None:
    """From a typhoon's track to the lines that fail: probabilities, islands, a map."""
    from resilience.fragility.feeder_hazard import hazard as find
    from resilience.plots.style import check_suffix

    if plot is not None:
        check_suffix(plot)
    found = find(case, track, storm=storm, averaging_s=averaging_s, n=n, seed=seed)
    if out is not None:
        found.save(out)
    if plot is not None:
        from resilience.plots.hazard import plot_hazard

        plot_hazard(found, plot)
    if as_json:
        typer.echo(json.dumps(found.summary(), indent=2, allow_nan=False))
        return
    from rich.console import Console

    from resilience.text.hazard import print_hazard

    print_hazard(found, Console())
    written(("tables", out), ("picture", plot))
