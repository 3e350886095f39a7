"""Steps per second of the batched simulator, beside a step written by hand in NumPy."""

from __future__ import annotations

import copy
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from bench.row import Row, timed
from resilience.arrays import Floats
from resilience.case import Case, TankTable, load_case
from resilience.case.document import Document
from resilience.case.load import build_case
from resilience.models.microgrid import Microgrid
from resilience.models.simulator import NetworkSimulator, Simulator

TURNS, CALLS = 7, 20
AGREEMENT = 1e-9
MAX_FUEL_RATIO = 1.0 / 0.7
Outcome = tuple[Floats, Floats, Floats, Floats]


def one_bus(case: Case) -> Case:
    """The same devices, all on one bus."""
    data = copy.deepcopy(case.source)
    data |= {"name": f"{case.name}-one-bus", "network": {"bus": [{"name": "1", "vn_kv": 12.66}]}}
    for key in ("line", "outages"):
        data.pop(key, None)
    for kind in ("ess", "pv", "generator", "load", "grid"):
        for table in data[kind]:
            table["bus"] = "1"
    return build_case(Document(case.path, data))


@dataclass
class Bench:
    """A simulator and a batch of members in one slot, each with outages of its own."""

    simulator: Simulator | NetworkSimulator
    line_up: np.ndarray
    energy: Floats
    action: Floats
    data: Floats
    island: np.ndarray
    fuel: Floats | None = None

    @classmethod
    def for_case(cls, case: Case, batch: int) -> Bench:
        simulator = Simulator(Microgrid.build(case, "copperplate"), case.step_h)
        rng = np.random.default_rng(0)
        up = np.ones((len(case.network.line_names), batch), bool)
        up[case.network.breakpoint] = rng.random((case.network.breakpoint.sum(), batch)) < 0.5
        energy = rng.uniform(simulator.low, simulator.high, (len(simulator.units), batch))
        action = rng.uniform(-2.0, 2.0, energy.shape)
        bench = cls(simulator, up, energy, action, np.empty(0), np.empty(0))
        bench.data, bench.island = bench.slot_data()
        if simulator.tanks:
            bench.fuel = np.repeat(simulator.tank_capacity, batch, axis=1)
        return bench

    def slot_data(self) -> tuple[Floats, np.ndarray]:
        """Data and islands of the slot, as every slot of an episode needs them."""
        case, batch = self.simulator.microgrid.case, self.line_up.shape[1]
        slot = case.slots // 2

        def profile(name: str | None) -> Floats:
            return np.full(batch, case.profile(name)[slot])

        situation = self.simulator.microgrid.situation(self.line_up, profile)
        return self.simulator.stacked(self.simulator.microgrid.data(situation)), situation.island

    def step(self) -> Outcome:
        step = self.simulator.step(self.energy, self.action, self.data, self.island, self.fuel)
        return step.energy, step.cost, step.charge, step.discharge

    def with_flows(self) -> Floats:
        """Flows of every device, which a step works out only when they are asked for."""
        return self.simulator.step(self.energy, self.action, self.data, self.island).flows

    def with_data(self) -> Floats:
        """The same with data and islands of the slot worked out anew."""
        data, island = self.slot_data()
        return self.simulator.step(self.energy, self.action, data, island).flows

    def named(self, name: str) -> Floats:
        """(devices, batch) of the data."""
        block = next(b for b in self.simulator.form.stage.datums if b.name == name)
        return self.data[block.slice]


class Hand:
    """What one would write for this case alone: storage, PV, one grid, generators and loads on one
    bus, one price for each kind, everything summed up before anything is compared.
    """

    def __init__(self, bench: Bench) -> None:
        case = bench.simulator.microgrid.case
        units, dt = case.ess, case.step_h
        size = np.array([[u.e_mwh] for u in units])
        self.low, self.high = units[0].soc_min * size, units[0].soc_max * size
        self.p_max = np.array([[u.p_max_mw] for u in units])
        self.gain, self.drain = dt * units[0].efficiency_charge, dt / units[0].efficiency_discharge
        self.generators = np.array([[g.p_max_mw] for g in case.generator])
        self.total = self.generators.sum()
        prices = (
            units[0].degradation_cost_per_mwh,
            case.grid[0].import_cost_per_mwh or 0.0,
            case.grid[0].export_cost_per_mwh,
            case.generator[0].cost_per_mwh,
            case.load[0].shed_cost_per_mwh,
        )
        self.wear, self.buy, self.sell, self.fuel, self.shed = (dt * price for price in prices)
        self.energy, self.action = bench.energy, bench.action
        self.load, self.sun = bench.named("load.demand"), bench.named("pv.available")
        self.bring, self.send = bench.named("grid.import_max")[0], bench.named("grid.export_max")[0]

    def step(self) -> Outcome:
        return self._closed()[:4]

    def with_flows(self) -> Floats:
        """(columns, batch) in the order of the simulator's."""
        *_, shares, bought, sold = self._closed()
        shed, sun, generated = shares
        return np.concatenate(
            [
                self.load * shed,
                self.sun * sun,
                self.generators * generated,
                bought[None],
                sold[None],
            ]
        )

    def _closed(self) -> tuple:  # type: ignore[type-arg]
        energy = self.energy
        low = -np.minimum(self.p_max, (energy - self.low) / self.drain)
        high = np.minimum(self.p_max, (self.high - energy) / self.gain)
        net = np.minimum(np.maximum(self.action, low), high)
        charge, discharge = np.maximum(net, 0.0), np.maximum(-net, 0.0)
        load, sun = self.load.sum(0), self.sun.sum(0)
        need = load + net.sum(0)
        lit = np.minimum(np.maximum(need, 0.0), sun)
        need = need - lit
        sold = np.minimum(np.maximum(-need, 0.0), self.send)
        bought = np.minimum(np.maximum(need, 0.0), self.bring)
        need = need + sold - bought
        generated = np.minimum(np.maximum(need, 0.0), self.total)
        need = need - generated
        shed = np.minimum(np.maximum(need, 0.0), load)
        need = need - shed
        if np.abs(need).max() > 1e-12:
            charge = charge * (1.0 - np.maximum(need, 0.0) / np.maximum(charge.sum(0), 1e-12))
            surplus = np.maximum(-need, 0.0)
            discharge = discharge * (1.0 - surplus / np.maximum(discharge.sum(0), 1e-12))
        after = energy + self.gain * charge - self.drain * discharge
        cost = (
            self.wear * discharge.sum(0)
            + self.buy * bought
            + self.sell * sold
            + self.fuel * generated
            + self.shed * shed
        )
        shares = shed / load, lit / np.maximum(sun, 1e-12), generated / self.total
        return after, cost, charge, discharge, shares, bought, sold


