"""What a policy sees: blocks of numbers with a name, a unit and a scale, the same code in training
and in acting.

Storage comes first, since it alone depends on what the policy did; the rest, what the world does,
can be worked out before an episode is played.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.case.schema import GridTable
from resilience.dispatch.memory import Memory
from resilience.simulation.observation import Forecast, Observation
from resilience.simulation.setting import Setting

HOURS_EXACT = 2.0  # ahead in which every slot is observed; beyond, every hour
HOURS_AHEAD = 12.0
REFERENCE_H = 4.0  # a line's outage of this length is 1


@dataclass(frozen=True)
class ObservationBlock:
    """Some numbers of an observation.

    Attributes:
        name: what they are, with their unit, as `net_demand_mw`.
        labels: which element each is.
        scale: (labels,) what they are divided by.
    """

    name: str
    labels: tuple[str, ...]
    scale: tuple[float, ...]


class Observer:
    """Makes the observations of a setting; one per batch, since it remembers line failures.

    Args:
        setting: where it is.

    Attributes:
        blocks: what an observation holds, in order.
    """

    def __init__(self, setting: Setting) -> None:
        self.setting, case = setting, setting.case
        self.daily = case.storm is None or not case.storm.points
        self.memory = Memory(setting, self.daily)
        self.ahead = _slots_ahead(case.step_h)
        self._read_devices()
        self._read_storage()
        self.blocks = self._blocks()
        self._known: dict[int, Floats] = {}
        scales = [block.scale for block in self.blocks[1:]]
        self._per_scale = 1.0 / np.concatenate([np.array(scale) for scale in scales])[:, None]

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
        self._demand, self._supply = demand, supply
        self._buses = np.flatnonzero(demand.sum(1) + supply.sum(1))
        every = dict.fromkeys(name for fleet in fleets for name in fleet.profiles())
        self.prices = tuple(n for n in every if n is not None and n not in self.names)

    def _read_storage(self) -> None:
        simulator = self.setting.simulator
        self._low = simulator.low
        self._range = np.maximum(simulator.high - simulator.low, 1e-9)

    def _blocks(self) -> tuple[ObservationBlock, ...]:
        simulator, setting = self.setting.simulator, self.setting
        buses = [setting.microgrid.network.bus_names[b] for b in self._buses]
        size = np.maximum(self._demand.sum(1), self._supply.sum(1))[self._buses]
        later = [f"+{k}" for k in self.ahead]
        price = [self._price_scale(name) for name in self.prices]
        lines = setting.lines
        ones = (1.0,) * len(lines)
        both = tuple(size.tolist())
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

    @property
    def size(self) -> int:
        """How many numbers an observation has."""
        return sum(len(block.labels) for block in self.blocks)

    @property
    def schema(self) -> str:
        """A digest of what an observation holds: a policy fits no other."""
        return digest_of_blocks(self.blocks)

    def observed(self, observation: Observation) -> np.ndarray:
        """(batch, numbers) an observation in single precision, as in training; once a slot."""
        energy = observation.energy.astype(np.float32)
        world = self.world(observation).astype(np.float32)
        return np.concatenate([self.storage(energy), world]).T

    def storage(self, energy: np.ndarray) -> np.ndarray:
        """(units, batch) state of charge within its band, 0 to 1, in the precision of `energy`."""
        low, width = (values.astype(energy.dtype) for values in (self._low, self._range))
        return (energy - low) / width

    def world(self, observation: Observation) -> Floats:
        """(numbers but those of storage, batch) what the world is like; once in each slot."""
        self.memory.update(observation)
        t, batch = observation.t, observation.line_up.shape[1]
        case = self.setting.case
        up = observation.line_up[self.memory.lines]
        clock = self.memory.clock(t)
        down_h = np.where(up, 0.0, clock - self.memory.since + 1) * case.step_h
        slots = t + self.ahead
        now = [observation.forecast(name, slots[:1]) for name in self.names]
        demand, supply = self._demand[self._buses], self._supply[self._buses]
        ahead = self._ahead(observation.forecast, slots, batch)
        net, price = ahead[:, : len(self._buses)], ahead[:, len(self._buses) :]
        parts = [
            up,
            down_h,
            self.memory.spent,
            np.repeat(self._clock(t)[:, None], batch, axis=1),
            self._centre(t, observation.centre),
            _weighted(demand, now, 1, batch)[0],
            _weighted(supply, now, 1, batch)[0],
            net.reshape(-1, batch),
            price.swapaxes(0, 1).reshape(-1, batch),
        ]
        world: Floats = np.concatenate(parts)
        return np.multiply(world, self._per_scale, out=world)

    def _ahead(self, forecast: Forecast, slots: Ints, batch: int) -> Floats:
        """(slots, buses + prices, batch) net demand in MW, and prices, that are forecast.

        A forecast without errors says of a slot what it said before, so that is worked out once.
        """
        if self.setting.error_correlation is not None:
            return self._foreseen(forecast, slots, batch)
        by_slot = {s: values for s, values in self._known.items() if s >= slots[0]}
        new = [s for s in slots.tolist() if s not in by_slot]
        if new:
            by_slot |= zip(new, self._foreseen(forecast, np.array(new), batch), strict=True)
        self._known = by_slot
        return np.array([by_slot[s] for s in slots.tolist()])

    def _foreseen(self, forecast: Forecast, slots: Ints, batch: int) -> Floats:
        net = (self._demand - self._supply)[self._buses]
        matrix = np.zeros((len(net) + len(self.prices), net.shape[1] + len(self.prices)))
        matrix[: len(net), : net.shape[1]] = net
        matrix[len(net) :, net.shape[1] :] = np.eye(len(self.prices))
        profiles = [forecast(name, slots) for name in (*self.names, *self.prices)]
        return _weighted(matrix, profiles, len(slots), batch)

    def _clock(self, t: int) -> Floats:
        case = self.setting.case
        angle = 2.0 * np.pi * case.window.slot_of_day(t) / case.window.slots_per_day
        horizon_left = 0.0 if self.daily else 1.0 - t / case.slots
        return np.array([np.sin(angle), np.cos(angle), horizon_left])

    def _centre(self, t: int, centre: Ints) -> Floats:
        """(2, batch) whether the peak is known, and hours until it."""
        is_told = centre >= 0
        hours = centre * 0.25 - self.setting.case.window.slot_of_day(t) * self.setting.case.step_h
        return np.stack([is_told * 1.0, np.where(is_told, hours, 0.0)])


def digest_of_blocks(blocks: Sequence[ObservationBlock]) -> str:
    """A digest of what an observation holds."""
    text = json.dumps([(b.name, b.labels, b.scale) for b in blocks])
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _weighted(matrix: Floats, profiles: list[Floats], slots: int, batch: int) -> Floats:
    """(slots, rows, batch) sums of profiles (slots, batch), term by term: the bits of a product
    would depend on the size of the batch.
    """
    total = np.zeros((slots, len(matrix), batch))
    for row, column in np.argwhere(matrix):
        total[:, row] += matrix[row, column] * profiles[column]
    return total


def _slots_ahead(step_h: float) -> Ints:
    """Slots from now that are observed: every one for two hours, then one an hour."""
    near = np.arange(max(round(HOURS_EXACT / step_h), 1))
    hours = np.arange(HOURS_EXACT, HOURS_AHEAD)
    return np.unique(np.concatenate([near, np.round(hours / step_h).astype(np.intp)]))
