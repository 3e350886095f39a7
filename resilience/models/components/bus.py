r"""Voltages.

The square of the voltage magnitude at bus $b$ keeps to its band; at a grid connection it is the
grid's own. An island without the grid has no reference: its forming unit may choose any voltage
within the band, so nothing is fixed there.

$$ \underline{V}_b^2 \le v_b \le \overline{V}_b^2, \qquad v_b = V_\text{grid}^2 \text{ at a grid
connection} $$

| symbol | name | unit |
|---|---|---|
| $v_b$ | `bus.v_sq`, squared voltage magnitude | pu² |
| $\underline{V}_b, \overline{V}_b$ | `v_min_pu`, `v_max_pu` | pu |
"""

from __future__ import annotations

from dataclasses import dataclass

from resilience.arrays import Floats
from resilience.models.algebra import Labels
from resilience.models.language.stage import Stage
from resilience.models.network.situation import Situation


@dataclass(frozen=True)
class Buses:
    """Voltage band of every bus.

    Attributes:
        names: of the buses.
        v_min_pu, v_max_pu: (buses,) the band; equal limits hold a voltage.
    """

    names: Labels
    v_min_pu: Floats
    v_max_pu: Floats

    def emit(self, stage: Stage) -> None:
        """Declares the squared voltages."""
        band = self.v_min_pu**2, self.v_max_pu**2
        stage.var("bus.v_sq", self.names, *band, unit="pu²", about="squared voltage magnitude")

    def data(self, situation: Situation) -> dict[str, Floats]:
        """None."""
        return {}

    def start(self) -> dict[str, Floats]:
        """None."""
        return {}
