r"""Fuel tanks that generators share.

$$ \ell' = \min\Big\{\ell + \Delta t \Big(d - \sum_{g} f_g\Big),\ L\Big\}, \qquad \ell' \ge 0,
\qquad f_g = \max_k \left(a_{gk}\, p_g + b_{gk}\, u_g\right) $$

The sum is over the generators that burn from the tank. What is delivered in a slot can be burnt
in it; what finds no room at its end is turned away. What would come while a tank is out, as a unit
is out of order, does not come, and not later either.

A fuel curve is convex, so what a unit burns is the largest of its pieces; with one piece it is
$a_g p_g + b_g u_g$, slope and no-load. A unit without commitment burns nothing at no output,
$b_g = 0$, and $u_g = 1$.

What fuel costs is in the generators' prices and is paid when it is burnt. So what is left at the
end is worth what it cost, and no grid can refill it.

| symbol | name | unit |
|---|---|---|
| $\ell, \ell'$ | `tank.level` at the start and end of the step | m³ |
| $L$ | `capacity_m3` | m³ |
| $d$ | `tank.delivery` (data): what arrives in the slot, as a rate | m³/h |
| $f_g$ | `tank.burn` of a unit with a curve of several pieces | m³/h |
| $a_g$ | `fuel_m3_per_mwh`, or a slope of `fuel_curve` | m³/MWh |
| $b_g$ | `fuel_no_load_m3_per_h`, or where that piece would be at no output | m³/h |
| $p_g, u_g$ | `generator.p`, `generator.on` | MW, 1 |
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.case.schema import TankTable
from resilience.models.algebra import Affine, Labels, scatter
from resilience.models.components.generator import Generators
from resilience.models.language.stage import Stage
from resilience.models.network.situation import Situation
from resilience.models.structures import Largest


@dataclass(frozen=True)
class Tanks:
    """All tanks.

    Attributes:
        tables: one table per tank.
        generators: all generators of the case, those without a tank included.
    """

    tables: Sequence[TankTable]
    generators: Generators

    @property
    def names(self) -> Labels:
        """Names of the tanks."""
        return tuple(table.name for table in self.tables)

    @property
    def capacity_m3(self) -> Floats:
        """(tanks,) what they can hold, m³."""
        return np.array([table.capacity_m3 for table in self.tables], float)

    @property
    def burners(self) -> Ints:
        """Generators that burn from a tank."""
        return np.flatnonzero([unit.tank is not None for unit in self.generators.tables])

    @property
    def delivered(self) -> Ints:
        """Tanks to which fuel is delivered."""
        return np.flatnonzero([table.delivery_profile is not None for table in self.tables])

    @cached_property
    def tank_of(self) -> Ints:
        """(generators,) index of the tank that each burns from; -1 where there is none."""
        place = {name: k for k, name in enumerate(self.names)}
        return np.array([place.get(str(unit.tank), -1) for unit in self.generators.tables], np.intp)

    def emit(self, stage: Stage) -> None:
        """The level is the state; generators are emitted."""
        names, capacity = self.names, self.capacity_m3
        now, after = stage.state("tank.level", names, 0.0, capacity, unit="m³", about="fuel left")
        burners = self.burners
        of_tank = (self.tank_of[burners][None, :] == np.arange(len(names))[:, None]).astype(float)
        burnt = self._burn(stage).mapped(of_tank, names)
        filled = now + (self._delivery(stage) - burnt) * stage.dt
        stage.le("tank.dynamics", after, filled)
        full = Affine.constant(-capacity, len(names))
        stage.structure(Largest, "tank.level", (-after, -filled, full))

    def _delivery(self, stage: Stage) -> Affine:
        """(tanks,) m³ per h that arrive: columns, held by data, since no data enter a maximum."""
        n = len(self.tables)
        names = [self.names[k] for k in self.delivered]
        if not names:
            return Affine.constant(0.0, n)
        rate = stage.data("tank.delivery_rate", names, unit="m³/h", about="fuel that arrives")
        comes = stage.var(
            "tank.delivery", names, rate, rate, unit="m³/h", about="fuel that arrives"
        )
        return scatter(comes, self.delivered, n, self.names)

    def _burn(self, stage: Stage) -> Affine:
        """(burners,) m³ per h."""
        burners = self.burners
        p, on = stage["generator.p"][burners], self._running(stage)[burners]
        pieces = [self.generators.tables[g].fuel_pieces for g in burners]
        curved = np.flatnonzero([len(of_unit) > 1 for of_unit in pieces])
        first = np.array([of_unit[0] for of_unit in pieces]).reshape(len(burners), 2).T
        straight = np.ones(len(burners))
        straight[curved] = 0.0
        total = p * (first[0] * straight) + on * (first[1] * straight)
        if not len(curved):
            return total
        names = [self.generators.names[g] for g in burners[curved]]
        n_pieces = max(len(of_unit) for of_unit in pieces)
        # A unit of fewer pieces has its last one more than once.
        padded = [[*pieces[k], *[pieces[k][-1]] * (n_pieces - len(pieces[k]))] for k in curved]
        slope, fixed = np.moveaxis(np.array(padded), -1, 0)
        peak = self.generators.power_range()[1][burners[curved]]
        limit = (slope * peak[:, None] + fixed).max(axis=1)
        burn = stage.var("tank.burn", names, 0.0, limit, unit="m³/h", about="fuel burnt")
        lines = [p[curved] * slope[:, k] + on[curved] * fixed[:, k] for k in range(n_pieces)]
        stage.largest("tank.burn", burn, *lines)
        return total + scatter(burn, curved, len(burners))

    def _running(self, stage: Stage) -> Affine:
        """(generators,) whether each runs; 1 where that is not decided."""
        committed, n = self.generators.committed, len(self.generators.tables)
        free = np.ones(n)
        free[committed] = 0.0
        if not len(committed):
            return Affine.constant(free, n)
        return scatter(stage["generator.on"], committed, n) + free

    def profiles(self) -> tuple[str | None, ...]:
        """Those of deliveries."""
        return tuple(self.tables[k].delivery_profile for k in self.delivered)

    def data(self, situation: Situation) -> dict[str, Floats]:
        """Deliveries: none to a tank that is out."""
        rates = np.array([situation.profile(name) for name in self.profiles()], float)
        comes = situation.works([self.names[k] for k in self.delivered])
        return {"tank.delivery_rate": rates.reshape(len(comes), situation.n) * comes}

    def start(self) -> dict[str, Floats]:
        """Fuel at the start, m³."""
        return {"tank.level": np.array([table.initial_m3 for table in self.tables], float)}
