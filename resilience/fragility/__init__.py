"""From weather to outages: which line is down in which slot, and how likely that is."""

from __future__ import annotations

from typing import TYPE_CHECKING

from resilience.lazy import lazy_names

if TYPE_CHECKING:
    from resilience.fragility.draw import (
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
    from resilience.fragility.outages.blackout import Blackout, case_blackout
    from resilience.fragility.outages.breakpoints import breakpoints
    from resilience.fragility.outages.files import load_scenarios
    from resilience.fragility.outages.reduction import load_behind_mw, reduced
    from resilience.fragility.outages.repair import Repair
    from resilience.fragility.outages.scenarios import Scenarios
    from resilience.fragility.outages.storms import Sampling, effective_size, sample_storms
    from resilience.fragility.outages.summary import summary
    from resilience.fragility.storm_means import expected_moments, moments
else:
    __getattr__ = lazy_names(__name__)

__all__ = [
    "CURVES",
    "Bell",
    "Blackout",
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
    "case_blackout",
    "effective_size",
    "expected_moments",
    "failed_by",
    "failure_probability",
    "first_failure",
    "fixed",
    "hardened",
    "hazard",
    "joint_probability",
    "load_behind_mw",
    "load_scenarios",
    "moments",
    "outages_from",
    "poles_in_series",
    "reduced",
    "restated",
    "sample_bell",
    "sample_outages",
    "sample_storms",
    "summary",
]


def __dir__() -> list[str]:
    return __all__
