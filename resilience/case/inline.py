"""Inline networks: the `[[network.bus]]` and `[[network.line]]` tables of a case file."""

from __future__ import annotations

from dataclasses import dataclass, field

from resilience.case.document import Document
from resilience.case.reading import read_list, show
from resilience.case.schema import BranchTable, BusTable
from resilience.errors import did_you_mean

_BUS, _LINE = ("network", "bus"), ("network", "line")


@dataclass
class Inline:
    """An inline network as far as it is sound.

    Attributes:
        buses: sound `[[network.bus]]` tables by name.
        lines: sound `[[network.line]]` tables with their titles in messages.
        bus_names: of all buses, unsound ones included.
        line_names: of all lines, unsound ones included.
        complete: everything is sound.
    """

    buses: dict[str, BusTable] = field(default_factory=dict)
    lines: list[tuple[BranchTable, str]] = field(default_factory=list)
    bus_names: set[str] = field(default_factory=set)
    line_names: set[str] = field(default_factory=set)
    complete: bool = True


def read_inline(document: Document, buses: object, lines: object) -> Inline:
    """Checks the tables of an inline network; mistakes go to the document."""
    inline = Inline()
    entries = read_list(BusTable, "network.bus", buses, document, _BUS)
    for bus, title, sound in entries:
        if bus.name in inline.buses:
            hint = "every bus has a name of its own"
            document.add(_BUS, title, "name", show(bus.name), "names used once", hint)
        elif sound:
            inline.buses[bus.name] = bus
        inline.complete &= sound
    inline.bus_names = {bus.name for bus, _, _ in entries if bus.name}
    for line, title, sound in read_list(BranchTable, "network.line", lines, document, _LINE):
        if line.name and line.name in inline.line_names:
            hint = "every line has a name of its own; without one it is called from-to"
            document.add(_LINE, title, "name", show(line.name), "names used once", hint)
        inline.line_names.add(line.name or f"{line.from_}-{line.to}")
        usable = _check_ends(document, line, title, inline) and sound
        if usable:
            inline.lines.append((line, title))
        inline.complete &= usable
    return inline


def _check_ends(document: Document, line: BranchTable, title: str, inline: Inline) -> bool:
    """Notes what is wrong with the ends of a line; whether both are sound buses that fit."""
    ends = (line.from_, line.to)
    for key, bus in zip(("from", "to"), ends, strict=True):
        if bus and bus not in inline.bus_names:
            allowed, hint = "a [[network.bus]]", did_you_mean(bus, inline.bus_names)
            document.add(_LINE, title, key, show(bus), allowed, hint)
    if not all(bus in inline.buses for bus in ends):
        return False
    if line.from_ == line.to:
        allowed, hint = "another bus than at `from`", "a line joins two buses"
        document.add(_LINE, title, "to", show(line.to), allowed, hint)
        return False
    from_kv, to_kv = (inline.buses[bus].vn_kv for bus in ends)
    if from_kv != to_kv and line.tap_ratio is None:
        value = f"{from_kv:g} kV at one end, {to_kv:g} kV at the other"
        hint = "add tap_ratio = 1.0 if it is a transformer, or give both buses one vn_kv"
        document.add(_LINE, title, "vn_kv", value, "one nominal voltage", hint)
        return False
    if line.shift_degree and line.tap_ratio is None:
        value, allowed = f"{line.shift_degree:g}", "0 without a tap_ratio"
        document.add(_LINE, title, "shift_degree", value, allowed, "add tap_ratio = 1.0")
        return False
    return True
