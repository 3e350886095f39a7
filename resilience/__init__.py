"""Resilient dispatch of microgrids in storms: one model, proven bounds, one judge for all.

import resilience as rs

case = rs.load_case("ieee33")
plan = rs.solve(case, method="minlp")
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from resilience.case import Case, Network, Outage, case_names, load_case, parse_outages
    from resilience.dispatch.evaluate import Report, compare
    from resilience.dispatch.plan import solve
    from resilience.errors import (
        CaseError,
        InfeasibleError,
        ResilienceError,
        SolverError,
        UsageError,
    )
    from resilience.plot import plot_plan
    from resilience.results import Plan, load_plan

_HOMES = {
    "Case": "case",
    "Network": "case",
    "Outage": "case",
    "case_names": "case",
    "load_case": "case",
    "parse_outages": "case",
    "Report": "dispatch.evaluate",
    "compare": "dispatch.evaluate",
    "solve": "dispatch.plan",
    "CaseError": "errors",
    "InfeasibleError": "errors",
    "ResilienceError": "errors",
    "SolverError": "errors",
    "UsageError": "errors",
    "plot_plan": "plot",
    "Plan": "results",
    "load_plan": "results",
}

__all__ = [
    "Case",
    "CaseError",
    "InfeasibleError",
    "Network",
    "Outage",
    "Plan",
    "Report",
    "ResilienceError",
    "SolverError",
    "UsageError",
    "case_names",
    "compare",
    "load_case",
    "load_plan",
    "parse_outages",
    "plot_plan",
    "solve",
]


def __getattr__(name: str) -> Any:
    """Imports a public name when it is first asked for, so that `import resilience` is instant."""
    if name not in _HOMES:
        raise AttributeError(f"module 'resilience' has no attribute {name!r}")
    return getattr(import_module(f"resilience.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return __all__
