"""What stood in the way of load that was shed, by name and number, in a sentence each."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.models.case_program import CaseProgram, as_switched
from resilience.models.components import DeviceFleet, in_roles
from resilience.planning.reading.reasons import (
    AT_LIMIT,
    ShedLoad,
    at_angle,
    behind,
    reactive_room,
    source_limits,
    voltage_limits,
)
from resilience.tolerances import AT_LIMIT_TOLERANCE

MAX_NAMED = 4
"""Names in a sentence, before the others are only counted."""
_LACKING = (("energy", "saved"), ("fuel", "fuel saved"))
"""Reasons that tell of one lack, of storage and of tanks."""


def shed_causes(
    program: CaseProgram, z: Floats, loads: Sequence[ShedLoad]
) -> dict[str, dict[str, str]]:
    """A sentence per load and reason, {load: {reason: sentence}}.

    Args:
        program: what was solved.
        z: (columns,) its settled point.
        loads: what was shed, see `reasons.shed_loads`.
    """
    facts = _Facts(program, z, tuple(loads))
    causes: dict[str, dict[str, str]] = {}
    for entry in loads:
        sentence = _SENTENCES[entry.reason](facts, entry)
        causes.setdefault(entry.fleet.names[entry.row], {})[entry.reason] = sentence
    return causes


@dataclass(frozen=True)
class _Facts:
    """What sentences are made of.

    Attributes:
        program: what was solved.
        z: (columns,) its point.
        loads: what was shed.
    """

    program: CaseProgram
    z: Floats
    loads: tuple[ShedLoad, ...]

    @cached_property
    def island(self) -> Ints:
        """(buses, slots) number of every bus's island."""
        return as_switched(self.program, self.z).island

    @cached_property
    def shed_at(self) -> Floats:
        """(buses, slots) MW shed."""
        shed = np.zeros(self.island.shape)
        for entry in self.loads:
            np.add.at(shed, (entry.fleet.bus[entry.row], entry.slots), entry.mw)
        return shed

    @cached_property
    def shed_in(self) -> Floats:
        """(islands, slots) MW shed."""
        shed = np.zeros((int(self.island.max()) + 1, self.island.shape[1]))
        np.add.at(shed, (self.island, np.arange(self.island.shape[1])), self.shed_at)
        return shed

    @cached_property
    def sources(self) -> list[tuple[DeviceFleet, Bools, Bools]]:
        """Every fleet that feeds in, and (devices, slots) which are at a limit, and have none."""
        every = self.program.microgrid.fleets.values()
        fleets = in_roles(every, "storage", "dispatchable", "weather", "exchange")
        return [(fleet, *source_limits(self.program, self.z, fleet)) for fleet in fleets]

    @cached_property
    def behind(self) -> dict[str, dict[int, Bools]]:
        """By reason what is behind lines at such a limit, see `reasons.behind`."""
        return {
            reason: behind(self.program, self.z, at_limit(self.program, self.z))
            for reason, at_limit in AT_LIMIT.items()
        }

    def over(self, entry: ShedLoad) -> Iterator[tuple[int, Ints, float]]:
        """Lines at their limit before the load, the slots, and MW over if nothing were shed."""
        bus = entry.fleet.bus[entry.row]
        for k, buses in self.behind[entry.reason].items():
            slots = entry.slots[buses[bus, entry.slots]]
            if len(slots):
                yield k, slots, float((self.shed_at * buses)[:, slots].sum(axis=0).max())

    def numbers(self, entry: ShedLoad) -> Ints:
        """(slots shed,) the load's island in each of these."""
        return self.island[entry.fleet.bus[entry.row], entry.slots]

    def beside(self, fleet: DeviceFleet, entry: ShedLoad) -> Bools:
        """(devices, slots shed) whether a device stands in the load's island."""
        return self.island[fleet.bus][:, entry.slots] == self.numbers(entry)

    def short_mw(self, entry: ShedLoad) -> float:
        """The greatest power that the load's island sheds in these slots, MW."""
        return float(self.shed_in[self.numbers(entry), entry.slots].max())

    def lack(self, entry: ShedLoad) -> str:
        """`its island lacks 2.1 MWh until 18:45`, in all slots for want of what this one lacks."""
        kind = next(pair for pair in _LACKING if entry.reason in pair)
        islands = {
            (int(number), int(t))
            for alike in self.loads
            if alike.reason in kind
            for number, t in zip(self.numbers(alike), alike.slots, strict=True)
        }
        bus = int(entry.fleet.bus[entry.row])
        slots = [t for t in range(self.island.shape[1]) if (int(self.island[bus, t]), t) in islands]
        mw = float(self.shed_in[self.island[bus, slots], slots].sum())
        until = self.until(slots[-1] + 1)
        return f"its island lacks {mw * self.program.case.step_h:.3g} MWh until {until}"

    def until(self, slot: int) -> str:
        """When a slot begins; `24:00` at the end of a day."""
        window = self.program.case.window
        text = window.text(window.time(slot))
        is_end = text.endswith("00:00") and not window.longer_than_a_day
        return "24:00" if is_end else text


def _no_source(facts: _Facts, entry: ShedLoad) -> str:
    here = facts.island[:, entry.slots[0]] == facts.numbers(entry)[0]
    rows = np.flatnonzero(here[facts.program.microgrid.bus_of]).tolist()
    buses = [facts.program.case.network.bus_names[k] for k in rows]
    word = "bus" if len(buses) == 1 else "buses"
    return f"no grid-forming unit stands or runs in its island, {word} {listed(buses)}"


