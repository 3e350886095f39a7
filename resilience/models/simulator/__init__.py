"""The same stage, stepped: policies, evaluation and gradients."""

from resilience.models.simulator.network import NetworkSimulator
from resilience.models.simulator.simulator import RECOURSE, Recourse, Simulator, Step

__all__ = ["RECOURSE", "NetworkSimulator", "Recourse", "Simulator", "Step"]
