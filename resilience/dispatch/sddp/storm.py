"""One day of a microgrid with a storm, as a multistage program."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.case import Case
from resilience.case.schema import ESSTable
from resilience.dispatch.sddp.chain import ModeChain
from resilience.dispatch.sddp.days import Climate
from resilience.dispatch.sddp.model import Cuts, Multistage, NoiseOutcomes
from resilience.models.microgrid import Microgrid


@dataclass(frozen=True)
class Fleet:
    """Storage, units that behave as one merged into one.

    Units at one merged bus with the same ratio of power to energy, efficiencies, limits and start
    of the state of charge, and wear, stay at one state of charge if power is shared by energy: then
    one unit of their total size has the same choices and costs.

    Attributes:
        microgrid: the microgrid with the merged units.
        member: (units of the case,) which merged unit each belongs to.
        share: (units of the case,) of the merged unit's energy and power.
    """

    microgrid: Microgrid
    member: Ints
    share: Floats

    @classmethod
    def of_case(cls, case: Case) -> Fleet:
        """The fleet of a case, over one slot: profiles come from elsewhere."""
        buses = Microgrid.build(case, "copperplate").bus_index(case.ess)
        alike = [_alike(unit, int(bus)) for unit, bus in zip(case.ess, buses, strict=True)]
        kinds = list(dict.fromkeys(alike))
        member = np.array([kinds.index(kind) for kind in alike], np.intp)
        size = np.array([unit.e_mwh for unit in case.ess])
        total = np.bincount(member, size, len(kinds))
        merged = tuple(
            _merged([u for u, m in zip(case.ess, member, strict=True) if m == k])
            for k in range(len(kinds))
        )
        merged_case = case.replace(ess=merged, outages=())
        return cls(Microgrid.build(merged_case, "copperplate"), member, size / total[member])

    @property
    def n(self) -> int:
        """Number of merged units."""
        return len(self.microgrid.case.ess)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the merged units."""
        return tuple(unit.name for unit in self.microgrid.case.ess)

    @cached_property
    def band(self) -> tuple[Floats, Floats]:
        """(merged units,) least and most energy, MWh."""
        units = self.microgrid.case.ess
        size = np.array([u.e_mwh for u in units])
        return size * [u.soc_min for u in units], size * [u.soc_max for u in units]

    def summed(self, per_unit: Floats) -> Floats:
        """(merged units, ...) totals of (units of the case, ...)."""
        totals = np.zeros((self.n, *per_unit.shape[1:]))
        np.add.at(totals, self.member, per_unit)
        return totals


def _alike(unit: ESSTable, bus: int) -> tuple[object, ...]:
    return (
        bus,
        round(unit.p_max_mw / unit.e_mwh, 9),
        round(unit.p_min_mw / unit.e_mwh, 9),
        unit.soc_min,
        unit.soc_max,
        unit.soc_initial,
        unit.efficiency_charge,
        unit.efficiency_discharge,
        unit.degradation_cost_per_mwh,
        unit.grid_forming,
    )


def _merged(units: Sequence[ESSTable]) -> ESSTable:
    if len(units) == 1:
        return units[0]
    changes = {
        key: sum(getattr(u, key) for u in units) for key in ("e_mwh", "p_max_mw", "p_min_mw")
    }
    name = "+".join(u.name for u in units)
    return units[0].model_copy(update={**changes, "name": name, "s_mva": None})


@dataclass(frozen=True)
class Prices:
    """Profiles that are no load's and no PV's.

    Attributes:
        names: of the profiles.
        values: (profiles, slots of the day) per unit.
    """

    names: tuple[str, ...]
    values: Floats

    def price(self, name: str, t: int) -> float:
        """One of the profiles in slot t of the day, per unit."""
        return float(self.values[self.names.index(name), t])


def day_program(
    fleet: Fleet,
    lines: Sequence[str],
    chain: ModeChain,
    climate: Climate,
    prices: Prices,
    terminal: Floats,
    stop: int,
) -> Multistage:
    """Slots 0 to `stop` of a day.

    Args:
        fleet: the microgrid.
        lines: those of the chain.
        chain: modes and their transitions.
        climate: load and PV.
        prices: of the grid.
        terminal: (merged units,) $ per MWh of what is stored at the end.
        stop: number of slots.
    """
    outcomes = [
        _slot(fleet, _status(fleet.microgrid.case, lines, chain.down[t]), climate, prices, t)
        for t in range(stop)
    ]
    end = Cuts.of_prices(terminal, len(climate.basis))
    stage = fleet.microgrid.stage(fleet.microgrid.case.step_h, may_spill=True)
    return Multistage([stage], outcomes, chain.transition[:stop], end)


def _status(case: Case, lines: Sequence[str], down: Bools) -> Bools:
    """(lines of the case, modes) which lines are up."""
    up = np.ones((len(case.network.line_names), len(down)), bool)
    up[[case.network.line(name) for name in lines]] = ~down.T
    return up


def _slot(fleet: Fleet, up: Bools, climate: Climate, prices: Prices, t: int) -> list[NoiseOutcomes]:
    """Every mode of a slot: the world at zero levels, then what one unit of each level adds."""
    n, levels = len(climate.noise), len(climate.basis)
    per_mode = n * (1 + levels)

    def profile(name: str | None) -> Floats:
        if name is None:
            return np.ones(up.shape[1] * per_mode)
        if name in prices.names:
            return np.full(up.shape[1] * per_mode, prices.price(name, t))
        outcomes = [np.append(0.0, climate.profile(name, t, w)) for w in range(n)]
        return np.tile(np.concatenate(outcomes), up.shape[1])

    data = fleet.microgrid.data(fleet.microgrid.situation(np.repeat(up, per_mode, axis=1), profile))
    shaped = {k: v.reshape(len(v), up.shape[1], n, 1 + levels).copy() for k, v in data.items()}
    for value in shaped.values():
        value[..., 1:] -= value[..., :1]
    return [
        NoiseOutcomes(0, np.full(n, 1.0 / n), {k: v[:, m] for k, v in shaped.items()})
        for m in range(up.shape[1])
    ]


def price_profiles(case: Case, names: Sequence[str], per_day: int, offset: int) -> Prices:
    """Mean over the case's days of every profile but `names`, by slot of the day."""
    others = tuple(name for name in case.profiles if name not in names)
    values = np.zeros((len(others), per_day))
    clock = (offset + np.arange(case.slots)) % per_day
    count = np.bincount(clock, minlength=per_day)
    for row, name in zip(values, others, strict=True):
        series = case.profile(name)
        total = np.bincount(clock, series, per_day)
        row[:] = np.where(count > 0, total / np.maximum(count, 1), series.mean())
    return Prices(others, values)
