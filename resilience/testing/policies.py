"""What a trained policy costs, path by path: an estimate from above beside the proven bound."""

from __future__ import annotations

import numpy as np

from resilience.arrays import Floats
from resilience.dispatch.sddp.model import Multistage
from resilience.dispatch.sddp.training import Begin, Engine, Trained


def simulated_costs(
    multistage: Multistage, trained: Trained, begin: Begin, n: int, rng: np.random.Generator
) -> Floats:
    """(n,) $: costs of simulated paths of the policy; their mean estimates an upper bound."""
    engine = Engine(multistage, trained.cuts, n)
    states, levels = (np.repeat(np.asarray(x)[None], n, axis=0) for x in begin)
    return engine.forward((states, levels), rng).cost
