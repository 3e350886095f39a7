"""Good trees of switchable lines: branch exchange, with an exact sweep, slot by slot."""

from resilience.models.methods.trees.branch import TreeBranching, can_branch
from resilience.models.methods.trees.periods import better_switches

__all__ = ["TreeBranching", "better_switches", "can_branch"]
