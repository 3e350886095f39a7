"""pandapower networks as feeders, read from their JSON without importing pandapower.

Lines, two-winding transformers, impedances and bus-bus switches with an impedance become series
branches on 1 MVA; taps stand at neutral, shunt admittances are left out. Closed bus-bus switches
fuse buses. An open switch at a line or transformer takes it out of service.
"""

from __future__ import annotations

import importlib.util
import json
import logging
import math
import re
import warnings
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from resilience.case.networks.course import pandapower_courses
from resilience.case.networks.feeder import (
    Branch,
    Feeder,
    FeederError,
    SourceDevice,
    make_network,
    unique_names,
)
from resilience.case.networks.network import did_you_mean

if TYPE_CHECKING:
    import pandas as pd

Row = dict[str, Any]
"""A row of a table by column, with its `index`; JSON tells no more of its values."""
Tables = dict[str, list[Row]]

_BRANCHES = ("line", "trafo", "impedance")
_INJECTIONS = ("load", "asymmetric_load", "sgen", "gen", "ext_grid")
_READ = ("bus", "switch", *_BRANCHES, *_INJECTIONS)
_REFUSED = {
    "trafo3w": "three-winding transformer",
    "dcline": "DC line",
    "line_dc": "DC line",
    "tcsc": "series compensator",
    "b2b_vsc": "back-to-back converter",
}
_NO_LIMIT_KA = 9999.0
"""pandapower writes 99999 kA where the source gives no limit."""


@cache
def feeder_by_name(name: str) -> Feeder:
    """A network of `pandapower.networks` that needs no argument.

    Raises:
        FeederError: there is no such network, or it has devices that a case cannot have.
    """
    spec = importlib.util.find_spec("pandapower")
    folders = spec.submodule_search_locations if spec else None
    if not folders:
        raise FeederError(
            "pandapower", repr(name), "an installed pandapower", "pip install pandapower"
        )
    path = Path(folders[0]) / "networks" / "power_system_test_case_jsons" / f"{name}.json"
    # pandapower moves the reference bus of the RTE cases after reading their file.
    as_filed = path.is_file() and not name.endswith("rte")
    tables = _parse(path) if as_filed else _call(name)
    return _feeder(tables, "pandapower", name)


def feeder_from_json(path: Path) -> Feeder:
    """The network of a file written by `pandapower.to_json`.

    Raises:
        FeederError: it is no such file, or has devices that a case cannot have.
    """
    try:
        return _feeder(_parse(path), "file", path.name)
    except (KeyError, TypeError, ValueError) as error:
        hint = "write the file with pandapower.to_json(net, path)"
        raise FeederError("file", f"{path.name}: {error!r}", "complete tables", hint) from None


def _parse(path: Path) -> Tables:
    hint = "write the file with pandapower.to_json(net, path)"
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        tables = content["_object"]
        return {name: _rows(tables[name]) for name in (*_READ, *_REFUSED) if name in tables}
    except (ValueError, KeyError, TypeError) as error:
        raise FeederError("file", path.name, f"a pandapower network ({error!r})", hint) from None


def _rows(frame: Row) -> list[Row]:
    body = frame["_object"]
    if isinstance(body, str):
        body = json.loads(body)
    columns = body["columns"]
    rows = [
        {"index": index, **dict(zip(columns, values, strict=True))}
        for index, values in zip(body["index"], body["data"], strict=True)
    ]
    return sorted(rows, key=lambda row: int(row["index"]))


def _call(name: str) -> Tables:
    """A network that pandapower builds with code."""
    logger = logging.getLogger("pandapower")
    level = logger.level
    with warnings.catch_warnings():
        # Its power flows warn of missing numba and of features it is about to drop.
        warnings.filterwarnings("ignore", module=r"pandapower\b")
        logger.setLevel(logging.ERROR)
        try:
            frames = _frames(name)
        finally:
            logger.setLevel(level)
    return {
        key: [
            {"index": index, **{str(column): value for column, value in row.items()}}
            for index, row in zip(frame.index.tolist(), frame.to_dict("records"), strict=True)
        ]
        for key, frame in frames.items()
    }


def _frames(name: str) -> dict[str, pd.DataFrame]:
    import pandapower.networks as library

    builders = {
        key: value
        for key, value in vars(library).items()
        if getattr(value, "__module__", "").startswith(library.__name__) and key[0] != "_"
    }
    if name not in builders:
        hint = did_you_mean(name, builders)
        raise FeederError("pandapower", f'"{name}"', "a function of pandapower.networks", hint)
    try:
        net = builders[name]()
        return {key: net[key] for key in (*_READ, *_REFUSED) if key in net}
    except (TypeError, KeyError, IndexError) as error:
        allowed = "a function that needs no argument and returns a network"
        raise FeederError("pandapower", f'"{name}"', allowed, str(error)) from None


def _number(row: Row, key: str, default: float) -> float:
    value = row.get(key)
    if value is None or isinstance(value, str) or math.isnan(value):
        return default
    return float(value)


def _active(tables: Tables, kind: str) -> Iterator[Row]:
    return (row for row in tables.get(kind, []) if row.get("in_service", True))


def _source_names(rows: list[Row]) -> dict[int, str] | None:
    """The source's names by index, or `None` where they are missing, repeated or numbers."""
    names = [name.strip() for row in rows if isinstance(name := row.get("name"), str)]
    telling = [name for name in names if name and not re.fullmatch(r"\d+(\.0)?", name)]
    if len(set(telling)) < len(rows):
        return None
    return {int(row["index"]): name for row, name in zip(rows, names, strict=True)}


