r"""What stored energy is worth, from the prices of the case alone.

A MWh in storage at slot $t$ is worth the best that it can be sold for from then on, but never more
than what another one could be bought for in the meantime:

$$ V_t = \min\{b_t, \max\{s_t, V_{t+1}\}\}, \qquad b_t = c_t / \eta^\text{ch}, \qquad
   s_t = (c_t - \lambda)\, \eta^\text{dis}, \qquad V_T = v $$

Fuel in a tank is worth what it cost, and its price is paid when it is burnt: what a window does not
burn it does not pay for. So nothing is added for it at the end of a window, and nothing can refill
it from the grid. `fuel_value` is what a m³ is worth beyond its price, where that is known better.

It is what stands at the end of a dispatcher's horizon. Storms are left to those who look at them:
within the horizon outages raise the value, behind it this is what a MWh is worth.

| symbol | name | unit |
|---|---|---|
| $c_t$ | the cheapest import price, or the cheapest generator's without a grid | $/MWh |
| $\lambda, \eta$ | `degradation_cost_per_mwh`, efficiencies of the unit | $/MWh, 1 |
| $v$ | worth of energy left at the end | $/MWh |
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Floats
from resilience.case.schema import GridTable

if TYPE_CHECKING:
    from resilience.case import Case


def energy_price(case: Case) -> Floats:
    """(slots,) $ per MWh of the cheapest source that is always there: a grid, else a generator."""
    imports = [grid.import_price for grid in case.tables_of(GridTable)]
    if imports:
        return np.min([factor * case.profile(name) for factor, name in imports], axis=0)
    every = (device for tables in case.devices.values() for device in tables)
    costs = [cost for d in every if (cost := d.marginal_cost_per_mwh) is not None]
    return np.full(case.slots, min(costs, default=0.0))


def stored_energy_value(case: Case, end_value_per_mwh: float) -> Floats:
    """(units, slots + 1) $ per MWh held at the start of every slot, and at the end of the last.

    Args:
        case: prices and storage.
        end_value_per_mwh: what energy left at the end is worth.
    """
    price = energy_price(case)
    units = len(case.ess)
    wear = np.array([unit.degradation_cost_per_mwh for unit in case.ess])
    buy = price / np.array([unit.efficiency_charge for unit in case.ess])[:, None]
    efficiency = np.array([unit.efficiency_discharge for unit in case.ess])[:, None]
    sell = (price - wear[:, None]) * efficiency
    value = np.full((units, case.slots + 1), end_value_per_mwh)
    for t in range(case.slots - 1, -1, -1):
        value[:, t] = np.minimum(buy[:, t], np.maximum(sell[:, t], value[:, t + 1]))
    return value


def fuel_value(case: Case) -> Floats:
    """(tanks, slots + 1) $ per m³, beyond its price, held at the start of every slot and the end.

    Nothing, whatever lies behind a window: prices alone say no more.
    """
    return np.zeros((len(case.tank), case.slots + 1))
