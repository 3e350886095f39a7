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
from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.models.algebra import Labels
from resilience.models.components.base import Injection
from resilience.models.language.stage import Stage
from resilience.models.network.situation import Situation

if TYPE_CHECKING:
    from resilience.case.schema import GridTable


@dataclass(frozen=True)
class Grids:
    """All grid connections; `bus` are indices (connections,)."""

    tables: Sequence[GridTable]
    bus: Ints

    @property
    def names(self) -> Labels:
        """Names in the order of all arrays."""
        return tuple(t.name for t in self.tables)

    @property
    def q_max_mvar(self) -> Floats:
        """Limits of reactive power either way; the import limit where none is given."""
        return np.array(
            [t.import_max_mw if t.q_max_mvar is None else t.q_max_mvar for t in self.tables], float
        )

    def emit(self, stage: Stage) -> Injection:
        """Import less export, each at its price."""
        most = [
            stage.data(f"grid.{way}_max", self.names, about=f"{way} limit")
            for way in ("import", "export")
        ]
        prices = [
            stage.data(f"grid.{way}_price", self.names, unit="$/MWh", about=f"price of {way}")
            for way in ("import", "export")
        ]
        limits = [t.import_max_mw for t in self.tables], [t.export_max_mw for t in self.tables]
        bring, send = stage.split(
            "grid", self.names, (most[0], most[1]), limits, parts=("import", "export")
        )
        stage.cost("grid.import", bring, prices[0] * stage.dt)
        stage.cost("grid.export", send, prices[1] * stage.dt)
        q = None
        if stage.reactive:
            about = "reactive power from the grid"
            most_q = stage.data("grid.q_max", self.names, unit="Mvar", about=about + ", limit")
            q = stage.var("grid.q", self.names, -most_q, most_q, unit="Mvar", about=about)
        return Injection(bring - send, q, self.bus)

    def data(self, situation: Situation) -> dict[str, Floats]:
        """Limits (zero in a dead island) and prices."""
        alive = situation.alive_at(self.bus)

        def column(key: str) -> Floats:
            return np.array([getattr(t, key) for t in self.tables], float)[:, None]

        def price(ways: Iterable[tuple[float, str | None]]) -> Floats:
            rows = [factor * situation.profile(name) for factor, name in ways]
            return np.array(rows, float).reshape(len(self.tables), situation.n)

        return {
            "grid.import_max": column("import_max_mw") * alive,
            "grid.export_max": column("export_max_mw") * alive,
            "grid.import_price": price(t.import_price for t in self.tables),
            "grid.export_price": price(t.export_price for t in self.tables),
            "grid.q_max": self.q_max_mvar[:, None] * alive,
        }

    def start(self) -> dict[str, Floats]:
        """None."""
        return {}
