"""What a policy sees: blocks of numbers with a name, a unit and a scale, the same code in training
and in acting.

Storage comes first, since it alone depends on what the policy did; the rest, what the world does,
can be worked out before an episode is played.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.case.schema import GridTable
from resilience.dispatch.memory import Memory
from resilience.fragility.outages.bell import case_bell
from resilience.rl.ground.eyes import Eyes, ObservationBlock
from resilience.simulation.observation import Forecast, Observation
from resilience.simulation.setting import Setting

Terms = list[tuple[int, int, float]]
HOURS_EXACT = 2.0  # ahead in which every slot is observed; beyond, every hour
HOURS_AHEAD = 12.0
REFERENCE_H = 4.0  # a line's outage of this length is 1


class Foreseen(NamedTuple):
    """What is forecast of some slots, scaled, in single precision.

    Attributes:
        demand: (slots, buses, batch).
        weather: (slots, buses, batch) of PV.
        net: (slots, buses, batch) demand less that.
        price: (prices, slots, batch).
    """

    demand: np.ndarray
    weather: np.ndarray
    net: np.ndarray
    price: np.ndarray


class Observer(Eyes):
    """Makes the observations of a setting; one per batch, since it remembers line failures.

    Args:
        setting: where it is.

    Attributes:
        blocks: what an observation holds, in order.
    """

    def __init__(self, setting: Setting) -> None:
        super().__init__(setting)
        case = setting.case
        self.daily = not case.is_dated
        self.memory = Memory(setting, daily=self.daily, overnight=case_bell(case).overnight)
        self.window, self.ahead = case.window, _slots_ahead(case.step_h)
        self._read_devices()
        self.blocks = self._blocks()
        self._all_ahead = np.arange(len(self.ahead))
        self._first = 0
        self._known: Foreseen | None = None
        ends = np.cumsum([0, *(len(block.labels) for block in self.blocks[1:])]).tolist()
        self._rows = [slice(*span) for span in pairwise(ends)]
        self._per_price = [1.0 / self._price_scale(name) for name in self.prices]
        self._per_mw = 1.0 / self._largest[:, None]

    def _read_devices(self) -> None:
        """Which profiles are forecast, what one of each means in MW at every bus, and prices."""
        fleets = self.setting.microgrid.fleets.values()
        terms = [
            (bus, name, mw)
            for fleet in fleets
            for bus, (name, mw) in zip(fleet.bus, fleet.expected(), strict=False)
        ]
        self.names = tuple(dict.fromkeys(name for _, name, _ in terms))
        n = self.setting.simulator.n_buses
        demand, supply = np.zeros((2, n, len(self.names)))
        for bus, name, mw in terms:
            (supply if mw > 0 else demand)[bus, self.names.index(name)] += abs(mw)
        self._buses = np.flatnonzero(demand.sum(1) + supply.sum(1))
        demand, supply = demand[self._buses], supply[self._buses]
        self._largest = np.maximum(demand.sum(1), supply.sum(1))
        self._demand, self._supply = (
            [(row, column, float(mw[row, column])) for row, column in np.argwhere(mw).tolist()]
            for mw in (demand, supply)
        )
        every = dict.fromkeys(name for fleet in fleets for name in fleet.profiles())
        self.prices = tuple(n for n in every if n is not None and n not in self.names)

    def _blocks(self) -> tuple[ObservationBlock, ...]:
        simulator, setting = self.setting.simulator, self.setting
        buses = [setting.microgrid.network.bus_names[b] for b in self._buses]
        later = [f"+{k}" for k in self.ahead]
        price = [self._price_scale(name) for name in self.prices]
        lines = setting.lines
        ones = (1.0,) * len(lines)
        both = tuple(self._largest.tolist())
        return (
            ObservationBlock("soc_of_band", simulator.units, (1.0,) * len(simulator.units)),
            ObservationBlock("line_up", lines, ones),
            ObservationBlock("line_down_h", lines, (REFERENCE_H,) * len(lines)),
            ObservationBlock("line_failed_before", lines, ones),
            ObservationBlock("clock", ("sin", "cos", "horizon_left"), (1.0, 1.0, 1.0)),
            ObservationBlock("hazard_peak_h", ("known", "ahead"), (1.0, REFERENCE_H)),
            ObservationBlock("demand_mw", tuple(buses), both),
            ObservationBlock("weather_mw", tuple(buses), both),
            ObservationBlock(
                "net_demand_mw",
                tuple(f"{bus}{k}" for k in later for bus in buses),
                both * len(later),
            ),
            ObservationBlock(
                "price_pu",
                tuple(f"{name}{k}" for name in self.prices for k in later),
                tuple(x for x in price for _ in later),
            ),
        )

    def _price_scale(self, name: str) -> float:
        """What a price profile is divided by, so that what the dearest generator costs is 1. It is
        from the devices, since a policy acts on other days than those it was trained on.
        """
        devices = [device for table in self.setting.case.devices.values() for device in table]
        costs = [device.marginal_cost_per_mwh or 0.0 for device in devices]
        grids = self.setting.case.tables_of(GridTable)
        prices = [price for grid in grids for price in (grid.import_price, grid.export_price)]
        factor = max((abs(f) for f, followed in prices if followed == name), default=0.0)
        return (max(costs, default=0.0) or 1.0) / (factor or 1.0)

    def world(self, observation: Observation, out: np.ndarray | None = None) -> np.ndarray:
        """(numbers but those of storage, batch) what the world is like, in single precision; once
        in each slot.

        Args:
            observation: of the slot.
            out: where it is written to; a new array if omitted.
        """
        self.memory.update(observation)
        t, up = observation.t, observation.line_up[self.memory.lines]
        world = out
        if world is None:
            world = np.empty((self.size - len(self._low), up.shape[1]), np.float32)
        parts = [world[rows] for rows in self._rows]
        down_h = (t - self.memory.since + 1) * self.setting.case.step_h
        parts[0][:] = up
        parts[1][:] = np.where(up, 0.0, down_h) / REFERENCE_H
        parts[2][:] = self.memory.spent
        parts[3][:] = self._clock(t)
        parts[4][:] = self._centre(t, observation.centre)
        self._look_ahead(observation, *parts[5:])
        return world

    def _look_ahead(
        self,
        observation: Observation,
        demand: np.ndarray,
        weather: np.ndarray,
        net: np.ndarray,
        price: np.ndarray,
    ) -> None:
        """Fills these parts of an observation, (rows, batch), with what is forecast."""
        foreseen, places = self._foreseen_from(observation)
        demand[:], weather[:] = foreseen.demand[places[0]], foreseen.weather[places[0]]
        later, batch = len(places), net.shape[1]
        of_buses, of_prices = net.reshape(later, -1, batch), price.reshape(-1, later, batch)
        foreseen.net.take(places, axis=0, out=of_buses, mode="clip")
        foreseen.price.take(places, axis=1, out=of_prices, mode="clip")

    def _foreseen_from(self, observation: Observation) -> tuple[Foreseen, Ints]:
        """What is forecast, and where in it the slots are that are observed.

        A forecast without errors says of a slot what it said before, so that is worked out once,
        for some hours more than are observed now.
        """
        t, reach = observation.t, int(self.ahead[-1])
        if self.setting.error_correlation is not None:
            return self._foreseen(observation.forecast, t + self.ahead), self._all_ahead
        if self._known is None or not self._first <= t <= self._first + reach:
            self._first = t
            self._known = self._foreseen(observation.forecast, t + np.arange(2 * reach + 1))
        return self._known, t - self._first + self.ahead

    def _foreseen(self, forecast: Forecast, slots: Ints) -> Foreseen:
        """What is forecast of some slots."""
        profiles = [forecast(name, slots) for name in self.names]
        shape = len(slots), self.setting.n
        both = (self._demand, self._supply)
        demand, weather = (_weighted(t, profiles, (len(self._buses), *shape)) for t in both)
        demand_pu, weather_pu, net_pu = np.empty((3, *demand.shape), np.float32)
        np.multiply(demand, self._per_mw, out=demand_pu, casting="same_kind")
        np.multiply(weather, self._per_mw, out=weather_pu, casting="same_kind")
        np.multiply(demand - weather, self._per_mw, out=net_pu, casting="same_kind")
        price = np.empty((len(self.prices), *shape), np.float32)
        for row, name, scale in zip(price, self.prices, self._per_price, strict=True):
            row[:] = forecast(name, slots) * scale
        return Foreseen(demand_pu, weather_pu, net_pu, price)

    def _clock(self, t: int) -> Floats:
        """(3, 1)."""
        angle = 2.0 * math.pi * self.window.slot_of_day(t) / self.window.slots_per_day
        horizon_left = 0.0 if self.daily else 1.0 - t / self.window.slots
        return np.array([[math.sin(angle)], [math.cos(angle)], [horizon_left]])

    def _centre(self, t: int, centre: Ints) -> Floats:
        """(2, batch) whether the peak is known, and hours until it, scaled."""
        is_told = centre >= 0
        hours = centre * 0.25 - self.window.slot_of_day(t) * self.setting.case.step_h
        return np.array([is_told, is_told * hours / REFERENCE_H])


def _weighted(terms: Terms, profiles: list[Floats], shape: tuple[int, int, int]) -> Floats:
    """(slots, rows, batch) sums of profiles (slots, batch), term by term: the bits of a product
    would depend on the size of the batch.

    Args:
        terms: as (row, number of the profile, MW).
        profiles: by number.
        shape: rows, slots, batch.
    """
    total = np.zeros(shape)
    for row, column, mw in terms:
        total[row] += mw * profiles[column]
    return total.swapaxes(0, 1)


def _slots_ahead(step_h: float) -> Ints:
    """Slots from now that are observed: every one for two hours, then one an hour."""
    near = np.arange(max(round(HOURS_EXACT / step_h), 1))
    hours = np.arange(HOURS_EXACT, HOURS_AHEAD)
    return np.unique(np.concatenate([near, np.round(hours / step_h).astype(np.intp)]))