def _feeder(tables: Tables, key: str, source: str) -> Feeder:
    for kind, words in _REFUSED.items():
        for row in _active(tables, kind):
            raise FeederError(
                key,
                f"{source} has a {words} ({row.get('name') or row['index']})",
                "lines, two-winding transformers and impedances",
                "replace it by two-winding transformers or lines, or take it out of service",
            )
    rows = list(_active(tables, "bus"))
    names = _source_names(rows) or {int(r["index"]): str(int(r["index"]) + 1) for r in rows}
    vn_kv = {names[int(r["index"])]: float(r["vn_kv"]) for r in rows}
    aliases = _fuse(tables, names)
    buses = [(name, vn) for name, vn in vn_kv.items() if name not in aliases]
    branches = [b for b in _branches(tables, names, vn_kv) if not _loop(b, aliases)]
    network = make_network(buses, branches, aliases)
    return Feeder(network, **_devices(tables, names, aliases), places=_places(rows, names))


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
        if row["et"] == "b" and row["closed"] and not _number(row, "z_ohm", 0.0) > 0:
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
    for kind, parameters, ends, switch in (
        ("line", _line, ("from_bus", "to_bus"), "l"),
        ("trafo", _trafo, ("hv_bus", "lv_bus"), "t"),
        ("impedance", _impedance, ("from_bus", "to_bus"), ""),
    ):
        rows = tables.get(kind, [])
        courses = pandapower_courses(rows) if kind == "line" else {}
        source_names = _source_names(rows) or {}
        for row in rows:
            start, stop = (names.get(int(row[end])) for end in ends)
            if start is None or stop is None:
                continue
            index = int(row["index"])
            r_pu, x_pu, rating = parameters(row, vn_kv[start], vn_kv[stop])
            up = bool(row.get("in_service", True)) and (switch, index) not in opened
            name, course = source_names.get(index, ""), courses.get(index)
            yield Branch(start, stop, r_pu, x_pu, rating, up, name, course)
    yield from _switch_branches(tables, names, vn_kv)


def _switch_branches(
    tables: Tables, names: dict[int, str], vn_kv: dict[str, float]
) -> Iterator[Branch]:
    for row in tables.get("switch", []):
        z_ohm = _number(row, "z_ohm", 0.0)
        if row["et"] == "b" and row["closed"] and z_ohm > 0:
            start, stop = names.get(int(row["bus"])), names.get(int(row["element"]))
            if start is not None and stop is not None:
                yield Branch(start, stop, z_ohm / vn_kv[start] ** 2, 0.0)


def _line(row: Row, vn_kv: float, _: float) -> tuple[float, float, float]:
    parallel = _number(row, "parallel", 1.0)
    scale = float(row["length_km"]) / parallel / vn_kv**2
    limit_ka = _number(row, "max_i_ka", math.inf)
    if limit_ka >= _NO_LIMIT_KA or limit_ka <= 0:
        limit_ka = math.inf
    loading = _number(row, "max_loading_percent", 100.0) / 100.0
    rating = limit_ka * _number(row, "df", 1.0) * parallel * loading * math.sqrt(3.0) * vn_kv
    return float(row["r_ohm_per_km"]) * scale, float(row["x_ohm_per_km"]) * scale, rating


def _trafo(row: Row, _: float, vn_lv_kv: float) -> tuple[float, float, float]:
    parallel, sn_mva = _number(row, "parallel", 1.0), float(row["sn_mva"])
    scale = (float(row["vn_lv_kv"]) / vn_lv_kv) ** 2 / sn_mva / parallel / 100.0
    vk, vkr = float(row["vk_percent"]), float(row["vkr_percent"])
    loading = _number(row, "max_loading_percent", 100.0) / 100.0
    rating = sn_mva * _number(row, "df", 1.0) * parallel * loading
    # MATPOWER branches that pandapower turned into transformers without a limit carry 99999 MVA.
    rating = math.inf if rating >= _NO_LIMIT_KA else rating
    x_percent = math.copysign(math.sqrt(max(vk**2 - vkr**2, 0.0)), vk)
    return vkr * scale, x_percent * scale, rating


def _impedance(row: Row, _: float, __: float) -> tuple[float, float, float]:
    sn_mva = float(row["sn_mva"])
    return float(row["rft_pu"]) / sn_mva, float(row["xft_pu"]) / sn_mva, math.inf


def _devices(
    tables: Tables, names: dict[int, str], aliases: dict[str, str]
) -> dict[str, tuple[SourceDevice, ...]]:
    def read(kind: str, power: str) -> list[SourceDevice]:
        rows = [r for r in _active(tables, kind) if int(r["bus"]) in names]
        source_names = _source_names(rows) or {}
        titles = unique_names(
            source_names.get(int(r["index"]), f"{kind}{int(r['index']) + 1}") for r in rows
        )
        devices = []
        for row, title in zip(rows, titles, strict=True):
            bus, scale = names[int(row["bus"])], _number(row, "scaling", 1.0)
            p_mw = sum(_number(row, key, 0.0) for key in power.split())
            q_mvar = sum(
                _number(row, key.replace("p_", "q_").replace("mw", "mvar"), 0.0)
                for key in power.split()
            )
            v_pu = _number(row, "vm_pu", 1.0)
            devices.append(
                SourceDevice(title, aliases.get(bus, bus), p_mw * scale, q_mvar * scale, v_pu)
            )
        return devices

    phases = read("asymmetric_load", "p_a_mw p_b_mw p_c_mw")
    return {
        "load": (*read("load", "p_mw"), *phases),
        "static": tuple(read("sgen", "p_mw")),
        "generator": tuple(read("gen", "max_p_mw")),
        "grid": tuple(read("ext_grid", "max_p_mw")),
    }
