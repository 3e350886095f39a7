"""A first case file for a network: its own loads and sources, and examples to fill in."""

from __future__ import annotations

import json
import math
from collections import defaultdict
from pathlib import Path

from resilience.case.networks.feeder import Feeder, FeederError, SourceDevice, unique_names
from resilience.case.networks.read import read_feeder
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
# A storage system: at most 1 MW either way, 4 MWh. s_mva is its inverter's rating: without it the
# unit feeds no reactive power, which loads need when the grid is gone.
# [[ess]]
# name = "ess1"
# bus = {bus}
# p_max_mw = 1.0
# e_mwh = 4.0
# soc_min = 0.1
# soc_max = 0.9
# efficiency_charge = 0.95
# efficiency_discharge = 0.95
# s_mva = 1.1

# A diesel generator.
# [[generator]]
# name = "diesel1"
# bus = {bus}
# p_max_mw = 1.0
# q_max_mvar = 0.75
# cost_per_mwh = 300.0
"""

_MAX_CURRENT_KA = 9.0
"""Just below what a case accepts."""


def new_case_text(network: str) -> str:
    """A case file, as TOML that loads, for a pandapower network or a network file.

    Args:
        network: a function of `pandapower.networks` (`case33bw`) or the path of a pandapower
            `.json` or MATPOWER `.m` file.

    Raises:
        UsageError: it cannot be read.
    """
    path = Path(network)
    is_file = path.suffix in (".json", ".m")
    table = NetworkTable(file=str(path.resolve())) if is_file else NetworkTable(pandapower=network)
    try:
        feeder = read_feeder(table)
    except FeederError as error:
        _, value, allowed, hint = error.finding
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
        *(("load", load, _load(load)) for load in _bus_loads(feeder) if load.p_mw > 0),
        *(("pv", unit, {}) for unit in feeder.static if unit.p_mw > 0),
        *(
            ("generator", unit, {"cost_per_mwh": 100.0})
            for unit in feeder.generator
            if unit.p_mw > 0
        ),
        *(("grid", grid, _grid(grid)) for grid in feeder.grid),
    ]
    names = unique_names(injection.name for _, injection, _ in tables)
    blocks = []
    for (kind, unit, values), name in zip(tables, names, strict=True):
        key = "import_max_mw" if kind == "grid" else "p_max_mw"
        # A connection without a limit of its own gets half as much again as the load.
        p_mw = unit.p_mw if unit.p_mw > 0 else 1.5 * total_mw
        lines = [f"name = {_quote(name)}", f"bus = {_quote(unit.bus)}"]
        lines.append(f"{key} = {_power(feeder, unit.bus, p_mw)}")
        lines += [f"{key} = {value!r}" for key, value in values.items()]
        blocks.append("\n".join([f"\n[[{kind}]]", *lines, ""]))
    return "".join(blocks)


def _power(feeder: Feeder, bus: str, p_mw: float) -> str:
    """A power as text; sources state 9999 MW and the like, and LV buses with the load of a city."""
    vn_kv = float(feeder.network.vn_kv[feeder.network.bus(bus)])
    limit_mw = _MAX_CURRENT_KA * math.sqrt(3.0) * vn_kv
    if p_mw > limit_mw:
        return f"{limit_mw:.6g} # cut from {p_mw:.6g}, more than a busbar at {vn_kv:g} kV carries"
    return repr(round(p_mw, 9))


def _bus_loads(feeder: Feeder) -> list[SourceDevice]:
    """The loads added up by bus."""
    sums: dict[str, list[float]] = defaultdict(lambda: [0.0, 0.0])
    for load in feeder.load:
        sums[load.bus][0] += load.p_mw
        sums[load.bus][1] += load.q_mvar
    return [SourceDevice(f"load {bus}", bus, p_mw, q_mvar) for bus, (p_mw, q_mvar) in sums.items()]


def _load(load: SourceDevice) -> dict[str, float]:
    if load.q_mvar <= 0:
        return {}
    return {"power_factor": round(load.p_mw / math.hypot(load.p_mw, load.q_mvar), 6)}


def _grid(grid: SourceDevice) -> dict[str, float]:
    return {"import_cost_per_mwh": 50.0, "v_pu": min(max(grid.v_pu, 0.9), 1.1)}
