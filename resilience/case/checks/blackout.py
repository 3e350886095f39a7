"""Rules for the blackout of a case: lines that are there, a start within the horizon, a law."""

from __future__ import annotations

from collections.abc import Iterator

from resilience.case.checks.parts import Parts
from resilience.case.document import Finding
from resilience.case.reading import show
from resilience.case.schema import LAW_PARAMETERS, BlackoutTable

MAX_SIGMA = 3.0
"""Of a lognormal: one blackout in six would take twenty times the median or more."""
_TITLE = "[blackout]"


def check_blackout(parts: Parts, blackout: BlackoutTable) -> None:
    """Notes what is wrong with `[blackout]`."""
    document = parts.document
    findings = [*_wrong_start(parts, blackout), *_wrong_law(blackout)]
    document.add_findings(("blackout",), _TITLE, findings)
    _check_lines(parts, blackout)
    if parts.storm is not None and parts.storm.points:
        value, hint = "a storm on its track, too", "keep one of [storm] and [blackout]"
        document.add(("blackout",), _TITLE, "", value, "one of the two", hint)


def _check_lines(parts: Parts, blackout: BlackoutTable) -> None:
    network, where = parts.network, ("blackout", "lines")
    if network is None or not parts.inline.complete:
        return
    lines = blackout.lines or ()
    for name in lines:
        if not network.has_line(name):
            allowed, hint = "a line of the network", network.line_hint(name)
            parts.document.add(where, _TITLE, "lines", show(name), allowed, hint)
    if len(set(lines)) < len(lines):
        value, hint = show(list(lines)), "leave one out"
        parts.document.add(where, _TITLE, "lines", value, "every line once", hint)
    if not lines and not network.breakpoint.any():
        hint = 'name what is lost, lines = ["1-2"], or mark lines with `breakpoint = true`'
        parts.document.add(where, _TITLE, "lines", "nothing", "one line or more", hint)


def _wrong_start(parts: Parts, blackout: BlackoutTable) -> Iterator[Finding]:
    start, window = blackout.start, parts.window
    if start is None:
        return
    if start.tzinfo is not None:
        hint = "profiles and outages are in local time; drop the offset"
        yield "start", show(start), "a time without offset", hint
    elif window is not None and not window.start <= start < window.stop:
        allowed = f"a time within the horizon, {window}"
        yield "start", show(start), allowed, "leave it out where it begins with the horizon"


def _wrong_law(blackout: BlackoutTable) -> Iterator[Finding]:
    law, hours = blackout.law, blackout.hours
    if law is None or hours is None:
        return
    names = LAW_PARAMETERS[law]
    if len(hours) != len(names):
        hint = "24 h in the median and one in six above 53 h are lognormal hours = [24, 0.8]"
        yield "hours", show(list(hours)), f"[{', '.join(names)}] of {law} hours", hint
    elif law == "uniform" and hours[0] > hours[1]:
        yield "hours", show(list(hours)), "[shortest, longest]", "swap the two numbers"
    elif law == "lognormal" and hours[1] > MAX_SIGMA:
        hint = "sigma is of the logarithm: 0.8 has two in three within a factor of 2.2"
        yield "hours", f"sigma {hours[1]:g}", f"up to {MAX_SIGMA:g}", hint
    elif hours[0] <= 0.0 and law != "uniform":
        yield "hours", f"{names[0]} {hours[0]:g}", "above 0", "hours until the lines are back"
