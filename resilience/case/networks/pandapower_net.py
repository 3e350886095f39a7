"""pandapower networks as feeders: buses, branches and switches.

Closed bus-bus switches fuse buses. Branches are in `pandapower_branches`, what flows to earth at
buses is here, and what is left out is listed.
"""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from pathlib import Path

from resilience.case.networks.feeder import (
    V_MAX_PU,
    V_MIN_PU,
    Branch,
    Feeder,
    FeederError,
    make_network,
)
from resilience.case.networks.omissions import omission
from resilience.case.networks.pandapower_branches import branches_of, hanging_at_dead_buses
from resilience.case.networks.pandapower_devices import devices, impedance_of_load
from resilience.case.networks.pandapower_omissions import omissions
from resilience.case.networks.pandapower_tables import (
    Row,
    Tables,
    active,
    number,
    source_names,
    tables_of_file,
    tables_of_name,
)

_REFUSED = {
    "trafo3w": "three-winding transformer",
    "dcline": "DC line",
    "line_dc": "DC line",
    "tcsc": "series compensator",
    "vsc": "converter",
    "b2b_vsc": "back-to-back converter",
}
_ENDS = ("bus", "from_bus", "to_bus", "hv_bus", "lv_bus")
_PERCENT = ("max_loading_percent",)
_POSITIVE = {
    "bus": ("vn_kv",),
    "line": ("length_km", "parallel", "df", *_PERCENT),
    "trafo": ("sn_mva", "vn_hv_kv", "vn_lv_kv", "parallel", "df", *_PERCENT),
    "impedance": ("sn_mva",),
}
"""Columns that scale others: 0 or less makes energy, or divides by nothing."""
_NEEDED = {
    "bus": ("vn_kv",),
    "line": ("length_km",),
    "trafo": ("sn_mva", "vn_lv_kv"),
    "impedance": ("sn_mva",),
}


@cache
def feeder_by_name(name: str) -> Feeder:
    """A network of `pandapower.networks` that needs no argument.

    Raises:
        FeederError: there is no such network, or it has devices that a case cannot have.
    """
    return feeder_from_tables(tables_of_name(name), "pandapower", name)


def feeder_from_json(path: Path) -> Feeder:
    """The network of a file written by `pandapower.to_json`.

    Raises:
        FeederError: it is no such file, or has devices that a case cannot have.
    """
    try:
        return feeder_from_tables(tables_of_file(path), "file", path.name)
    except (KeyError, TypeError, ValueError) as error:
        hint = "write the file with pandapower.to_json(net, path)"
        value = f"{path.name}: {error!r}"
        raise FeederError(("file", value, "complete tables", hint)) from None


def feeder_from_tables(tables: Tables, key: str, source: str) -> Feeder:
    """A feeder from the tables of a network.

    Args:
        tables: of the network.
        key: of `[network]` that names the source.
        source: what it says there.

    Raises:
        FeederError: what is wrong with it; all of it together.
    """
    rows = list(active(tables, "bus"))
    names = source_names(rows) or {int(r["index"]): str(int(r["index"]) + 1) for r in rows}
    refused = [(key, f"{source}: {v}", allowed, hint) for v, allowed, hint in _unsound(tables)]
    if refused:
        raise FeederError(*refused)
    vn_kv = {names[int(r["index"])]: number(r, "vn_kv", math.nan) for r in rows}
    aliases = _fuse(tables, names)
    buses = [(name, vn) for name, vn in vn_kv.items() if name not in aliases]
    every = list(branches_of(tables, names, vn_kv))
    branches = [branch for branch in every if not _loop(branch, aliases)]
    limits, pinned = _limits(tables, names, aliases)
    shunts = _sums([*_shunts(tables, names, vn_kv), *hanging_at_dead_buses(tables, names, vn_kv)])
    network = make_network(buses, branches, aliases, limits=limits, shunts=shunts)
    units = devices(tables, names, aliases)
    return Feeder(
        network,
        **units.groups(),
        places=_places(rows, names),
        omissions=(
            *omissions(tables, names, [b.title for b in every if _loop(b, aliases)]),
            *omission(
                "load bus of one fixed voltage",
                [(bus, 0.0) for bus in pinned],
                instead=f"free from {V_MIN_PU:g} to {V_MAX_PU:g} pu",
            ),
            *units.omissions,
        ),
    )


