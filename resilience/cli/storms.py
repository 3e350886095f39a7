"""Commands about storms: `resilience scenarios` and `resilience hazard`."""

from __future__ import annotations

import json
from functools import partial
from typing import TYPE_CHECKING, Annotated

import typer

from resilience.cli import bell_options, options, pages, terminal

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from resilience.case import Case
    from resilience.fragility.feeder_hazard import Hazard
    from resilience.fragility.outages.bell import BellSettings
    from resilience.fragility.outages.scenarios import Scenarios


def scenarios(
    case: options.CaseName,
    n: options.ScenarioCount = 200,
    seed: options.ScenarioSeed = 0,
    days: options.WholeDays = None,
    out: options.ScenarioOut = None,
    probability: bell_options.Probability = None,
    height: bell_options.Height = None,
    sigma_slots: bell_options.SigmaSlots = None,
    duration_slots: bell_options.DurationSlots = None,
    duration_law: bell_options.DurationLaw = None,
    shift_slots: bell_options.ShiftSlots = None,
    shared_shift: bell_options.SharedShift = None,
    common_draw: bell_options.CommonDraw = None,
    refail: bell_options.Refail = None,
    wrap: bell_options.Wrap = None,
    overnight: bell_options.Overnight = None,
    centre: bell_options.Centre = None,
    centre_error_slots: bell_options.CentreErrorSlots = None,
    rate: bell_options.Rate = None,
    track: options.Track = None,
    storm: options.TrackStorm = None,
    averaging_s: options.Averaging = None,
    agency: options.Agency = None,
    shift: bell_options.Shift = 0.0,
    reduce: bell_options.Reduce = None,
    as_json: options.AsJson = False,
) -> None:
    """Draw storms: which line is down when. What is not given here is the case's own."""
    import resilience as rs
    from resilience import fragility
    from resilience.fragility.draw import draw

    if out is not None:
        _check_out(out)
    loaded = rs.load_case(case)
    bell: BellSettings = {
        "probability": probability,
        "height": height,
        "sigma_slots": sigma_slots,
        "duration_slots": duration_slots,
        "duration_law": duration_law,
        "shift_slots": shift_slots,
        "shared_shift": shared_shift,
        "common_draw": common_draw,
        "refail": refail,
        "wrap": wrap,
        "overnight": overnight,
        "centres": tuple(centre) if centre else None,
        "centre_error_slots": centre_error_slots,
        "rate": rate,
    }
    drawn = draw(
        loaded, n, seed, days=days, shift=shift,
        track=track, storm=storm, averaging_s=averaging_s, agency=agency, **bell,
    )  # fmt: skip
    means = None
    if reduce is not None:
        load_mw = fragility.load_behind_mw(loaded, drawn.lines)
        all_moments = fragility.moments(loaded, drawn)
        before = fragility.expected_moments(all_moments, drawn.probability)
        drawn = fragility.reduced(drawn, reduce, load_mw=load_mw, means=all_moments)
        few_moments = fragility.moments(loaded, drawn)
        means = before, fragility.expected_moments(few_moments, drawn.probability)
    terminal.show(partial(_print_scenarios, drawn, loaded, as_json, reduce, means))
    terminal.write(terminal.Output("scenarios", out, drawn.save), quiet=as_json)


def _check_out(out: Path) -> None:
    from resilience.files import check_file
    from resilience.fragility.outages.scenarios import check_suffix

    check_suffix(out)
    check_file(out)


def _print_scenarios(
    drawn: Scenarios,
    case: Case,
    as_json: bool,
    requested: int | None,
    means: tuple[Mapping[str, float], Mapping[str, float]] | None,
) -> None:
    from resilience import fragility
    from resilience.text.console import plain_console
    from resilience.text.scenarios import print_reduction, print_scenarios

    if as_json:
        summary = fragility.summary(drawn, case)
        if means is not None:
            summary["means"] = {"all": means[0], "kept": means[1]}
        typer.echo(json.dumps(summary, indent=2, allow_nan=False))
        return
    print_scenarios(drawn, case, plain_console())
    if requested is not None and means is not None:
        print_reduction(drawn, requested, *means, plain_console())


def hazard(
    case: options.CaseName,
    track: options.Track = None,
    storm: options.TrackStorm = None,
    averaging_s: options.Averaging = None,
    agency: options.Agency = None,
    n: Annotated[
        int, typer.Option("-n", help="Storms drawn for islands.", min=1, max=options.MAX_STORMS)
    ] = 1000,
    seed: Annotated[int, typer.Option(help="Of these storms.", min=0)] = 0,
    out: options.HazardFolder = None,
    plot: options.HazardPicture = None,
    html: options.Page = None,
    as_json: options.AsJson = False,
) -> None:
    """From a typhoon's track to the lines that fail: probabilities, islands, a map."""
    import resilience as rs
    from resilience.files import check_picture
    from resilience.results import HAZARD, check_replaceable

    if plot is not None:
        check_picture(plot)
    pages.check(html)
    if out is not None:
        check_replaceable(out, HAZARD)
    result = rs.hazard(
        case, track, storm=storm, averaging_s=averaging_s, agency=agency, n=n, seed=seed
    )
    terminal.show(partial(_print_hazard, result, as_json))
    terminal.write(
        terminal.Output("tables", out, result.save),
        terminal.Output("picture", plot, partial(rs.plot_hazard, result)),
        terminal.Output("page", html, partial(pages.write, result)),
        quiet=as_json,
    )


def _print_hazard(result: Hazard, as_json: bool) -> None:
    if as_json:
        typer.echo(json.dumps(result.summary(), indent=2, allow_nan=False))
        return
    from resilience.text.console import plain_console
    from resilience.text.hazard import print_hazard

    print_hazard(result, plain_console())
