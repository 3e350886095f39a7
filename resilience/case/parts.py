"""The parts of a case under construction, and how its `[network]` becomes one of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from resilience.case.document import Document
from resilience.case.feeder import FeederError, finish_network, read_feeder
from resilience.case.network import Network, did_you_mean
from resilience.case.schema import BranchTable, BusTable, LineTable, NetworkTable
from resilience.case.tables import read_list, read_table, show
from resilience.case.window import Window


@dataclass
class Parts:
    """A case under construction. What could not be read is `None`, or missing from its list.

    A network that is not `complete` lacks entries that were wrong; its names can be checked, its
    connections cannot.
    """

    document: Document
    window: Window | None = None
    network: Network | None = None
    complete: bool = True
    inline_lines: list[tuple[BranchTable, str]] = field(default_factory=list)
    lines: list[tuple[LineTable, str]] = field(default_factory=list)
    devices: dict[str, list[tuple[Any, str]]] = field(default_factory=dict)

    def all_devices(self) -> Iterator[tuple[str, Any, str]]:
        """Yield `(kind, table, title)` of every device."""
        for kind, entries in self.devices.items():
            for table, title in entries:
                yield kind, table, title

    def read_network(self, raw: Any) -> None:
        """Read `[network]` and, as far as they are sound, the `[[line]]` tables into a network."""
        inline = {}
        if isinstance(raw, dict):
            inline = {key: raw[key] for key in ("bus", "line") if key in raw}
            raw = {key: value for key, value in raw.items() if key not in inline}
        table, sound = read_table(NetworkTable, raw, self.document, "[network]", ("network",))
        buses, branches = self._read_inline(inline)
        if not sound:
            return
        table = table.model_copy(update={"bus": buses, "line": branches})
        try:
            network = read_feeder(table).network
        except FeederError as error:
            key, *rest = error.args
            self.document.add(("network", key), "[network]", key, *rest)
            return
        lines = [line for line, _ in self.lines if line.name and network.has_line(line.name)]
        self.network = finish_network(network, table, lines)

    def _read_inline(
        self, inline: dict[str, Any]
    ) -> tuple[tuple[BusTable, ...], tuple[BranchTable, ...]]:
        bus_where, line_where = ("network", "bus"), ("network", "line")
        read = read_list(BusTable, "network.bus", inline.get("bus", []), self.document, bus_where)
        buses: dict[str, BusTable] = {}
        for bus, title, sound in read:
            if bus.name in buses:
                hint = "every bus has a name of its own"
                self.document.add(bus_where, title, "name", show(bus.name), "names used once", hint)
            elif sound:
                buses[bus.name] = bus
            self.complete &= sound
        known = {bus.name for bus, _, _ in read if bus.name}
        branches = []
        names: set[str] = set()
        entries = read_list(
            BranchTable, "network.line", inline.get("line", []), self.document, line_where
        )
        for line, title, sound in entries:
            fits = self._check_ends(line, title, known, buses)
            if line.name and line.name in names:
                hint = "every line has a name of its own; without one it is called from-to"
                self.document.add(
                    line_where, title, "name", show(line.name), "names used once", hint
                )
            names.add(line.name or "")
            if sound and fits:
                branches.append(line)
                self.inline_lines.append((line, title))
            self.complete &= sound and fits
        return tuple(buses.values()), tuple(branches)

    def _check_ends(
        self, line: BranchTable, title: str, known: set[str], buses: dict[str, BusTable]
    ) -> bool:
        """Note what is wrong with the ends of an inline line; say whether it can be used."""
        where, ends = ("network", "line"), (line.from_, line.to)
        for key, bus in zip(("from", "to"), ends, strict=True):
            if bus and bus not in known:
                hint = did_you_mean(bus, known)
                self.document.add(where, title, key, show(bus), "a bus of the network", hint)
        if not all(bus in buses for bus in ends):
            return False
        if line.from_ == line.to:
            hint = "a line joins two buses"
            self.document.add(where, title, "to", show(line.to), "another bus than `from`", hint)
            return False
        vn_kv = [buses[bus].vn_kv for bus in ends]
        if vn_kv[0] != vn_kv[1]:
            found = f"{vn_kv[0]:g} kV at one end, {vn_kv[1]:g} kV at the other"
            hint = "put a transformer into a pandapower file, or give both buses one vn_kv"
            self.document.add(where, title, "vn_kv", found, "one nominal voltage", hint)
            return False
        return True
