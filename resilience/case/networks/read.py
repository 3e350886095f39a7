"""The network of a case from where the case says it is: pandapower, a file, or inline tables."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from resilience.arrays import Bools
from resilience.case.networks.course import Course
from resilience.case.networks.feeder import Branch, Feeder, FeederError, make_network
from resilience.case.networks.matpower import feeder_from_matpower
from resilience.case.networks.network import Network
from resilience.case.networks.soundness import network_findings
from resilience.case.schema import LineTable, NetworkTable
from resilience.errors import UsageError
from resilience.files import reading
from resilience.inputs import InputFileError, checked_path


def read_feeder(table: NetworkTable) -> Feeder:
    """The network that a case names, from where it is, checked.

    Raises:
        FeederError: it cannot be read, or its numbers are not sound.
    """
    feeder = _from_source(table)
    findings = list(network_findings(feeder.network, "pandapower" if table.pandapower else "file"))
    if findings:
        raise FeederError(*findings)
    return feeder


def _from_source(table: NetworkTable) -> Feeder:
    sources = [key for key in ("pandapower", "file", "bus") if getattr(table, key)]
    if len(sources) != 1:
        allowed = "exactly one of pandapower, file, or [[network.bus]] with [[network.line]]"
        hint = 'for example pandapower = "case33bw"'
        raise FeederError(("", " and ".join(sources) or "no network", allowed, hint))
    if table.pandapower:
        from resilience.case.networks.pandapower_net import feeder_by_name

        return feeder_by_name(table.pandapower)
    if table.file:
        try:
            path = checked_path(Path(table.file))
        except InputFileError as error:
            wrong = error.mistake
            value = f"{wrong.file} {wrong.value}"
            raise FeederError(("file", value, wrong.allowed, wrong.hint)) from None
        return _read_file(path, path.stat().st_mtime_ns)
    return _inline(table)


@lru_cache(maxsize=16)
def _read_file(path: Path, _mtime: int) -> Feeder:
    if path.suffix not in READERS:
        allowed = "a pandapower .json or a MATPOWER .m file"
        raise FeederError(("file", path.name, allowed, "convert the network"))
    try:
        with reading(path, "network"):
            return READERS[path.suffix](path)
    except FeederError:
        raise
    except UsageError as error:
        raise FeederError(("file", error.message, "a network", error.hint)) from None


def _pandapower(path: Path) -> Feeder:
    from resilience.case.networks.pandapower_net import feeder_from_json

    return feeder_from_json(path)


READERS: Mapping[str, Callable[[Path], Feeder]] = {
    ".json": _pandapower,
    ".m": feeder_from_matpower,
}
"""Suffix of a network file to what reads it."""


def _inline(table: NetworkTable) -> Feeder:
    vn_kv = {bus.name: bus.vn_kv for bus in table.bus}
    branches = [
        Branch(
            line.from_,
            line.to,
            line.r_ohm / vn_kv[line.to] ** 2,
            line.x_ohm / vn_kv[line.to] ** 2,
            line.rating_mva or float("inf"),
            line.in_service,
            line.name or "",
            ratio=cmath.rect(line.tap_ratio or 1.0, math.radians(line.shift_degree)),
            y_from_pu=0.5 * complex(line.g_us, line.b_us) * 1e-6 * vn_kv[line.to] ** 2,
            y_to_pu=0.5 * complex(line.g_us, line.b_us) * 1e-6 * vn_kv[line.to] ** 2,
            angle_min_degree=-math.inf if line.angle_min_degree is None else line.angle_min_degree,
            angle_max_degree=math.inf if line.angle_max_degree is None else line.angle_max_degree,
        )
        for line in table.line
    ]
    places = {
        bus.name: (bus.lon_deg, bus.lat_deg)
        for bus in table.bus
        if bus.lon_deg is not None and bus.lat_deg is not None
    }
    shunts = {bus.name: complex(bus.shunt_p_mw, -bus.shunt_q_mvar) for bus in table.bus}
    return Feeder(make_network([*vn_kv.items()], branches, shunts=shunts), places=places)


def finish_network(network: Network, table: NetworkTable, lines: Iterable[LineTable]) -> Network:
    """The network with what the case says of it: scale, voltage limits, and `[[line]]` tables."""
    v_min, v_max = network.v_min_pu.copy(), network.v_max_pu.copy()
    v_min[:] = v_min if table.v_min_pu is None else table.v_min_pu
    v_max[:] = v_max if table.v_max_pu is None else table.v_max_pu
    for bus in table.bus:
        i = network.bus(bus.name)
        v_min[i], v_max[i] = bus.v_min_pu or v_min[i], bus.v_max_pu or v_max[i]
    switchable, breakpoint_ = network.switchable.copy(), network.breakpoint.copy()
    rating, cost = network.rating_mva.copy(), network.switching_cost.copy()
    in_service = network.in_service.copy()
    for line in lines:
        i = network.line(line.name)
        in_service[i] = in_service[i] if line.in_service is None else line.in_service
        switchable[i], breakpoint_[i] = line.switchable, line.breakpoint
        rating[i], cost[i] = line.rating_mva or rating[i], line.switching_cost
    y_bus = network.y_bus_pu.copy()
    for name, (end, y_pu) in network.open_ended.items():
        # A line that the plan may close is whole or gone: then nothing of it hangs at one end.
        k = network.line(name)
        y_bus[network.bus(end)] += 0.0 if switchable[k] or in_service[k] else y_pu
    return replace(
        network,
        y_bus_pu=y_bus,
        open_ended={},
        r_pu=network.r_pu * table.impedance_scale,
        x_pu=network.x_pu * table.impedance_scale,
        v_min_pu=v_min,
        v_max_pu=v_max,
        in_service=in_service,
        switchable=switchable,
        switching_cost=cost,
        breakpoint=breakpoint_,
        rating_mva=rating,
        parallel_grids=table.parallel_grids,
        radial=table.radial,
    )


def cables(network: Network, lines: Iterable[LineTable]) -> Bools:
    """(lines,) True where a line is underground: by its `[[line]]`, or else by its course."""
    courses = [network.courses.get(name, Course()) for name in network.line_names]
    underground = np.array([course.underground for course in courses], bool)
    for line in lines:
        if line.underground is not None:
            underground[network.line(line.name)] = line.underground
    return underground
