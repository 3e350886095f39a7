"""From weather to outages: which line is down in which slot, and how likely that is."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from resilience.fragility.bell import Bell, case_bell
    from resilience.fragility.files import load_scenarios
    from resilience.fragility.forecast import ForecastError, sample_profiles
    from resilience.fragility.outages import (
        breakpoints,
        fixed,
        outages_from,
        sample_bell,
        sample_outages,
    )
    from resilience.fragility.report import print_scenarios, summary
    from resilience.fragility.scenarios import Scenarios

_HOMES = {
    "Bell": "bell",
    "ForecastError": "forecast",
    "Scenarios": "scenarios",
    "breakpoints": "outages",
    "case_bell": "bell",
    "fixed": "outages",
    "load_scenarios": "files",
    "outages_from": "outages",
    "print_scenarios": "report",
    "sample_bell": "outages",
    "sample_outages": "outages",
    "sample_profiles": "forecast",
    "summary": "report",
}

__all__ = [
    "Bell",
    "ForecastError",
    "Scenarios",
    "breakpoints",
    "case_bell",
    "fixed",
    "load_scenarios",
    "outages_from",
    "print_scenarios",
    "sample_bell",
    "sample_outages",
    "sample_profiles",
    "summary",
]


def __getattr__(name: str) -> Any:
    """Imports a public name when it is first asked for: the command line only needs options."""
    if name not in _HOMES:
        raise AttributeError(f"module 'resilience.fragility' has no attribute {name!r}")
    return getattr(import_module(f"resilience.fragility.{_HOMES[name]}"), name)
