r"""Loads: demand is served or shed, at a price (paper eq. 6 and the last term of eq. 10).

$$ 0 \le s_l \le d_l, \qquad p_l = s_l - d_l, \qquad q_l = \tan\varphi_l\, p_l, \qquad
C = \Delta t \sum_l w_l \lambda_l s_l $$

The paper's share $\alpha_l$ is $s_l / d_l$. In a dead island $s_l = d_l$. A load that can only be
served whole has a binary $u_l$ and $\text{served}_l + s_l = d_l$,
$\text{served}_l \le \hat d_l u_l$, $s_l \le \hat d_l (1 - u_l)$, so that demand stays in the
right-hand side.

| symbol | name | unit |
|---|---|---|
| $d_l$ | `load.demand` (data) | MW |
| $s_l$ | `load.shed` | MW |
| $u_l$ | `load.on`, 1 where a block is served | 1 |
| $\hat d_l$ | twice `p_max_mw`: the most that a profile may ask for | MW |
| $\lambda_l, w_l$ | `shed_cost_per_mwh`, `priority` | $/MWh, 1 |
| $\varphi_l$ | from `power_factor`, lagging | 1 |
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.case.profiles import MAX_PU
from resilience.models.algebra import Labels
from resilience.models.components.base import Injection
from resilience.models.language.stage import Stage
from resilience.models.network.situation import Situation

if TYPE_CHECKING:
    from resilience.case.schema import LoadTable


@dataclass(frozen=True)
class Loads:
    """All loads; `bus` are indices (loads,)."""

    tables: Sequence[LoadTable]
    bus: Ints

    @property
    def names(self) -> Labels:
        """Names in the order of all arrays."""
        return tuple(t.name for t in self.tables)

    def emit(self, stage: Stage) -> Injection:
        """Demand less what is shed."""
        demand = stage.data("load.demand", self.names, about="demand")
        least = stage.data("load.shed_min", self.names, about="demand that cannot be reached")
        shed = stage.var("load.shed", self.names, least, demand, about="demand shed")
        price = np.array([t.shed_cost_per_mwh * t.priority for t in self.tables])
        stage.cost("load.shed", shed, price * stage.dt)
        blocks = np.flatnonzero([t.block for t in self.tables])
        if len(blocks):
            peak = MAX_PU * np.array([self.tables[int(i)].p_max_mw for i in blocks])
            of = [self.names[i] for i in blocks]
            on = stage.binary("load.on", of, about="whether a block is served")
            served = stage.var("load.served", of, 0.0, peak, about="demand of blocks served")
            stage.eq("load.block", served + shed[blocks], demand[blocks])
            stage.le("load.block_served", served, on * peak)
            stage.le("load.block_shed", shed[blocks], (1.0 - on) * peak)
        p = shed - demand
        factor = np.array([t.power_factor for t in self.tables])
        q = p * np.tan(np.arccos(factor)) if stage.reactive else None
        return Injection(p, q, self.bus)

    def data(self, situation: Situation) -> dict[str, Floats]:
        """Demand, and the part of it in dead islands."""
        demand = np.array([t.p_max_mw * situation.profile(t.profile) for t in self.tables])
        demand = demand.reshape(len(self.tables), situation.n)
        return {
            "load.demand": demand,
            "load.shed_min": demand * (1.0 - situation.alive_at(self.bus)),
        }

    def start(self) -> dict[str, Floats]:
        """None: loads have no memory."""
        return {}
