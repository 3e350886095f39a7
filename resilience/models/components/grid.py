r"""Connections to the main grid (the third term of the paper's eq. 10).

$$ p = p^\text{imp} - p^\text{exp}, \qquad p^\text{imp} p^\text{exp} = 0, \qquad
C = \Delta t \sum \left(c^\text{imp} p^\text{imp} + c^\text{exp} p^\text{exp}\right) $$

The paper charges $\lambda |P^\text{grid}|$: both prices equal. A negative
`export_cost_per_mwh` is what the grid pays. A `tariff` makes $c^\text{imp}$ depend on the time of
day.

| symbol | name | unit |
|---|---|---|
| $p^\text{imp}$ | `grid.import`, up to `import_max_mw` | MW |
| $p^\text{exp}$ | `grid.export`, up to `export_max_mw` | MW |
| $q$ | `grid.q`, within `q_max_mvar` either way | Mvar |
| $c^\text{imp}, c^\text{exp}$ | `grid.import_price`, `grid.export_price` (data) | $/MWh |
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from resilience.arrays import Floats
from resilience.case.schema import GridTable
from resilience.models.components.base import Injection
from resilience.models.components.fleet import DeviceFleet, EnergyTerm, Role
from resilience.models.language.stage import Stage
from resilience.models.network.situation import Situation


@dataclass(frozen=True)
class Grids(DeviceFleet):
    """All grid connections."""

    kind: ClassVar[str] = "grid"
    role: ClassVar[Role] = "exchange"
    title: ClassVar[str] = "grid"
    colour: ClassVar[str] = "#9a9a9a"
    flows: ClassVar = {"grid.import": 1.0, "grid.export": -1.0}
    limit: ClassVar[str] = "grid.import_max"
    fed: ClassVar = EnergyTerm("import", "imported")
    intake: ClassVar = EnergyTerm("export", "exported")

    tables: Sequence[GridTable]

    @classmethod
    def showcase(cls) -> GridTable:
        """A connection."""
        return GridTable(name="grid", bus="1", import_max_mw=1.0, import_cost_per_mwh=1.0)

    def _array(self, key: str) -> Floats:
        return np.array([getattr(t, key) for t in self.tables], float)

    def power_range(self) -> tuple[Floats, Floats]:
        """The export limit, negative, and the import limit."""
        return -self._array("export_max_mw"), self._array("import_max_mw")

    def capacity(self) -> tuple[Floats, Floats]:
        """Its limits, and reactive power either way."""
        p_min, p_max = self.power_range()
        return p_max + self.q_max_mvar, -p_min + self.q_max_mvar

    def apparent_mva(self) -> Floats:
        """At its greatest active power, either way, and its greatest reactive power."""
        p_min, p_max = self.power_range()
        return np.hypot(np.maximum(p_max, -p_min), self.q_max_mvar)

    def size_mw(self) -> Floats:
        """The import limit."""
        return self._array("import_max_mw")

    def voltage_pu(self) -> Floats:
        """The voltage of the grid outside."""
        return self._array("v_pu")

    def profiles(self) -> tuple[str | None, ...]:
        """Those of its prices."""
        return tuple(name for t in self.tables for _, name in (t.import_price, t.export_price))

    @property
    def q_max_mvar(self) -> Floats:
        """Limits of reactive power either way; the import limit where none is given."""
        return np.array(
            [t.import_max_mw if t.q_max_mvar is None else t.q_max_mvar for t in self.tables], float
        )

    def emit(self, stage: Stage) -> Injection:
        """Import less export, each at its price."""
        import_max, export_max = (
            stage.data(f"grid.{way}_max", self.names, about=f"{way} limit")
            for way in ("import", "export")
        )
        import_price, export_price = (
            stage.data(f"grid.{way}_price", self.names, unit="$/MWh", about=f"price of {way}")
            for way in ("import", "export")
        )
        limits = [t.import_max_mw for t in self.tables], [t.export_max_mw for t in self.tables]
        bring, send = stage.split(
            "grid", self.names, (import_max, export_max), limits, parts=("import", "export")
        )
        stage.cost("grid.import", bring, import_price * stage.dt)
        stage.cost("grid.export", send, export_price * stage.dt)
        q = None
        if stage.reactive:
            about = "reactive power from the grid"
            q_max = stage.data("grid.q_max", self.names, unit="Mvar", about=about + ", limit")
            q = stage.var("grid.q", self.names, -q_max, q_max, unit="Mvar", about=about)
        return Injection(bring - send, q, self.bus)

    def data(self, situation: Situation) -> dict[str, Floats]:
        """Limits (zero in a dead island) and prices."""
        alive = self.available(situation)

        def price(ways: Iterable[tuple[float, str | None]]) -> Floats:
            rows = [factor * situation.profile(name) for factor, name in ways]
            return np.array(rows, float).reshape(len(self.tables), situation.n)

        return {
            "grid.import_max": self._array("import_max_mw")[:, None] * alive,
            "grid.export_max": self._array("export_max_mw")[:, None] * alive,
            "grid.import_price": price(t.import_price for t in self.tables),
            "grid.export_price": price(t.export_price for t in self.tables),
            "grid.q_max": self.q_max_mvar[:, None] * alive,
        }