def _unsound(tables: Tables) -> Iterator[tuple[str, str, str]]:
    """`(value, allowed, hint)` of what no later check of the network could see."""
    for kind, words in _REFUSED.items():
        for row in active(tables, kind):
            value = f"has a {words} ({row.get('name') or row['index']})"
            hint = "replace it by two-winding transformers or lines, or take it out of service"
            yield value, "lines, two-winding transformers and impedances", hint
    indices = {int(row["index"]) for row in tables["bus"]}
    for kind, rows in tables.items():
        for row in rows:
            where = f"{kind} {row.get('name') or row['index']}"
            coupler = kind == "switch" and row["et"] == "b"
            for end in (*_ENDS, "element") if coupler else _ENDS:
                if end in row and number(row, end, math.nan) not in indices:
                    value = f"{where}: {end} is {row[end]}"
                    yield value, "the index of a bus of the network", "mend the row, or add the bus"
            for key in _POSITIVE.get(kind, ()):
                default = math.nan if key in _NEEDED[kind] else 1.0
                if not number(row, key, default) > 0:
                    yield f"{where}: {key} is {row.get(key)}", "a number above 0", "mend the row"
            if kind == "line" and number(row, "r_ohm_per_km", 0.0) < 0:
                value = f"{where}: r_ohm_per_km is {row['r_ohm_per_km']}"
                yield value, "a number of 0 or more", "mend the row, or make it an impedance"


def _limits(
    tables: Tables, names: dict[int, str], aliases: Mapping[str, str]
) -> tuple[dict[str, tuple[float, float]], list[str]]:
    """(lowest, highest) voltage by bus; of fused buses the tightest.

    And buses that have one voltage exactly and nothing to hold it, which cannot be.
    """
    limits: dict[str, tuple[float, float]] = {}
    for row in active(tables, "bus"):
        name = names[int(row["index"])]
        bus = aliases.get(name, name)
        low, high = number(row, "min_vm_pu", 0.0), number(row, "max_vm_pu", math.inf)
        before = limits.get(bus, (0.0, math.inf))
        limits[bus] = max(before[0], low), min(before[1], high)
    holding = {
        names.get(int(row["bus"])) for kind in ("gen", "ext_grid") for row in active(tables, kind)
    }
    holds = {aliases.get(str(bus), str(bus)) for bus in holding}
    pinned = {bus for bus, (low, high) in limits.items() if low == high and bus not in holds}
    return {
        bus: (low if low > 0 else V_MIN_PU, high if high < math.inf else V_MAX_PU)
        for bus, (low, high) in limits.items()
        if bus not in pinned
    }, sorted(pinned)


def _shunts(
    tables: Tables, names: Mapping[int, str], vn_kv: Mapping[str, float]
) -> Iterator[tuple[str, complex]]:
    """Buses and admittances, pu on 1 MVA: of shunts, of wards, of loads' constant impedances."""
    for row in active(tables, "shunt"):
        if bus := names.get(int(row["bus"])):
            square = (vn_kv[bus] / number(row, "vn_kv", vn_kv[bus])) ** 2
            p, q = number(row, "p_mw", 0.0), number(row, "q_mvar", 0.0)
            yield bus, complex(p, -q) * number(row, "step", 1.0) * square
    for kind in ("ward", "xward"):
        for row in active(tables, kind):
            if bus := names.get(int(row["bus"])):
                yield bus, complex(number(row, "pz_mw", 0.0), -number(row, "qz_mvar", 0.0))
    for row in active(tables, "load"):
        if bus := names.get(int(row["bus"])):
            p, q = impedance_of_load(row)
            yield bus, complex(p, -q)


def _sums(shunts: Iterable[tuple[str, complex]]) -> dict[str, complex]:
    total: dict[str, complex] = defaultdict(complex)
    for bus, y_pu in shunts:
        total[bus] += y_pu
    return total


def _places(rows: list[Row], names: dict[int, str]) -> dict[str, tuple[float, float]]:
    """`{bus: (x, y)}` of the buses whose `geo` is a point."""
    places = {}
    for row in rows:
        try:
            x, y = map(float, json.loads(row["geo"])["coordinates"][:2])
        except (KeyError, TypeError, ValueError):
            continue
        if math.isfinite(x) and math.isfinite(y):
            places[names[int(row["index"])]] = (x, y)
    return places


def _fuse(tables: Tables, names: dict[int, str]) -> dict[str, str]:
    """`{bus: bus that stands for it}` of buses joined by closed switches."""
    parent = {name: name for name in names.values()}

    def root(name: str) -> str:
        while parent[name] != name:
            name = parent[name]
        return name

    order = {name: i for i, name in enumerate(parent)}
    for row in tables.get("switch", []):
        if row["et"] == "b" and row["closed"] and not number(row, "z_ohm", 0.0) > 0:
            ends = [names.get(int(row["bus"])), names.get(int(row["element"]))]
            if ends[0] is not None and ends[1] is not None:
                first, second = sorted((root(ends[0]), root(ends[1])), key=order.__getitem__)
                parent[second] = first
    return {name: root(name) for name in parent if root(name) != name}


def _loop(branch: Branch, aliases: dict[str, str]) -> bool:
    ends = (branch.from_bus, branch.to_bus)
    return aliases.get(ends[0], ends[0]) == aliases.get(ends[1], ends[1])
