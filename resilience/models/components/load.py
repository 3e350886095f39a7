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
| $\tan\varphi_l$ | from `power_factor`, lagging, or `q_mvar` / `p_max_mw` | 1 |

A load with `q_mvar` and without `p_max_mw` takes $q_l = \pm (s^q_l - d^q_l)$, with the demand
`load.q_demand` and what is shed of it, `load.q_shed`, in Mvar, at the price of a MWh.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.case.profiles import MAX_PU
from resilience.case.schema import LoadTable
from resilience.errors import UsageError
from resilience.models.algebra import Affine, scatter
from resilience.models.components.base import AT_BUS, Injection
from resilience.models.components.fleet import DeviceFleet, Role
from resilience.models.language.stage import Stage
from resilience.models.network.situation import Situation
from resilience.tolerances import INPUT_TOLERANCE


@dataclass(frozen=True)
class Loads(DeviceFleet):
    """All loads."""

    kind: ClassVar[str] = "load"
    role: ClassVar[Role] = "load"
    title: ClassVar[str] = "loads"
    colour: ClassVar[str] = "#000000"
    flows: ClassVar = {"load.shed": 1.0, "load.demand": -1.0}

    tables: Sequence[LoadTable]

    @classmethod
    def showcase(cls) -> LoadTable:
        """A load that is served whole or not at all, and returns with a surplus."""
        return LoadTable(
            name="load",
            bus="1",
            p_max_mw=1.0,
            shed_cost_per_mwh=1.0,
            block=True,
            cold_load_share=0.5,
        )

    def power_range(self) -> tuple[Floats, Floats]:
        """From the peak, negative, to nothing."""
        peak = np.array([t.p_max_mw for t in self.tables], float)
        return -peak, np.zeros_like(peak)

    def reactive_per_mw(self) -> Floats:
        """From the power factor, or from `q_mvar`."""
        return np.array([t.q_peak_mvar / t.p_max_mw if t.p_max_mw else 0.0 for t in self.tables])

    @property
    def pure(self) -> Ints:
        """Loads of reactive power alone: reactors and capacitors."""
        return np.flatnonzero([not t.p_max_mw and t.q_peak_mvar != 0.0 for t in self.tables])

    def reactive_alone(self) -> Floats:
        """Of the pure ones."""
        alone = np.zeros(len(self.tables))
        alone[self.pure] = [-self.tables[i].q_peak_mvar for i in self.pure]
        return alone

    def is_block(self) -> Bools:
        """Blocks."""
        return np.array([t.block for t in self.tables], bool)

    def expected(self) -> tuple[tuple[str | None, float], ...]:
        """The demand's profile and the peak, negative."""
        return tuple((t.profile, -t.p_max_mw) for t in self.tables)

    def merge_key(self, table: LoadTable) -> Hashable | None:
        """The price of shedding it; blocks, and loads that return with a surplus, stay alone."""
        return None if table.block or table.cold_load_share else table.shed_price_per_mwh

    def emit(self, stage: Stage) -> Injection:
        """Demand less what is shed."""
        demand = stage.data("load.demand", self.names, about="demand")
        cut_off = stage.data("load.shed_min", self.names, about="demand that cannot be reached")
        shed = stage.var("load.shed", self.names, cut_off, demand, about="demand shed")
        price = np.array([t.shed_price_per_mwh for t in self.tables])
        stage.cost("load.shed", shed, price * stage.dt)
        blocks = np.flatnonzero(self.is_block())
        if len(blocks):
            peak = self._most()[blocks]
            names = [self.names[i] for i in blocks]
            on = stage.binary("load.on", names, about="whether a block is served")
            served = stage.var(
                "load.served", names, 0.0, demand[blocks], about="demand of blocks served"
            )
            stage.eq("load.block", served + shed[blocks], demand[blocks])
            stage.le("load.block_served", served, on * peak)
            stage.le("load.block_shed", shed[blocks], (1.0 - on) * peak)
        p = shed - demand
        q = p * self.reactive_per_mw() + self._alone(stage) if stage.reactive else None
        return Injection(p, q, self.bus)

    def _alone(self, stage: Stage) -> Affine:
        """(loads,) reactive power fed in by loads that have nothing else; they can be shed, too."""
        if not len(self.pure):
            return Affine.constant(0.0, len(self.tables))
        names, peak = [self.names[i] for i in self.pure], np.abs(self.reactive_alone()[self.pure])
        demand = stage.data("load.q_demand", names, unit="Mvar", about="reactive demand alone")
        cut_off = stage.data("load.q_shed_min", names, unit="Mvar", about="what cannot be reached")
        shed = stage.var(
            "load.q_shed", names, cut_off, demand, unit="Mvar", about="reactive demand shed"
        )
        price = np.array([self.tables[i].shed_price_per_mwh for i in self.pure])
        stage.cost("load.q_shed", shed, price * stage.dt)
        room = MAX_PU * peak
        q = stage.var("load.q", names, -room, room, unit="Mvar", about="reactive power fed in")
        sign = np.sign(self.reactive_alone()[self.pure])
        stage.eq("load.reactive", q, (demand - shed) * sign)
        if AT_BUS in stage:
            stage.le("load.q_energised", demand - shed, stage[AT_BUS][self.bus[self.pure]] * room)
        return scatter(q, self.pure, len(self.tables), self.names)

    def _most(self) -> Floats:
        """(loads,) the most that the rows of a block have room for, MW."""
        return MAX_PU * np.array([t.p_max_mw for t in self.tables])

    def data(self, situation: Situation) -> dict[str, Floats]:
        """Demand, and the part of it in dead islands.

        Raises:
            UsageError: a block asks for more than its rows have room for.
        """
        demand = np.array([t.p_max_mw * situation.profile(t.profile) for t in self.tables])
        demand = demand.reshape(len(self.tables), situation.n)
        self._check_blocks(demand.max(1, initial=0.0))
        dead = 1.0 - situation.alive_at(self.bus)
        alone = np.array([situation.profile(self.tables[i].profile) for i in self.pure])
        alone = alone.reshape(len(self.pure), situation.n)
        alone *= np.abs(self.reactive_alone()[self.pure])[:, None]
        return {
            "load.demand": demand,
            "load.shed_min": demand * dead,
            "load.q_demand": alone,
            "load.q_shed_min": alone * dead[self.pure],
        }

    def _check_blocks(self, peak: Floats) -> None:
        beyond = np.flatnonzero(self.is_block() & (peak > self._most() * (1.0 + INPUT_TOLERANCE)))
        if len(beyond):
            k = int(beyond[0])
            raise UsageError(
                f"load {self.names[k]!r}, a block, asks for {peak[k]:g} MW; allowed: up to "
                f"{self._most()[k]:g}, {MAX_PU:g} times its p_max_mw",
                hint="lower the errors of the forecast, or raise p_max_mw and scale its profile",
            )
