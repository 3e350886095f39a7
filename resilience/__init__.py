"""Resilient dispatch of microgrids in storms: one model, proven bounds, one judge for all.

import resilience as rs

case = rs.load_case("ieee33")
plan = rs.solve(case, method="minlp")
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from resilience.lazy import lazy_names

if TYPE_CHECKING:
    from resilience.case import Case, Network, Outage, case_names, load_case, parse_outages
    from resilience.dispatch.sddp.values import WaterValues, water_values
    from resilience.errors import (
        CaseError,
        CertificateError,
        FileError,
        InfeasibleError,
        ResilienceError,
        SolverError,
        UsageError,
    )
    from resilience.evaluation.ac_check import ac_check_trajectory
    from resilience.evaluation.compare import Report, compare, evaluate
    from resilience.evaluation.comparison import Comparison, load_comparison
    from resilience.evaluation.survival import Survival, load_survival, survive
    from resilience.fragility.drawing import scenarios
    from resilience.fragility.feeder_hazard import Hazard, hazard
    from resilience.fragility.outages.scenarios import Scenarios
    from resilience.models.methods.cvxpy_model import CvxpyModel, cvxpy_model
    from resilience.models.simulator.decision import Decision
    from resilience.operation.answer import OperatorAnswer
    from resilience.operation.operator import Operator
    from resilience.pages.write import write_page
    from resilience.planning.ac_check import ac_check_plan
    from resilience.planning.hardening.harden import harden
    from resilience.planning.hardening.report import Hardening
    from resilience.planning.plan import Plan, load_plan
    from resilience.planning.scenarios.files import load_scenario_plan
    from resilience.planning.scenarios.options import ScenarioOptions
    from resilience.planning.scenarios.plan import ScenarioPlan
    from resilience.planning.solve import solve
    from resilience.planning.sweep import sweep
    from resilience.plots.feeder.picture import plot_map
    from resilience.plots.hardening import plot_hardening
    from resilience.plots.hazard import plot_hazard
    from resilience.plots.learning import plot_learning
    from resilience.plots.plan import plot_plan
    from resilience.plots.report import plot_report
    from resilience.plots.scenario_plan import plot_scenario_plan
    from resilience.plots.storm import plot_storm
    from resilience.plots.survival import plot_survival
    from resilience.plots.water import plot_water_values
    from resilience.revisions.runs import RunDiff, diff
    from resilience.rl.training.train import train
    from resilience.simulation.forecast import ForecastError, sample_profiles
    from resilience.simulation.observation import Dispatcher, Observation, Rationed
    from resilience.simulation.replay import replay
    from resilience.simulation.setting import Setting
    from resilience.simulation.trajectory import Trajectory
    from resilience.simulation.world import World

    __version__: str
else:
    _imported = lazy_names(__name__)

    def __getattr__(name: str) -> Any:
        """Imports a public name when it is first used, so that `import resilience` is instant."""
        if name == "__version__":
            from importlib.metadata import version

            return version("resilience")
        return _imported(name)


__all__ = [
    "Case",
    "CaseError",
    "CertificateError",
    "Comparison",
    "CvxpyModel",
    "Decision",
    "Dispatcher",
    "FileError",
    "ForecastError",
    "Hardening",
    "Hazard",
    "InfeasibleError",
    "Network",
    "Observation",
    "Operator",
    "OperatorAnswer",
    "Outage",
    "Plan",
    "Rationed",
    "Report",
    "ResilienceError",
    "RunDiff",
    "ScenarioOptions",
    "ScenarioPlan",
    "Scenarios",
    "Setting",
    "SolverError",
    "Survival",
    "Trajectory",
    "UsageError",
    "WaterValues",
    "World",
    "ac_check_plan",
    "ac_check_trajectory",
    "case_names",
    "compare",
    "cvxpy_model",
    "diff",
    "evaluate",
    "harden",
    "hazard",
    "load_case",
    "load_comparison",
    "load_plan",
    "load_scenario_plan",
    "load_survival",
    "parse_outages",
    "plot_hardening",
    "plot_hazard",
    "plot_learning",
    "plot_map",
    "plot_plan",
    "plot_report",
    "plot_scenario_plan",
    "plot_storm",
    "plot_survival",
    "plot_water_values",
    "replay",
    "sample_profiles",
    "scenarios",
    "solve",
    "survive",
    "sweep",
    "train",
    "water_values",
    "write_page",
]


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
