"""From weather to outages: which line is down in which slot, and how likely that is."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from resilience.fragility.draw import (
        breakpoints,
        fixed,
        outages_from,
        sample_bell,
        sample_outages,
    )
    from resilience.fragility.lines.curves import CURVES, Curve, hardened, restated
    from resilience.fragility.lines.damage import Timing, failed_by, first_failure, hazard
    from resilience.fragility.lines.spans import (
        Series,
        SpannedLines,
        SpanWind,
        failure_probability,
        joint_probability,
        poles_in_series,
    )
    from resilience.fragility.outages.bell import Bell, case_bell
    from resilience.fragility.outages.files import load_scenarios
    from resilience.fragility.outages.reduction import load_behind_mw, reduced
    from resilience.fragility.outages.repair import Repair
    from resilience.fragility.outages.scenarios import Scenarios
    from resilience.fragility.outages.storms import Sampling, effective_size, sample_storms
    from resilience.fragility.outages.summary import summary

_HOMES = {
    "CURVES": "lines.curves",
    "Bell": "outages.bell",
    "Curve": "lines.curves",
    "SpannedLines": "lines.spans",
    "Repair": "outages.repair",
    "Sampling": "outages.storms",
    "Scenarios": "outages.scenarios",
    "Series": "lines.spans",
    "SpanWind": "lines.spans",
    "Timing": "lines.damage",
    "breakpoints": "draw",
    "case_bell": "outages.bell",
    "effective_size": "outages.storms",
    "failed_by": "lines.damage",
    "failure_probability": "lines.spans",
    "first_failure": "lines.damage",
    "fixed": "draw",
    "hardened": "lines.curves",
    "hazard": "lines.damage",
    "joint_probability": "lines.spans",
    "load_behind_mw": "outages.reduction",
    "load_scenarios": "outages.files",
    "outages_from": "draw",
    "poles_in_series": "lines.spans",
    "reduced": "outages.reduction",
    "restated": "lines.curves",
    "sample_bell": "draw",
    "sample_outages": "draw",
    "sample_storms": "outages.storms",
    "summary": "outages.summary",
}

__all__ = [
    "CURVES",
    "Bell",
    "Curve",
    "Repair",
    "Sampling",
    "Scenarios",
    "Series",
    "SpanWind",
    "SpannedLines",
    "Timing",
    "breakpoints",
    "case_bell",
    "effective_size",
    "failed_by",
    "failure_probability",
    "first_failure",
    "fixed",
    "hardened",
    "hazard",
    "joint_probability",
    "load_behind_mw",
    "load_scenarios",
    "outages_from",
    "poles_in_series",
    "reduced",
    "restated",
    "sample_bell",
    "sample_outages",
    "sample_storms",
    "summary",
]


def __getattr__(name: str) -> Any:
    """Imports a public name when it is first asked for: the command line only needs options."""
    if name not in _HOMES:
        raise AttributeError(f"module 'resilience.fragility' has no attribute {name!r}")
    return getattr(import_module(f"resilience.fragility.{_HOMES[name]}"), name)
