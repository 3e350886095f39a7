"""Dispatchers by name."""

from __future__ import annotations

from collections.abc import Callable

from resilience.dispatch.mpc import MPC, BlindMPC
from resilience.dispatch.rules import Greedy, Idle, Rule
from resilience.dispatch.sddp.policy import Sddp
from resilience.dispatch.stochastic import Stochastic
from resilience.errors import UsageError
from resilience.models.program.risk import Risk
from resilience.simulation.world import Dispatcher, World

REFERENCE = "rule-0.9"
"""Always reported: a battery kept full is the method to beat."""

HALF_TAIL = Risk(alpha=0.95, weight=0.5)
"""Half the mean, half the mean of the worst 5 % of the paths."""

DISPATCHERS: dict[str, Callable[[World], Dispatcher]] = {
    "idle": Idle,
    "greedy": Greedy,
    "rule": lambda world: Rule(world, 0.5),
    REFERENCE: lambda world: Rule(world, 0.9),
    "mpc-blind": BlindMPC,
    "mpc": MPC,
    "stochastic": Stochastic,
    "stochastic-cvar": lambda world: Stochastic(world, risk=HALF_TAIL),
    "sddp": Sddp,
}
"""Each dispatcher by name, made from the world that it acts in."""

BATCHED = frozenset({"idle", "greedy", "rule", REFERENCE})
"""Those that decide for many scenarios at once and for each as if it were alone. All others are
given one scenario at a time in a comparison; see `dispatch.runs`."""


def check_names(names: list[str] | tuple[str, ...]) -> None:
    """Raises `UsageError` for names that no dispatcher has."""
    unknown = [name for name in names if name not in DISPATCHERS]
    if unknown:
        raise UsageError(
            f"dispatcher {', '.join(map(repr, unknown))} is unknown; "
            f"allowed: {', '.join(DISPATCHERS)}",
            hint="`clairvoyant` is the bound and always there",
        )
