"""Make cases/large.toml and cases/large.m, about 1,000 buses, from a SimBench network.

Run from anywhere, no network needed:  pip install -e ".[data]" && python scripts/make_large_case.py

The suburban medium-voltage grid of SimBench (1-MVLV-semiurb, ODbL 1.0) with twenty of its 110
low-voltage grids; the others are added up at their substations. The result is the same byte for
byte on every run, so a change of it shows in `git diff`.
"""

from __future__ import annotations

import math
import tempfile
import warnings
from pathlib import Path
from typing import Any

import pandas as pd

CODE = "1-MVLV-semiurb-all-0-no_sw"
KEPT = [f"LV4.2{i:02d}" for i in range(1, 21)]
BREAKPOINTS = 50
GENERATOR_EVERY = 2  # a diesel generator beside every second storage system
CASES = Path(__file__).parents[1] / "cases"
# The columns of profiles/simbench_jul_aug.csv.gz that are nearest to SimBench's.
COLUMNS = {"H0": "H0-H", "G1": "G0-M", "G2": "G2-A", "G3": "G3-M", "G4": "G4-M", "G5": "G0-M"}
COLUMNS |= {"G6": "G2-A", "L1": "L0-A", "L2": "L2-M", "BL": "WB-H"}
HEAD = """\
# A suburb on a 20 kV grid of nine feeders: 20 low-voltage grids house by house, 90 more as one
# load each, 20 storage systems, 50 breakpoints. For finding out how methods scale.
#
# Made by scripts/make_large_case.py from SimBench 1-MVLV-semiurb (ODbL 1.0; see profiles/NOTICE);
# edit that, not this. Storage, diesel and prices are chosen there. Breakpoints are the 50 longest
# lines of the 20 kV grid, most exposed to a storm; every second storage system has a generator
# beside it. Every tenth breakpoint fails below. Wind, biomass and hydro of SimBench are left out.

name = "large"
description = "{buses}-bus suburb from SimBench with 20 storage systems and 50 breakpoints"
terminal_value_per_mwh = 0.35
outages = [{outages}]

[network]
file = "large.m"

[time]
start = 2016-08-26T00:00:00
slots = 96
step_min = 15

[profiles]
file = "profiles/simbench_jul_aug.csv.gz"

[defaults.load]
power_factor = 0.93
shed_cost_per_mwh = 1.5

[defaults.ess]
p_max_mw = 0.5
e_mwh = 1.5
s_mva = 0.55
soc_min = 0.1
soc_max = 0.9
efficiency_charge = 0.97
efficiency_discharge = 0.97
degradation_cost_per_mwh = 0.2

[defaults.generator]
p_max_mw = 1.0
q_min_mvar = -0.75
q_max_mvar = 0.75
cost_per_mwh = 0.5

[[grid]]
bus = "{grid}"
import_max_mw = 40
import_cost_per_mwh = 0.3
"""


def read_net() -> Any:
    """Return the SimBench network, cut to the low-voltage grids that are kept."""
    import simbench

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        net = simbench.get_simbench_net(CODE)
    lv = net.bus.index[net.bus.vn_kv < 1]
    # Every low-voltage grid hangs on one transformer; what is dropped moves to its upper end.
    owner = net.bus.subnet.str.extract(r"(LV\d\.\d+)")[0]
    upper = dict(zip(owner[net.trafo.lv_bus], net.trafo.hv_bus, strict=True))
    dropped = lv[~owner[lv].isin(KEPT)]
    for table in (net.load, net.sgen):
        moved = table.bus.isin(dropped)
        table.loc[moved, "bus"] = owner[table.bus[moved]].map(upper).to_numpy()
    net.line = net.line[~net.line.from_bus.isin(dropped)]
    net.trafo = net.trafo[~net.trafo.lv_bus.isin(dropped)]
    net.bus = net.bus.drop(dropped)
    return net


def numbered(net: Any) -> dict[int, int]:
    """Return the number of every bus in the case, from 1, in the order of SimBench."""
    return {bus: i for i, bus in enumerate(net.bus.index, start=1)}


