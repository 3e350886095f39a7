"""The network of a case from where the case says it is: pandapower, a file, or inline tables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from resilience.case.networks.network import Network
from resilience.case.schema.tables import LineTable, NetworkTable


class FeederError(Exception):
    """A network that cannot be read: `(key, value, allowed, hint)`."""


@dataclass(frozen=True)
class Branch:
    """One line or transformer on its way into a network; impedances in pu on 1 MVA."""

    from_bus: str
    to_bus: str
    r_pu: float
    x_pu: float
    rating_mva: float = float("inf")
    in_service: bool = True
    name: str = ""


@dataclass(frozen=True)
class Injection:
    """A load, generator or grid connection that a network file brings along; MW and Mvar."""

    name: str
    bus: str
    p_mw: float
    q_mvar: float = 0.0
    v_pu: float = 1.0


@dataclass(frozen=True)
class Feeder:
    """A network as its source has it, with the devices the source knows.

    Voltage limits are not taken from the source; the case sets them. `places` holds the (x, y) of
    buses, whatever the source means by them: degrees of longitude and latitude, or a drawing.
    """

    network: Network
    load: tuple[Injection, ...] = ()
    static: tuple[Injection, ...] = ()
    generator: tuple[Injection, ...] = ()
    grid: tuple[Injection, ...] = ()
    places: Mapping[str, tuple[float, float]] = field(default_factory=dict)


def make_network(
    buses: Sequence[tuple[str, float]],
    branches: Sequence[Branch],
    aliases: dict[str, str] | None = None,
) -> Network:
    """Assemble a network from `(bus name, vn_kv)` pairs and branches that name their buses."""
    index = {name: i for i, (name, _) in enumerate(buses)}
    index |= {alias: index[name] for alias, name in (aliases or {}).items()}
    count, closed = len(branches), np.zeros(len(branches), dtype=np.bool_)
    return Network(
        bus_names=tuple(name for name, _ in buses),
        vn_kv=np.array([vn for _, vn in buses], dtype=np.float64),
        v_min_pu=np.full(len(buses), 0.9),
        v_max_pu=np.full(len(buses), 1.1),
        line_names=unique_names(b.name or f"{b.from_bus}-{b.to_bus}" for b in branches),
        from_bus=np.array([index[b.from_bus] for b in branches], dtype=np.int64).reshape(count),
        to_bus=np.array([index[b.to_bus] for b in branches], dtype=np.int64).reshape(count),
        r_pu=np.array([b.r_pu for b in branches], dtype=np.float64),
        x_pu=np.array([b.x_pu for b in branches], dtype=np.float64),
        rating_mva=np.array([b.rating_mva for b in branches], dtype=np.float64),
        in_service=np.array([b.in_service for b in branches], dtype=np.bool_),
        switchable=closed,
        switching_cost=np.zeros(count),
        breakpoint=closed.copy(),
        aliases=dict(aliases or {}),
    )


def unique_names(names: Iterable[str]) -> tuple[str, ...]:
    """Return the names with `#2`, `#3`, ... after repeated ones, as parallel lines have."""
    seen: dict[str, int] = {}
    out = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        out.append(name if seen[name] == 1 else f"{name}#{seen[name]}")
    return tuple(out)


def read_feeder(table: NetworkTable) -> Feeder:
    """Read the network that a case names. Raises `FeederError` where it cannot be read."""
    given = [k for k in ("pandapower", "file") if getattr(table, k)] + ["bus"] * bool(table.bus)
    if len(given) != 1:
        raise FeederError(
            "",
            " and ".join(given) or "no network",
            "exactly one of pandapower, file, or [[network.bus]] with [[network.line]]",
            'for example pandapower = "case33bw"',
        )
    if table.pandapower:
        from resilience.case.networks.pandapower_net import feeder_by_name

        return feeder_by_name(table.pandapower)
    if table.file:
        path = Path(table.file)
        if not path.is_file():
            raise FeederError(
                "file", str(path), "a file that exists", "paths start at the case file's folder"
            )
        return _read_file(path, path.stat().st_mtime_ns)
    return _inline(table)


@lru_cache(maxsize=16)
def _read_file(path: Path, _mtime: int) -> Feeder:
    if path.suffix == ".json":
        from resilience.case.networks.pandapower_net import feeder_from_json

        return feeder_from_json(path)
    if path.suffix == ".m":
        from resilience.case.networks.matpower import feeder_from_matpower

        return feeder_from_matpower(path)
    raise FeederError(
        "file", path.name, "a pandapower .json or a MATPOWER .m file", "convert the network"
    )


def _inline(table: NetworkTable) -> Feeder:
    vn_kv = {b.name: b.vn_kv for b in table.bus}
    branches = [
        Branch(
            line.from_,
            line.to,
            line.r_ohm / vn_kv[line.from_] ** 2,
            line.x_ohm / vn_kv[line.from_] ** 2,
            line.rating_mva or float("inf"),
            line.in_service,
            line.name or "",
        )
        for line in table.line
    ]
    places = {
        b.name: (b.lon_deg, b.lat_deg)
        for b in table.bus
        if b.lon_deg is not None and b.lat_deg is not None
    }
    return Feeder(make_network([(b.name, b.vn_kv) for b in table.bus], branches), places=places)


def finish_network(network: Network, table: NetworkTable, lines: Iterable[LineTable]) -> Network:
    """Apply what the case says about its network: scale, voltage limits, and `[[line]]` tables."""
    v_min, v_max = (np.full(len(network.bus_names), v) for v in (table.v_min_pu, table.v_max_pu))
    for bus in table.bus:
        i = network.bus(bus.name)
        v_min[i], v_max[i] = bus.v_min_pu or v_min[i], bus.v_max_pu or v_max[i]
    switchable, breakpoint_ = network.switchable.copy(), network.breakpoint.copy()
    rating, cost = network.rating_mva.copy(), network.switching_cost.copy()
    for line in lines:
        i = network.line(line.name)
        switchable[i], breakpoint_[i] = line.switchable, line.breakpoint
        rating[i], cost[i] = line.rating_mva or rating[i], line.switching_cost
    return replace(
        network,
        r_pu=network.r_pu * table.impedance_scale,
        x_pu=network.x_pu * table.impedance_scale,
        v_min_pu=v_min,
        v_max_pu=v_max,
        switchable=switchable,
        switching_cost=cost,
        breakpoint=breakpoint_,
        rating_mva=rating,
    )
