"""The same stage, stepped: policies, evaluation and gradients."""

from resilience.models.simulator.network import NetworkSimulator
from resilience.models.simulator.simulator import RECOURSE, RecourseRule, Simulator, Step

__all__ = ["RECOURSE", "NetworkSimulator", "RecourseRule", "Simulator", "Step"]