def _power(facts: _Facts, entry: ShedLoad) -> str:
    at_limit = []
    for fleet, full, _ in facts.sources:
        feeds = fleet.power(lambda name: facts.program.values(name, facts.z)) > AT_LIMIT_TOLERANCE
        holds = ((full & feeds)[:, entry.slots] & facts.beside(fleet, entry)).any(axis=1)
        at_limit += [fleet.names[k] for k in np.flatnonzero(holds).tolist()]
    short = f"{facts.short_mw(entry):.3g} MW short"
    if not at_limit:
        return f"sources of its island have nothing to give, {short}"
    return f"sources of its island are at their limits: {listed(at_limit)}, {short}"


def _lacks(facts: _Facts, entry: ShedLoad) -> str:
    words = {
        "energy": ("storage {} is empty", "storage of its island is empty"),
        "saved": ("storage {} saves what it has for later", "storage saves what it has for later"),
        "fuel": ("tank {} is empty", "a tank is empty"),
        "fuel saved": ("tank {} is kept for later", "tanks are kept for later"),
    }
    named, unnamed = words[entry.reason]
    is_storage, is_empty = entry.reason in _LACKING[0], not entry.reason.endswith("saved")
    names: dict[str, None] = {}
    for fleet, full, starved in facts.sources:
        if (fleet.role == "storage") != is_storage:
            continue
        later = np.logical_or.accumulate(starved[:, ::-1], axis=1)[:, ::-1]
        holds = starved & ~full if is_empty else ~(full | starved) & later
        rows = (holds[:, entry.slots] & facts.beside(fleet, entry)).any(axis=1)
        for k in np.flatnonzero(rows).tolist():
            name = fleet.names[k] if is_storage else str(getattr(fleet.tables[k], "tank", ""))
            names.setdefault(name)
    clause = named.format(listed(names)) if names else unnamed
    return f"{clause}; {facts.lack(entry)}"


def _reactive(facts: _Facts, entry: ShedLoad) -> str:
    names: list[str] = []
    for fleet, *_ in facts.sources:
        bus, room = reactive_room(facts.program, facts.z, fleet)
        if len(bus):
            here = (facts.island[bus][:, entry.slots] == facts.numbers(entry)).any(axis=1)
            full = here & ~room[:, entry.slots].any(axis=1)
            labels = facts.program.standard.labels(fleet.reactive)
            names += [labels[k] for k in np.flatnonzero(full).tolist()]
    whose = listed(names) if names else "its island"
    return f"reactive power of {whose} is at its limit (s_mva, q_max_mvar)"


def _voltage(facts: _Facts, entry: ShedLoad) -> str:
    here = facts.island[:, entry.slots] == facts.numbers(entry)
    squares = facts.z[facts.program.standard.columns("bus.v_sq")][:, entry.slots]
    lowest, highest = voltage_limits(facts.program, facts.z)
    names, ends = facts.program.microgrid.network.bus_names, []
    for holds in (lowest, highest):
        k, column = np.argwhere(holds[:, entry.slots] & here)[0]
        ends.append((names[k], np.sqrt(max(squares[k, column], 0.0))))
    (low, low_pu), (high, high_pu) = ends
    return (
        f"bus {low} is at {low_pu:.4g} pu, the least allowed, and bus {high} at {high_pu:.4g} pu, "
        "the most"
    )


def _rating(facts: _Facts, entry: ShedLoad) -> str:
    network = facts.program.microgrid.network
    return "; ".join(
        f"line {network.line_names[k]} is at its rating of {network.rating_mva[k]:g} MVA, "
        f"{short:.3g} MW over if nothing behind it were shed"
        for k, _, short in facts.over(entry)
    )


def _angle(facts: _Facts, entry: ShedLoad) -> str:
    network, parts = facts.program.microgrid.network, []
    leads = at_angle(facts.program, facts.z, "line.angle_max")
    for k, slots, short in facts.over(entry):
        limits = network.angle_max_degree if leads[k, slots].any() else network.angle_min_degree
        parts.append(
            f"line {network.line_names[k]} is at its limit of {limits[k]:g} degrees between its "
            f"ends, {short:.3g} MW over if nothing behind it were shed"
        )
    return "; ".join(parts)


def _block(facts: _Facts, entry: ShedLoad) -> str:
    demand = facts.program.values(entry.fleet.demand, facts.z)[entry.row, entry.slots]
    return f"the load can only be served whole: {demand.max():.3g} MW at once"


def _price(facts: _Facts, entry: ShedLoad) -> str:
    price = getattr(entry.fleet.tables[entry.row], "shed_cost_per_mwh", None)
    dear = "" if price is None else f" at {price:g} $/MWh"
    return f"shedding{dear} is cheaper than more of the sources, or limits such as ramps hold them"


_SENTENCES: Mapping[str, Callable[[_Facts, ShedLoad], str]] = {
    "no source": _no_source,
    "power": _power,
    "energy": _lacks,
    "fuel": _lacks,
    "saved": _lacks,
    "fuel saved": _lacks,
    "reactive": _reactive,
    "voltage": _voltage,
    "rating": _rating,
    "angle": _angle,
    "block": _block,
    "price": _price,
}
"""What says it, by the keys of `REASONS`."""


def listed(names: Iterable[str]) -> str:
    """`ess1, ess2, ess3, ess4 and 3 more`."""
    every = list(names)
    more = f" and {len(every) - MAX_NAMED} more" if len(every) > MAX_NAMED else ""
    return ", ".join(every[:MAX_NAMED]) + more
