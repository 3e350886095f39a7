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
    from resilience.dispatch.sddp.values import WaterValues, water_values
    from resilience.errors import (
        CaseError,
        InfeasibleError,
        ResilienceError,
        SolverError,
        UsageError,
    )
    from resilience.evaluation.ac_check import ac_check_trajectory
    from resilience.evaluation.compare import Report, compare, evaluate
    from resilience.evaluation.comparison import Comparison, load_comparison
    from resilience.fragility.feeder_hazard import Hazard, hazard
    from resilience.fragility.outages.scenarios import Scenarios
    from resilience.planning.plan import Plan, load_plan
    from resilience.planning.scenario_plan import ScenarioPlan, load_scenario_plan
    from resilience.planning.solve import solve
    from resilience.plots.hazard import plot_hazard
    from resilience.plots.plan import plot_plan
    from resilience.plots.report import plot_report
    from resilience.plots.scenario_plan import plot_scenario_plan
    from resilience.plots.storm import plot_storm
    from resilience.plots.water import plot_water_values
    from resilience.simulation.forecast import ForecastError, sample_profiles
    from resilience.simulation.replay import replay
    from resilience.simulation.trajectory import Trajectory
    from resilience.simulation.world import Dispatcher, Observation, World

_HOMES = {
    "ForecastError": "simulation.forecast",
    "sample_profiles": "simulation.forecast",
    "World": "simulation.world",
    "Observation": "simulation.world",
    "Dispatcher": "simulation.world",
    "Case": "case",
    "Network": "case",
    "Outage": "case",
    "case_names": "case",
    "load_case": "case",
    "parse_outages": "case",
    "Comparison": "evaluation.comparison",
    "load_comparison": "evaluation.comparison",
    "Report": "evaluation.compare",
    "ac_check_trajectory": "evaluation.ac_check",
    "compare": "evaluation.compare",
    "evaluate": "evaluation.compare",
    "solve": "planning.solve",
    "ScenarioPlan": "planning.scenario_plan",
    "load_scenario_plan": "planning.scenario_plan",
    "WaterValues": "dispatch.sddp.values",
    "water_values": "dispatch.sddp.values",
    "plot_scenario_plan": "plots.scenario_plan",
    "Trajectory": "simulation.trajectory",
    "Hazard": "fragility.feeder_hazard",
    "hazard": "fragility.feeder_hazard",
    "Scenarios": "fragility.outages.scenarios",
    "CaseError": "errors",
    "InfeasibleError": "errors",
    "ResilienceError": "errors",
    "SolverError": "errors",
    "UsageError": "errors",
    "replay": "simulation.replay",
    "plot_hazard": "plots.hazard",
    "plot_plan": "plots.plan",
    "plot_report": "plots.report",
    "plot_storm": "plots.storm",
    "plot_water_values": "plots.water",
    "Plan": "planning.plan",
    "load_plan": "planning.plan",
}

__all__ = [
    "Case",
    "CaseError",
    "Comparison",
    "Dispatcher",
    "ForecastError",
    "Hazard",
    "InfeasibleError",
    "Network",
    "Observation",
    "Outage",
    "Plan",
    "Report",
    "ResilienceError",
    "ScenarioPlan",
    "Scenarios",
    "SolverError",
    "Trajectory",
    "UsageError",
    "WaterValues",
    "World",
    "ac_check_trajectory",
    "case_names",
    "compare",
    "evaluate",
    "hazard",
    "load_case",
    "load_comparison",
    "load_plan",
    "load_scenario_plan",
    "parse_outages",
    "plot_hazard",
    "plot_plan",
    "plot_report",
    "plot_scenario_plan",
    "plot_storm",
    "plot_water_values",
    "replay",
    "sample_profiles",
    "solve",
    "water_values",
]


def __getattr__(name: str) -> Any:
    """Imports a public name when it is first asked for, so that `import resilience` is instant."""
    if name not in _HOMES:
        raise AttributeError(f"module 'resilience' has no attribute {name!r}")
    return getattr(import_module(f"resilience.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return __all__