def write_network(net: Any, path: Path) -> Any:
    """Write the network as a MATPOWER case, through the package's own reader; returns it."""
    import pandapower

    from resilience.case.networks.pandapower_net import feeder_from_json

    with tempfile.TemporaryDirectory() as folder:
        pandapower.to_json(net, str(Path(folder) / "net.json"))
        network = feeder_from_json(Path(folder) / "net.json").network
    if len(network.bus_names) != len(net.bus):
        raise SystemExit("error: switches fuse buses, so numbers by position are wrong")
    root = int(net.ext_grid.bus.map(numbered(net)).iloc[0])
    bus = [
        f"{n} {3 if n == root else 1} 0 0 0 0 1 1 0 {vn:g} 1 1.1 0.9"
        for n, vn in enumerate(network.vn_kv, start=1)
    ]
    ends = network.from_bus, network.to_bus, network.r_pu, network.x_pu, network.rating_mva
    branch = [
        f"{i + 1} {j + 1} {r:.7g} {x:.7g} 0 {0 if math.isinf(s) else s:.4g} 0 0 0 0 {int(on)}"
        for i, j, r, x, s, on in zip(*ends, network.in_service, strict=True)
    ]
    tables = {"bus": bus, "gen": [f"{root} 0 0 0 0 1 1 1 40 0"], "branch": branch}
    text = "\n".join(
        f"mpc.{k} = [\n" + "\n".join(f"{r};" for r in v) + "\n];" for k, v in tables.items()
    )
    head = "function mpc = large\n% Made by scripts/make_large_case.py; see large.toml.\n"
    path.write_text(f"{head}mpc.version = '2';\nmpc.baseMVA = 1;\n{text}\n")
    return network


def sums(table: pd.DataFrame, number: dict[int, int]) -> list[tuple[int, float, str]]:
    """Return `(bus, MW, SimBench profile of the largest)` of the devices at every bus."""
    table = table.assign(bus=table.bus.map(number)).sort_values("p_mw", kind="stable")
    found = table.groupby("bus").agg(p_mw=("p_mw", "sum"), profile=("profile", "last"))
    return [(int(b), float(p), str(k)) for b, p, k in found.itertuples()]


def device_lines(net: Any) -> dict[str, list[str]]:
    """Return the TOML of every device by kind."""
    number = numbered(net)
    solar = net.sgen[net.sgen.profile.str.startswith("PV")]
    upper = net.trafo.set_index(net.trafo.name.str.extract(r"(LV\d\.\d+)")[0]).hv_bus
    stations = [number[upper[name]] for name in KEPT]
    return {
        "load": [
            f'name = "load{b}", bus = "{b}", p_max_mw = {p:.5g}, profile = "{COLUMNS[k[:2]]}"'
            for b, p, k in sums(net.load, number)
        ],
        "pv": [
            f'name = "pv{b}", bus = "{b}", p_max_mw = {p:.5g}, profile = "{k}"'
            for b, p, k in sums(solar, number)
        ],
        "ess": [f'name = "ess{i}", bus = "{b}"' for i, b in enumerate(stations, start=1)],
        "generator": [
            f'name = "gen{i}", bus = "{b}"'
            for i, b in enumerate(stations[::GENERATOR_EVERY], start=1)
        ],
    }


def broken_lines(net: Any) -> list[str]:
    """Return the longest medium-voltage lines in service: most exposed to a storm."""
    number = numbered(net)
    opened = net.switch.element[(net.switch.et == "l") & ~net.switch.closed]
    lines = net.line[
        (net.bus.vn_kv[net.line.from_bus] > 1).to_numpy() & ~net.line.index.isin(opened)
    ]
    longest = lines.sort_values("length_km", ascending=False, kind="stable")[:BREAKPOINTS]
    return [
        f"{number[a]}-{number[b]}" for a, b in zip(longest.from_bus, longest.to_bus, strict=True)
    ]


def main() -> None:
    """Write both files."""
    net = read_net()
    network = write_network(net, CASES / "large.m")
    storms = broken_lines(net)
    outages = ", ".join(f'"{name}@14:00-17:30"' for name in storms[::10])
    grid = numbered(net)[int(net.ext_grid.bus.iloc[0])]
    head = HEAD.format(buses=len(network.bus_names), outages=outages, grid=grid)
    tables = {
        "line": [f'name = "{name}", breakpoint = true' for name in storms],
        **device_lines(net),
    }
    lists = [
        f"{kind} = [\n" + "".join(f"    {{ {row} }},\n" for row in rows) + "]\n"
        for kind, rows in tables.items()
    ]
    before, table, after = head.partition("[network]\n")
    path = CASES / "large.toml"
    path.write_text(before + "\n".join(lists) + "\n" + table + after)
    for file in (path, CASES / "large.m"):
        print(f"wrote {file} ({file.stat().st_size / 1000:.0f} kB)")


if __name__ == "__main__":
    main()
