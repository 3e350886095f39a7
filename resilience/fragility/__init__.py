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
        Lines,
        Series,
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
    from resilience.simulation.forecast import ForecastError, sample_profiles
    from resilience.text.scenarios import print_scenarios, summary

_HOMES = {
    "CURVES": "curves",
    "Bell": "bell",
    "Curve": "curves",
    "ForecastError": "forecast",
    "Lines": "lines",
    "Repair": "repair",
    "Sampling": "storms",
    "Scenarios": "scenarios",
    "Series": "lines",
    "SpanWind": "lines",
    "Timing": "damage",
    "breakpoints": "outages",
    "case_bell": "bell",
    "effective_size": "storms",
    "failed_by": "damage",
    "failure_probability": "lines",
    "first_failure": "damage",
    "fixed": "outages",
    "hardened": "curves",
    "hazard": "damage",
    "joint_probability": "lines",
    "load_behind_mw": "reduction",
    "load_scenarios": "files",
    "outages_from": "outages",
    "poles_in_series": "lines",
    "print_scenarios": "report",
    "reduced": "reduction",
    "restated": "curves",
    "sample_bell": "outages",
    "sample_outages": "outages",
    "sample_profiles": "forecast",
    "sample_storms": "storms",
    "summary": "report",
}

__all__ = [
    "CURVES",
    "Bell",
    "Curve",
    "ForecastError",
    "Lines",
    "Repair",
    "Sampling",
    "Scenarios",
    "Series",
    "SpanWind",
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
    "print_scenarios",
    "reduced",
    "restated",
    "sample_bell",
    "sample_outages",
    "sample_profiles",
    "sample_storms",
    "summary",
]


def __getattr__(name: str) -> Any:
    """Imports a public name when it is first asked for: the command line only needs options."""
    if name not in _HOMES:
        raise AttributeError(f"module 'resilience.fragility' has no attribute {name!r}")
    return getattr(import_module(f"resilience.fragility.{_HOMES[name]}"), name)
