"""A first case file for a network: its own loads and sources, and examples to fill in."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from pathlib import Path

from resilience.case.feeder import Feeder, FeederError, Injection, read_feeder, unique_names
from resilience.case.schema import NetworkTable
from resilience.errors import UsageError

_HEAD = """\
# A case for the network {title}. Loads and sources are the network's own; prices, horizon and
# everything in comments are yours to set. `resilience case schema` lists every key.

name = {name}
description = ""

# Lines that a storm takes out, for example ["{line}@14:00-17:30"].
outages = []

[network]
{source}
v_min_pu = 0.9
v_max_pu = 1.1

[time]
start = 2016-07-12T00:00:00
slots = 96
step_min = 15

# Time series in per unit of each device's peak: a file whose first column is `time`, in steps of
# step_min. Devices name their column with `profile = "..."`.
# [profiles]
# file = "profiles.csv"

[defaults.load]
shed_cost_per_mwh = 1000.0
"""

_EXAMPLES = """
# A storage system: at most 1 MW either way, 4 MWh.
# [[ess]]
# name = "ess1"
# bus = {bus}
# p_max_mw = 1.0
# e_mwh = 4.0
# soc_min = 0.1
# soc_max = 0.9
# efficiency_charge = 0.95
# efficiency_discharge = 0.95

# A diesel generator.
# [[generator]]
# name = "diesel1"
# bus = {bus}
# p_max_mw = 1.0
# cost_per_mwh = 300.0
"""

_MAX_CURRENT_KA = 9.0
"""Just below what a case accepts."""


def new_case_text(network: str) -> str:
    """Return a case file, as TOML that loads, for a pandapower network or a network file.

    `network` is a function of `pandapower.networks` (`case33bw`) or the path of a pandapower
    `.json` or MATPOWER `.m` file. Raises `UsageError` where it cannot be read.
    """
    path = Path(network)
    is_file = path.suffix in (".json", ".m")
    table = NetworkTable(file=str(path.resolve())) if is_file else NetworkTable(pandapower=network)
    try:
        feeder = read_feeder(table)
    except FeederError as error:
        _, value, allowed, hint = error.args
        raise UsageError(f"network {network!r}: {value} found; allowed: {allowed}", hint) from None
    key, ref = ("file", str(path.resolve())) if is_file else ("pandapower", network)
    stem = path.stem if is_file else network
    head = _HEAD.format(
        title=network,
        name=_quote(stem),
        source=f"{key} = {_quote(ref)}",
        line=next(iter(feeder.network.line_names), "1-2"),
    )
    return head + _devices(feeder) + _EXAMPLES.format(bus=_quote(feeder.network.bus_names[-1]))


def _quote(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)


def _devices(feeder: Feeder) -> str:
    total_mw = sum(load.p_mw for load in feeder.load if load.p_mw > 0)
    tables = [
        *_loads(feeder),
        *(("pv", i, {"p_max_mw": i.p_mw}) for i in feeder.static if i.p_mw > 0),
        *(("generator", i, _generator(feeder, i)) for i in feeder.generator if i.p_mw > 0),
        *(("grid", i, _grid(feeder, i, total_mw)) for i in feeder.grid),
    ]
    names = unique_names(injection.name for _, injection, _ in tables)
    blocks = []
    for (kind, injection, values), name in zip(tables, names, strict=True):
        lines = [f"name = {_quote(name)}", f"bus = {_quote(injection.bus)}"]
        lines += [f"{key} = {value!r}" for key, value in values.items()]
        blocks.append("\n".join([f"\n[[{kind}]]", *lines, ""]))
    return "".join(blocks)


def _loads(feeder: Feeder) -> list[tuple[str, Injection, dict[str, float]]]:
    """Return one load per bus, with the power factor of what is connected there."""
    p_mw: dict[str, float] = defaultdict(float)
    q_mvar: dict[str, float] = defaultdict(float)
    for load in feeder.load:
        p_mw[load.bus] += load.p_mw
        q_mvar[load.bus] += load.q_mvar
    tables = []
    for bus, p in p_mw.items():
        if p > 0:
            values = {"p_max_mw": round(p, 9)}
            if q_mvar[bus] > 0:
                values["power_factor"] = round(p / math.hypot(p, q_mvar[bus]), 6)
            tables.append(("load", Injection(f"load {bus}", bus, p), values))
    return tables


def _carried(feeder: Feeder, bus: str, p_mw: float) -> float:
    """Return a power, cut to what one busbar carries; sources state 9999 MW and the like."""
    vn_kv = float(feeder.network.vn_kv[feeder.network.bus(bus)])
    return round(min(p_mw, _MAX_CURRENT_KA * math.sqrt(3.0) * vn_kv), 6)


def _generator(feeder: Feeder, unit: Injection) -> dict[str, float]:
    return {"p_max_mw": _carried(feeder, unit.bus, unit.p_mw), "cost_per_mwh": 100.0}


def _grid(feeder: Feeder, grid: Injection, total_mw: float) -> dict[str, float]:
    """Return a connection with the source's limit, or else one for half as much again as the load."""
    import_max_mw = grid.p_mw if grid.p_mw > 0 else 1.5 * total_mw
    return {
        "import_max_mw": _carried(feeder, grid.bus, import_max_mw),
        "import_cost_per_mwh": 50.0,
        "v_pu": min(max(grid.v_pu, 0.9), 1.1),
    }
