"""Networks in memory, as pandapower has them, as the tables of a case that needs no file."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping
from typing import Any

import numpy as np

from resilience.arrays import Complexes
from resilience.case.networks.feeder import Feeder, FeederError
from resilience.case.networks.network import Network
from resilience.case.networks.omissions import Omission, omission
from resilience.case.networks.pandapower_net import feeder_from_tables
from resilience.case.networks.pandapower_tables import tables_of_content
from resilience.case.starter.devices import device_tables
from resilience.errors import UsageError, shortened

FIRST_HORIZON = "start = 2016-07-12T00:00:00\nslots = 96\nstep_min = 15"
"""Of a case that states none: a day in quarters of an hour."""
FIRST_SHED_COST = 1000.0
"""$/MWh of loads that state none."""


def is_pandapower(value: object) -> bool:
    """Whether something is a network of pandapower in memory."""
    return type(value).__name__ == "pandapowerNet"


def tables_of_net(net: object) -> dict[str, Any]:
    """The tables of a first case for a network of pandapower, as `case new` writes them.

    Args:
        net: a `pandapowerNet`.

    Raises:
        UsageError: it is none, or has what a case cannot have; all of it is listed.
    """
    feeder = feeder_of_net(net)
    devices, more = device_tables(feeder)
    tables = network_tables(feeder, more)
    return {
        "name": _name(net),
        "time": tomllib.loads(FIRST_HORIZON),
        "defaults": {"load": {"shed_cost_per_mwh": FIRST_SHED_COST}},
        **tables,
        **tomllib.loads(devices),
    }


def feeder_of_net(net: object) -> Feeder:
    """The network in memory, and what it says of devices.

    Raises:
        UsageError: as `tables_of_net`.
    """
    if not is_pandapower(net):
        raise UsageError(
            f"a {type(net).__name__}: {shortened(repr(net))}; allowed: a network of pandapower",
            hint='Case.from_dict({"network": {"pandapower": "case33bw"}, ...}) takes its name',
        )
    import pandapower

    content = json.loads(pandapower.to_json(net))["_object"]
    try:
        return feeder_from_tables(tables_of_content(content), "network", _name(net))
    except FeederError as error:
        texts = [f"{value}; allowed: {allowed}" for _, value, allowed, _ in error.findings]
        raise UsageError("\n".join(texts), error.findings[0][-1]) from None


def _name(net: object) -> str:
    return str(getattr(net, "name", "") or "network")


def network_tables(feeder: Feeder, omitted: list[Omission]) -> dict[str, Any]:
    """`[network]` and `[[line]]` of a feeder, every number as its source has it.

    Args:
        feeder: the network.
        omitted: what of its devices is left out.
    """
    network = feeder.network
    y_line, y_bus, uneven = _charging(network)
    vn, places = network.vn_kv, feeder.places
    buses = [
        {
            "name": name,
            "vn_kv": vn[k],
            "v_min_pu": network.v_min_pu[k],
            "v_max_pu": network.v_max_pu[k],
        }
        | ({"shunt_p_mw": y_bus[k].real, "shunt_q_mvar": -y_bus[k].imag} if y_bus[k] else {})
        | _place(places.get(name))
        for k, name in enumerate(network.bus_names)
    ]
    lines = [_branch(network, k, y_line[k]) for k in range(len(network.line_names))]
    courses = network.courses.items()
    drawn = [(name, 0.0) for name, course in courses if course.points]
    omissions = (
        *feeder.omissions,
        *omitted,
        *omission("way of a line", drawn, instead="straight"),
        *omission("uneven charging of a line", uneven, instead="even, the difference at its buses"),
    )
    head: dict[str, Any] = {"bus": buses, "line": lines}
    if omissions:
        head["not_modelled"] = [str(entry) for entry in omissions]
    cables = [{"name": name, "underground": True} for name, course in courses if course.underground]
    return {"network": _python(head), "line": cables} if cables else {"network": _python(head)}


def _charging(network: Network) -> tuple[Complexes, Complexes, list[tuple[str, float]]]:
    """Admittance of every line, half at either end; of buses; and which lines have it uneven."""
    y_line = 0.5 * (network.y_from_pu + network.y_to_pu)
    y_bus = network.y_bus_pu.copy()
    gap = np.abs(network.y_from_pu - network.y_to_pu) > 1e-9 * np.abs(y_line)
    in_use = gap & network.in_service
    extra = network.y_from_pu - y_line
    np.add.at(y_bus, network.from_bus[in_use], (extra / network.tap**2)[in_use])
    np.add.at(y_bus, network.to_bus[in_use], -extra[in_use])
    for end, y_pu in network.open_ended.values():
        y_bus[network.bus(end)] += y_pu
    return y_line, y_bus, [(network.line_names[k], 0.0) for k in np.flatnonzero(gap)]


def _branch(network: Network, k: int, y_pu: complex) -> dict[str, Any]:
    """`[[network.line]]` of one line; what it has not is left out."""
    i, j = int(network.from_bus[k]), int(network.to_bus[k])
    square = network.vn_kv[j] ** 2
    ratio = network.ratio[k]
    is_transformer = ratio != 1.0 or network.vn_kv[i] != network.vn_kv[j]
    table: dict[str, Any] = {
        "name": network.line_names[k],
        "from": network.bus_names[i],
        "to": network.bus_names[j],
        "r_ohm": network.r_pu[k] * square,
        "x_ohm": network.x_pu[k] * square,
    }
    if y_pu:
        table |= {"b_us": 2e6 * y_pu.imag / square, "g_us": 2e6 * y_pu.real / square}
    if is_transformer:
        table |= {"tap_ratio": abs(ratio), "shift_degree": math.degrees(np.angle(ratio))}
    if math.isfinite(network.rating_mva[k]):
        table["rating_mva"] = network.rating_mva[k]
    return table if network.in_service[k] else table | {"in_service": False}


def _place(place: tuple[float, float] | None) -> dict[str, float]:
    """Where a bus is, if its coordinates can be degrees."""
    if place is None or not (abs(place[0]) <= 180.0 and abs(place[1]) <= 90.0):
        return {}
    return {"lon_deg": place[0], "lat_deg": place[1]}


def _python(value: Any) -> Any:
    """The same with numbers of Python, which TOML can write."""
    if isinstance(value, Mapping):
        return {key: _python(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_python(inner) for inner in value]
    return value.item() if isinstance(value, np.generic) else value
