"""What a plan asks operators to do, as a list: who does what, from when to when.

Slots in a row in which a unit does the same are one instruction, and so are those with a pause of
an hour or less between them. What a generator with commitment does is not joined over pauses: a
start costs money. Powers are means over slots.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from resilience.arrays import Bools, Floats
from resilience.models.components import DeviceFleet, device_fleets, in_roles
from resilience.planning.tables import SlotTable, available_table

if TYPE_CHECKING:
    from resilience.case import Case

Verb = Literal["charge", "discharge", "run", "curtail", "shed", "open", "close"]
PAUSE_H = 1.0
"""Longest pause within an instruction."""
NOTABLE_SHARE = 1e-3
"""Of a unit's size, below which nothing is asked of it."""


@dataclass(frozen=True)
class Instruction:
    """What one unit is asked to do.

    Attributes:
        first: slot in which it begins.
        stop: first slot behind it; of a switch, that in which it begins.
        verb: what to do.
        unit: name of the device or line.
        low_mw: least mean power of its slots, MW; nothing in a pause. NaN for switches.
        high_mw: greatest, likewise.
        stored_mwh: what a storage holds at the end, MWh; NaN for others.
    """

    first: int
    stop: int
    verb: Verb
    unit: str
    low_mw: float = float("nan")
    high_mw: float = float("nan")
    stored_mwh: float = float("nan")


def instructions(case: Case, tables: Mapping[str, SlotTable]) -> list[Instruction]:
    """What the tables of a plan ask for, in time; see `tables.table_units` for these.

    Args:
        case: the case as solved.
        tables: of all slots, or of the first ones.
    """
    to_do = [
        item
        for fleet in in_roles(
            device_fleets(case).values(), "storage", "dispatchable", "weather", "load"
        )
        for name, size in zip(fleet.names, fleet.size_mw(), strict=True)
        for item in _SERIES[fleet.role](case, tables, fleet, name, float(size))
    ]
    to_do += _of_switches(case, tables)
    return sorted(to_do, key=lambda item: (item.first, item.stop))


def _storage(
    case: Case, tables: Mapping[str, SlotTable], fleet: DeviceFleet, name: str, size: float
) -> Iterator[Instruction]:
    power = tables["power"][name]
    verbs: tuple[tuple[Verb, float], ...] = (("charge", -1.0), ("discharge", 1.0))
    for verb, sign in verbs:
        # The other way counts as no pause.
        against = sign * power < -NOTABLE_SHARE * size
        for item in _spans(case, verb, name, sign * power, size, ~against):
            yield replace(item, stored_mwh=float(tables["energy"][name][item.stop - 1]))


def _dispatchable(
    case: Case, tables: Mapping[str, SlotTable], fleet: DeviceFleet, name: str, size: float
) -> Iterator[Instruction]:
    mw, on = tables["power"][name], tables.get("on")
    if on is None or name not in on.labels:
        yield from _spans(case, "run", name, mw, size)
        return
    for first, stop in _runs(on[name] > 0.5):
        yield _instruction(first, stop, "run", name, mw)


def _weather(
    case: Case, tables: Mapping[str, SlotTable], fleet: DeviceFleet, name: str, size: float
) -> Iterator[Instruction]:
    offered = tables.get(available_table(fleet))
    if offered is not None:
        yield from _spans(case, "curtail", name, offered[name] - tables["power"][name], size)


def _load(
    case: Case, tables: Mapping[str, SlotTable], fleet: DeviceFleet, name: str, size: float
) -> Iterator[Instruction]:
    yield from _spans(case, "shed", name, tables["shed"][name], size)


_SERIES = {
    "storage": _storage,
    "dispatchable": _dispatchable,
    "weather": _weather,
    "load": _load,
}
"""What is asked of a device, by the role of its fleet."""


def _of_switches(case: Case, tables: Mapping[str, SlotTable]) -> Iterator[Instruction]:
    """Changes of the position of switchable lines; while one is out, it keeps its position."""
    closed, network = tables.get("line_closed"), case.network
    if closed is None:
        return
    for k in np.flatnonzero(network.switchable).tolist():
        name = network.line_names[k]
        is_out = np.zeros(closed.values.shape[1], bool)
        for outage in case.outages:
            if outage.line == name:
                is_out[outage.first : outage.stop] = True
        position = bool(network.in_service[k])
        for t in np.flatnonzero(~is_out).tolist():
            if bool(closed[name][t] > 0.5) != position:
                position = not position
                yield Instruction(t, t, "close" if position else "open", name)


def _spans(
    case: Case, verb: Verb, name: str, mw: Floats, size: float, may_pause: Bools | None = None
) -> Iterator[Instruction]:
    """Slots in which a power is worth a word, joined over short pauses where these may be."""
    runs = _runs(mw > NOTABLE_SHARE * size)
    joined: list[tuple[int, int]] = []
    for first, stop in runs:
        start, before = joined[-1] if joined else (first, first)
        is_short = 0 < first - before <= PAUSE_H / case.step_h
        if is_short and (may_pause is None or bool(may_pause[before:first].all())):
            joined[-1] = (start, stop)
        else:
            joined.append((first, stop))
    for first, stop in joined:
        yield _instruction(first, stop, verb, name, mw)


def _instruction(first: int, stop: int, verb: Verb, unit: str, mw: Floats) -> Instruction:
    """One of these slots, powers from all of them."""
    powers = np.maximum(mw[first:stop], 0.0)
    return Instruction(first, stop, verb, unit, float(powers.min()), float(powers.max()))


def _runs(is_asked: Bools) -> list[tuple[int, int]]:
    """(first, stop) of slots in a row."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], is_asked.astype(int), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