@contextmanager
def one_core() -> Iterator[None]:
    """Runs on one core, where the system can be told to."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)


def race(*calls: Callable[[], object]) -> list[float]:
    """Median seconds of each call, taken in turns."""
    spent: list[list[float]] = [[] for _ in calls]
    for call in calls:
        call()
    for _ in range(TURNS):
        for k, call in enumerate(calls):
            spent[k] += [timed(call)[0] for _ in range(CALLS)]
    return [float(np.median(seconds)) for seconds in spent]


def rate(name: str, batch: int, seconds: float, min_rate: float | None) -> Row:
    per_second = batch / seconds
    target = "" if min_rate is None else f">= {min_rate:.2g}/s"
    met = None if min_rate is None else per_second >= min_rate
    note = f"{1e3 * seconds:.3g} ms per batch of {batch}"
    return Row(name, f"{per_second:.3g}/s", target, met, note)


def within(name: str, ours: float, theirs: float, max_ratio: float | None) -> Row:
    note = f"{1e3 * ours:.3g} ms against {1e3 * theirs:.3g} ms"
    times = ours / theirs
    target, met = ("", None) if max_ratio is None else (f"<= {max_ratio:g}x", times <= max_ratio)
    return Row(name, f"{times:.2f}x", target, met, note)


def stepping() -> Iterator[Row]:
    """One bus against the step by hand, then islands; asserted equal in cost, states and flows."""
    single = Bench.for_case(one_bus(load_case("ieee33")), 4096)
    gone = np.random.default_rng(1).random(4096) < 0.5
    single.named("grid.import_max")[0, gone] = 0.0
    single.named("grid.export_max")[0, gone] = 0.0
    hand = Hand(single)
    for ours, theirs in zip(single.step(), hand.step(), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=AGREEMENT)
    np.testing.assert_allclose(single.with_flows(), hand.with_flows(), atol=AGREEMENT)
    with one_core():
        ours, theirs = race(single.step, hand.step)
        yield rate("step, 5 storage units on one bus", 4096, ours, 1e6)
        yield within("the same over a step by hand", ours, theirs, 3.0)
        ours, theirs, slot = race(single.with_flows, hand.with_flows, single.with_data)
        yield within("the same, every device's power worked out", ours, theirs, None)
        yield rate("the same with data and islands of the slot", 4096, slot, None)
        islands = Bench.for_case(load_case("ieee33"), 1024)
        ours, slot = race(islands.step, islands.with_data)
        yield rate("step, 33 buses with islands", 1024, ours, 2e5)
        yield rate("the same with data, islands and every device's power", 1024, slot, None)
        yield from fuelled(islands)
        yield rate("step, 33 buses with voltages (a linear program each)", 64, wired(64), None)


def fuelled(islands: Bench) -> Iterator[Row]:
    """The same with one tank for all generators, full, and too low in a tenth of the members."""
    case = islands.simulator.microgrid.case
    fuel = {"tank": "tank", "fuel_m3_per_mwh": 0.25}
    units = [unit.model_copy(update=fuel) for unit in case.generator]
    tank = TankTable(name="tank", capacity_m3=20.0)
    full = Bench.for_case(case.replace(tank=[tank], generator=units), islands.energy.shape[1])
    low = copy.copy(full)
    low.fuel = full.fuel * np.where(np.arange(islands.energy.shape[1]) % 10 == 0, 1e-4, 1.0)
    ours, theirs, short = race(full.step, islands.step, low.step)
    yield within("the same with a tank, over without", ours, theirs, MAX_FUEL_RATIO)
    yield within("the same, too low in a tenth of the batch", short, theirs, None)


def wired(batch: int) -> float:
    """Seconds of a step on the feeder at lindistflow."""
    case = load_case("ieee33")
    simulator = NetworkSimulator(Microgrid.build(case, "lindistflow"), case.step_h)
    bench = Bench.for_case(case, batch)
    bench.simulator = simulator
    bench.data, bench.island = bench.slot_data()
    bench.step()
    return float(np.median([timed(bench.step)[0] for _ in range(3)]))
