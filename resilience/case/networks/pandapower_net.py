"""pandapower networks as feeders: buses, branches and switches.

Lines, two-winding transformers, impedances and bus-bus switches with an impedance become series
branches on 1 MVA; taps stand at neutral, shunt admittances are left out and listed. Closed bus-bus
switches fuse buses. An open switch at a line or transformer takes it out of service.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path

from resilience.case.networks.course import pandapower_courses
from resilience.case.networks.feeder import (
    V_MAX_PU,
    V_MIN_PU,
    Branch,
    Feeder,
    FeederError,
    make_network,
)
from resilience.case.networks.omissions import omission
from resilience.case.networks.pandapower_devices import devices
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
_NO_LIMIT_KA = 9999.0
"""pandapower writes 99999 kA where the source gives no limit."""
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
    every = list(_branches(tables, names, vn_kv))
    branches = [branch for branch in every if not _loop(branch, aliases)]
    limits, pinned = _limits(tables, names, aliases)
    network = make_network(buses, branches, aliases, limits=limits)
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


def _branches(tables: Tables, names: dict[int, str], vn_kv: dict[str, float]) -> Iterator[Branch]:
    opened = {
        (row["et"], int(row["element"])) for row in tables.get("switch", []) if not row["closed"]
    }
    kinds: tuple[tuple[str, Parameters, tuple[str, str], str], ...] = (
        ("line", _line, ("from_bus", "to_bus"), "l"),
        ("trafo", _trafo, ("hv_bus", "lv_bus"), "t"),
        ("impedance", _impedance, ("from_bus", "to_bus"), ""),
    )
    for kind, parameters, ends, switch in kinds:
        rows = tables.get(kind, [])
        courses = pandapower_courses(rows) if kind == "line" else {}
        labels = source_names(rows) or {}
        for row in rows:
            start, stop = (names.get(int(row[end])) for end in ends)
            if start is None or stop is None:
                continue
            index = int(row["index"])
            r_pu, x_pu, rating = parameters(row, vn_kv[start], vn_kv[stop])
            up = bool(row.get("in_service", True)) and (switch, index) not in opened
            name, course = labels.get(index, ""), courses.get(index)
            yield Branch(start, stop, r_pu, x_pu, rating, up, name, course)
    yield from _switch_branches(tables, names, vn_kv)


def _switch_branches(
    tables: Tables, names: dict[int, str], vn_kv: dict[str, float]
) -> Iterator[Branch]:
    for row in tables.get("switch", []):
        z_ohm = number(row, "z_ohm", 0.0)
        if row["et"] == "b" and row["closed"] and z_ohm > 0:
            start, stop = names.get(int(row["bus"])), names.get(int(row["element"]))
            if start is not None and stop is not None:
                yield Branch(start, stop, z_ohm / vn_kv[start] ** 2, 0.0)


Parameters = Callable[[Row, float, float], tuple[float, float, float]]
"""Resistance and reactance, pu, and rating, MVA, of a row between two nominal voltages, kV."""


def _line(row: Row, vn_kv: float, _: float) -> tuple[float, float, float]:
    parallel = number(row, "parallel", 1.0)
    scale = number(row, "length_km", math.nan) / parallel / vn_kv**2
    limit_ka = number(row, "max_i_ka", math.inf)
    if limit_ka >= _NO_LIMIT_KA or limit_ka == 0:
        limit_ka = math.inf
    loading = number(row, "max_loading_percent", 100.0) / 100.0
    rating = limit_ka * number(row, "df", 1.0) * parallel * loading * math.sqrt(3.0) * vn_kv
    r_ohm, x_ohm = (number(row, f"{axis}_ohm_per_km", math.nan) for axis in "rx")
    return r_ohm * scale, x_ohm * scale, rating


def _trafo(row: Row, _: float, vn_lv_kv: float) -> tuple[float, float, float]:
    parallel, sn_mva = number(row, "parallel", 1.0), float(row["sn_mva"])
    scale = (float(row["vn_lv_kv"]) / vn_lv_kv) ** 2 / sn_mva / parallel / 100.0
    vk, vkr = float(row["vk_percent"]), float(row["vkr_percent"])
    loading = number(row, "max_loading_percent", 100.0) / 100.0
    rating = sn_mva * number(row, "df", 1.0) * parallel * loading
    # MATPOWER branches that pandapower turned into transformers without a limit carry 99999 MVA.
    rating = math.inf if rating >= _NO_LIMIT_KA else rating
    x_percent = math.copysign(math.sqrt(max(vk**2 - vkr**2, 0.0)), vk)
    return vkr * scale, x_percent * scale, rating


def _impedance(row: Row, _: float, __: float) -> tuple[float, float, float]:
    sn_mva = float(row["sn_mva"])
    return float(row["rft_pu"]) / sn_mva, float(row["xft_pu"]) / sn_mva, math.inf
