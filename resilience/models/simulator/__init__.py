"""The same stage, stepped: policies, evaluation and gradients."""

from resilience.models.simulator.decision import Decision, part_by_part
from resilience.models.simulator.programs.milp import MilpSimulator
from resilience.models.simulator.programs.network import NetworkSimulator
from resilience.models.simulator.refusals import needs_milp
from resilience.models.simulator.simulator import RECOURSE, RecourseRule, Simulator, Step

__all__ = [
    "RECOURSE",
    "Decision",
    "MilpSimulator",
    "NetworkSimulator",
    "RecourseRule",
    "Simulator",
    "Step",
    "needs_milp",
    "part_by_part",
]
