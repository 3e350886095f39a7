"""What one unit of a program should be, for solvers that hold everything to absolute tolerances.

1e-8 to 1e-6 of a MW are nothing to a town and everything to a farm; of a $ they hide a tariff of
1e-6 $/kWh. So powers and energies are given in a base of the program's own, a power of ten near its
largest power, and its objective is divided by the largest cost of a column. Where both are of the
order of one already, as in a feeder in MW and $, the program stays as it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.models.program.standard import Standard, Vectors
from resilience.models.structures import Angle

POWERS_OF_BASE = {"MW": 1, "Mvar": 1, "MWh": 1, "m³": 1, "m³/h": 1, "pu": 2}
"""By unit of a variable, with which power of the base it grows; `pu` is a squared current."""
COST_UNITS = ("$", "$/h")
POWER = 1
MONEY = -1
"""In place of a power of the base: a column in $."""
USUAL_MW = 0.1, 1000.0
"""Largest powers between which MW are the right unit."""
USUAL_MESHED_MW = 0.1, 100.0
"""Likewise with angles: rows on loops have voltages beside powers."""
USUAL_COST = 0.1, 1e5
"""Largest costs of a column, $, between which $ are the right unit."""


@dataclass(frozen=True)
class Units:
    """What one unit of a program is.

    Attributes:
        base_mw: of power, MW; of energy, MWh.
        cost: of the objective, $.
    """

    base_mw: float = 1.0
    cost: float = 1.0

    @classmethod
    def of_program(cls, standard: Standard, v: Vectors) -> Units:
        """Those that suit a program: powers of ten, 1 where that is near enough."""
        inside = np.ones(standard.n_columns, bool)
        inside[standard.future] = False
        dimension, cost = dimensions(standard)[inside], v.cost[inside]
        lower, upper = v.lower[inside], v.upper[inside]
        if not standard.structures_of(Angle):
            return cls.of_columns(dimension, cost, lower, upper)
        base = _power_of_ten(_largest(dimension, lower, upper), USUAL_MESHED_MW)
        # With the base prices grow, too: they stay what they are per MW.
        per_mw = np.abs(cost)[dimension != MONEY].max(initial=0.0)
        return cls(base, base * _power_of_ten(float(per_mw), USUAL_COST))

    @classmethod
    def of_columns(cls, dimension: Ints, cost: Floats, lower: Floats, upper: Floats) -> Units:
        """Those that suit columns (columns,), see `dimensions`, with these costs and bounds."""
        base = _power_of_ten(_largest(dimension, lower, upper), USUAL_MW)
        # Of a column in $ the cost is 1 in any currency: it tells nothing.
        per_unit = np.abs(cost * cls(base).sizes(dimension))[dimension != MONEY]
        return cls(base, _power_of_ten(float(per_unit.max(initial=0.0)), USUAL_COST))

    def sizes(self, dimension: Ints) -> Floats:
        """What one unit of columns (columns,), see `dimensions`, is in MW, MWh, $ and so on."""
        power = np.where(dimension == MONEY, 0, dimension)
        return np.where(dimension == MONEY, self.cost, self.base_mw**power)


def _largest(dimension: Ints, lower: Floats, upper: Floats) -> float:
    """The largest power that columns (columns,) can have."""
    ends = np.maximum(*(np.where(np.isfinite(x), np.abs(x), 0.0) for x in (lower, upper)))
    return float(ends[dimension == POWER].max(initial=0.0))


def _power_of_ten(size: float, usual: tuple[float, float]) -> float:
    """The greatest up to `size`; 1 where that is nothing, or as usual."""
    if size == 0.0 or usual[0] <= size <= usual[1]:
        return 1.0
    return float(10.0 ** np.floor(np.log10(size)))


def dimensions(standard: Standard) -> Ints:
    """(columns,) with which power of the base a column grows; `MONEY` where it is in $."""
    powers = np.zeros(standard.n_columns, np.intp)
    powers[standard.future] = MONEY
    for block in standard.form.own_blocks:
        powers[standard.columns(block.name)] = _dimension(block.unit)
    for name, columns in standard.initial.items():
        powers[columns] = _dimension(standard.form.block(name).unit)
    return powers


def _dimension(unit: str) -> int:
    return MONEY if unit in COST_UNITS else POWERS_OF_BASE.get(unit, 0)


def column_scale(standard: Standard, units: Units) -> Floats:
    """(columns,) what one unit of a column is, in MW, MWh, $ and so on."""
    return units.sizes(dimensions(standard))
