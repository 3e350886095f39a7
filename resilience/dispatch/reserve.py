r"""A soft reserve of stored energy, bus by bus, for as long as a storm may cut the bus off.

$$ z_i \ge R_i(\tau) - \sum_{u \in i} e_u(\tau), \qquad z_i \ge 0, \qquad
C = \rho \sum_{i, \tau} P_i(\tau)\, z_i(\tau) $$

$i$ are the buses of the merged graph that hold storage: what is left together whatever fails. $R_i$
is the energy that its loads lack beyond PV and generators during the longest outage that begins in
step $\tau$, as far as storage can hold and give it; $P_i$ the probability that the bus is cut off
from the grid in that step. Above the price of shedding, load would be shed to keep a reserve; below
the marginal generator, none would be kept. So the price $\rho$ lies between them: the case's
`reserve_price_per_mwh`, or their mean.

| symbol | name | unit |
|---|---|---|
| $z_i$ | `reserve.short` | MWh |
| $R_i$ | `reserve.level` (data) | MWh |
| $\rho P_i$ | `reserve.price` (data) | $/MWh |
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.case.checks.reserve import reserve_price_range
from resilience.models.components import in_roles
from resilience.models.language.stage import Stage
from resilience.models.microgrid import Microgrid
from resilience.simulation.observation import Forecast

if TYPE_CHECKING:
    from resilience.case import Case


def reserve_price(case: Case) -> float:
    """$ per MWh short: the case's own, or the mean of the marginal generator and shedding."""
    if case.reserve_price_per_mwh is not None:
        return case.reserve_price_per_mwh
    low, high = reserve_price_range(device for tables in case.devices.values() for device in tables)
    return (low + high) / 2.0


@dataclass(frozen=True)
class Reserve:
    """Rows and data of the reserve of a microgrid.

    Attributes:
        microgrid: at copperplate.
        lines: names of the lines and units that may fail, in the order of probabilities of that.
    """

    microgrid: Microgrid
    lines: tuple[str, ...]

    @cached_property
    def storage_bus(self) -> Ints:
        """(units,) bus of the merged graph of every storage unit."""
        return self.microgrid.bus_index(self.microgrid.case.ess)

    @cached_property
    def buses(self) -> Ints:
        """Buses that hold storage."""
        return np.unique(self.storage_bus)

    def emit(self, stage: Stage) -> None:
        """What each bus is short of its reserve, at a price; nothing without storage."""
        if not len(self.buses):
            return
        names = tuple(self.microgrid.network.bus_names[bus] for bus in self.buses)
        level = stage.data("reserve.level", names, unit="MWh", about="energy wanted in storage")
        price = stage.data("reserve.price", names, unit="$/MWh", about="price of being short of it")
        short = stage.var("reserve.short", names, 0.0, np.inf, unit="MWh", about="short of reserve")
        place = (self.buses[:, None] == self.storage_bus[None, :]).astype(float)
        stored_mwh = stage["ess.energy"].mapped(place, names)
        stage.le("reserve", level - stored_mwh, short)
        stage.cost("reserve", short, price)

    @cached_property
    def cut_off_by(self) -> np.ndarray:
        """(buses with storage, lines) lines whose failure alone parts the bus from every grid.

        A bus that no single line can part depends on all of them. A connection to the grid that is
        out counts as a line, any other unit parts nothing.
        """
        microgrid, case = self.microgrid, self.microgrid.case
        up = np.ones((len(case.elements), len(self.lines)), bool)
        up[[case.element(name) for name in self.lines], np.arange(len(self.lines))] = False
        situation = microgrid.situation(up, lambda _: np.ones(len(self.lines)))
        island, apart = situation.island, np.ones((len(self.buses), len(self.lines)), bool)
        for fleet in in_roles(microgrid.fleets.values(), "exchange"):
            joined = island[self.buses][:, None] == island[fleet.bus][None]
            apart &= ~(joined & situation.works(fleet.names)[None]).any(axis=1)
        is_line = np.array([case.network.has_line(name) for name in self.lines], bool)
        parts = is_line | apart.any(axis=0)
        apart[~apart.any(axis=1)] = parts
        return np.asarray(apart)

    def cut_off(self, chance: Floats) -> Floats:
        """(buses, slots) probability of being cut off in a slot, from that of (lines, slots)."""
        stays = np.log1p(-np.minimum(chance, 1.0 - 1e-12))
        return -np.expm1(self.cut_off_by @ stays)

    def lack(
        self, forecast: Forecast, start: int, slots: int, line_up: Bools | None = None
    ) -> Floats:
        """(buses with storage, slots) MW that loads want beyond PV and generators.

        From slot `start` on; beyond the horizon its last slot is repeated.

        Args:
            forecast: of load and PV.
            start: the first slot.
            slots: how many.
            line_up: (elements of the case,) what is in order: generators that are not give nothing;
                all are if omitted.
        """
        ahead = np.minimum(start + np.arange(slots), self.microgrid.case.slots - 1)
        names, peak = self._net_demand
        values = np.array([forecast(name, ahead) for name in names]).reshape(len(names), slots)
        return peak @ values - self._generators_mw(line_up)[:, None]

    @cached_property
    def _net_demand(self) -> tuple[tuple[str | None, ...], Floats]:
        """Profiles, and MW of load less PV following each at every bus."""
        fleets, n = self.microgrid.fleets.values(), len(self.microgrid.network.bus_names)
        names = tuple(dict.fromkeys(name for fleet in fleets for name, _ in fleet.expected()))
        peak = np.zeros((n, len(names)))
        for fleet in fleets:
            for bus, (name, fed_mw) in zip(fleet.bus, fleet.expected(), strict=False):
                peak[bus, names.index(name)] -= fed_mw
        return names, peak[self.buses]

    def _generators_mw(self, line_up: Bools | None) -> Floats:
        """(buses with storage,) MW of the generators there that are in order."""
        case, total = self.microgrid.case, np.zeros(len(self.microgrid.network.bus_names))
        works = {} if line_up is None else dict(zip(case.elements, line_up, strict=True))
        for fleet in in_roles(self.microgrid.fleets.values(), "dispatchable"):
            in_order = np.array([not fleet.fallible or works.get(n, True) for n in fleet.names])
            np.add.at(total, fleet.bus, fleet.power_range()[1] * in_order)
        return total[self.buses]

    def level(self, lack: Floats, longest: int) -> Floats:
        """(buses, slots) MWh wanted where an outage of `longest` slots may begin, floor included.

        Args:
            lack: (buses, slots + longest - 1) MW that loads want beyond PV and generators, per bus
                with storage.
            longest: slots of the longest outage.
        """
        case, dt = self.microgrid.case, self.microgrid.case.step_h
        at_bus = self.buses[:, None] == self.storage_bus[None, :]
        size_mwh = np.array([u.e_mwh for u in case.ess])
        efficiency = np.array([u.efficiency_discharge for u in case.ess])
        discharge_max = at_bus @ np.array([-u.p_min_mw for u in case.ess])
        floor, full = (at_bus @ (size_mwh * [getattr(u, k) for u in case.ess])
                       for k in ("soc_min", "soc_max"))  # fmt: skip
        mean_efficiency = at_bus @ (size_mwh * efficiency) / np.maximum(at_bus @ size_mwh, 1e-12)
        power = np.clip(lack, 0.0, discharge_max[:, None])
        total = np.concatenate([0.0 * power[:, :1], np.cumsum(power, axis=1)], axis=1)
        energy = dt * (total[:, longest:] - total[:, :-longest]) / mean_efficiency[:, None]
        return np.minimum(floor[:, None] + energy, full[:, None])
