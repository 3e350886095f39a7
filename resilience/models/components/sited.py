r"""What may be built before the storm: none of what it could do without being built.

A unit that may be built stands in the case like any other, and is whole or nothing, $y_u$, a
design: the same in every slot of every storm. What it feeds in and takes, and what it stores, lies
within its limits times $y_u$:

$$ 0 \le p_u \le \overline{p}_u y_u, \qquad |q_u| \le S_u y_u, \qquad
   \underline{s}_u E_u y_u \le e'_u \le \overline{s}_u E_u y_u $$

A storage comes with its energy at the start: its own state starts empty, and in the first slot of
every storm it is filled with $s^0_u E_u y_u$ (`site.filled`), so that the start is known whatever
is built. Units of one site are alike, so the second is built after the first.

A tie, an open line that may be given a switch, is closed at most as far as it has one, $z \le y$.

| symbol | name | unit |
|---|---|---|
| $y_u$ | `site.built`, per unit and tie | 1 |
| $s^0_u E_u y_u$ | `site.filled`, of storage; nothing but in the first slot of a storm | MWh |
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from resilience.arrays import Bools, Floats
from resilience.case.schema import DeviceTable, ESSTable
from resilience.models.algebra import Affine, Labels
from resilience.models.components.base import Component, Injection
from resilience.models.components.ess import FILLED
from resilience.models.components.fleet import DeviceFleet
from resilience.models.components.line import Lines
from resilience.models.language.stage import Stage
from resilience.models.network.situation import Situation

BUILT = "site.built"


@dataclass(frozen=True)
class Sited:
    """The units and ties that may be built.

    They stand in the case: storage empty, with no least charge, and ties switchable.

    Attributes:
        units: the table of each, as it is if it is built.
        follows: (units,) whether a unit is built only with the one before it.
        cost: (units and ties,) $ in the objective, paid once.
        output: (units,) per unit of its greatest output, what it can feed in at most in the stage.
        ties: open lines that may be given a switch.
        begins: whether the stage is the first of a storm.
    """

    units: Sequence[DeviceTable]
    follows: Bools
    cost: Floats
    output: Floats
    ties: Labels = ()
    begins: bool = False

    @property
    def names(self) -> Labels:
        """Names of the units and ties."""
        return (*(unit.name for unit in self.units), *self.ties)

    def emit(self, stage: Stage) -> None:
        """Declares what is built, and what storage comes with."""
        built = stage.design(
            BUILT, self.names, 0.0, 1.0, self.cost,
            unit="1", about="whether it is built", integer=True,
        )  # fmt: skip
        stored = {u.name: u for u in self.units if isinstance(u, ESSTable)}
        if stored:
            size_mwh = np.array([u.e_mwh * u.soc_initial for u in stored.values()]) * self.begins
            filled = stage.var(
                FILLED, tuple(stored), 0.0, size_mwh, unit="MWh", about="stored as it is built"
            )
            rows = [self.names.index(name) for name in stored]
            stage.eq(FILLED, filled, built[rows] * size_mwh)

    def limit(self, stage: Stage, component: Component, power: Injection) -> None:
        """Holds what a component that is in the stage does to what is built of it.

        Args:
            stage: with the component.
            component: any.
            power: that it feeds in.
        """
        if isinstance(component, Lines) and self.ties:
            rows = [component.switched_names.index(name) for name in self.ties]
            built: Affine = stage[BUILT][np.arange(len(self.units), len(self.names))]
            stage.le("site.line", stage["line.closed"][rows], built)
        elif isinstance(component, DeviceFleet):
            self._limit_fleet(stage, component, power)

    def _limit_fleet(self, stage: Stage, fleet: DeviceFleet, power: Injection) -> None:
        """Holds what a fleet's units feed in, take and store to what is built of them."""
        rows = [k for k, unit in enumerate(self.units) if unit.name in fleet.names]
        if not rows:
            return
        units = [fleet.names.index(self.names[k]) for k in rows]
        built: Affine = stage[BUILT][rows]
        least_mw, most_mw = fleet.power_range()
        for name, sign in fleet.flows.items():
            limit_mw = most_mw[units] * self.output[rows] if sign > 0.0 else -least_mw[units]
            stage.le(f"site.{name}", stage[name][units], built * limit_mw)
        if power.q is not None:
            rating_mva = fleet.apparent_mva()[units]
            stage.le(f"site.{fleet.kind}.q_most", power.q[units], built * rating_mva)
            stage.le(f"site.{fleet.kind}.q_least", -power.q[units], built * rating_mva)
        if fleet.stored is not None:
            tables = [t for k in rows if isinstance(t := self.units[k], ESSTable)]
            low = np.array([t.soc_min * t.e_mwh for t in tables])
            high = np.array([t.soc_max * t.e_mwh for t in tables])
            energy = stage[fleet.stored][units]
            stage.le(f"site.{fleet.stored}.most", energy, built * high)
            stage.le(f"site.{fleet.stored}.least", built * low, energy)

    def choose(self, stage: Stage) -> None:
        """Units of a site one after another, in the stage in which they are chosen."""
        later = np.flatnonzero(self.follows)
        stage.le("site.order", stage[BUILT][later], stage[BUILT][later - 1])

    def data(self, situation: Situation) -> dict[str, Floats]:
        """None: what is built is a decision."""
        return {}

    def start(self) -> dict[str, Floats]:
        """None: what is built has no value at the start."""
        return {}
