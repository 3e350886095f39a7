"""What of the wires of a pandapower network a case does not model."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from resilience.case.networks.omissions import Omission, omission
from resilience.case.networks.pandapower_tables import (
    Row,
    Tables,
    active,
    number,
    source_names,
    titles,
)

_READ = frozenset({
    "net", "bus", "switch", "line", "trafo", "impedance", "load", "asymmetric_load", "sgen",
    "asymmetric_sgen", "gen", "ext_grid", "storage", "ward", "xward", "motor", "shunt",
    "poly_cost", "pwl_cost",
})  # fmt: skip


def omissions(
    tables: Tables, names: Mapping[int, str], shorted: Sequence[str]
) -> Iterator[Omission]:
    """What of buses, branches and switches is left out.

    Args:
        tables: of the network.
        names: of the buses in service by index.
        shorted: branches whose ends closed switches make one bus.
    """
    vn_kv = {int(row["index"]): number(row, "vn_kv", math.nan) for row in tables["bus"]}
    yield from _of_transformers(_branches(tables, "trafo", names), vn_kv)
    f_hz = number(tables["net"][0], "f_hz", 50.0)
    yield from _of_lines(_branches(tables, "line", names), vn_kv, f_hz)
    yield from _of_impedances(_branches(tables, "impedance", names))
    yield from _of_shunts(tables, names)
    yield from omission("branch shorted by switches", [(name, 0.0) for name in shorted])
    couplers = [
        (f"{names[int(r['bus'])]}-{names[int(r['element'])]}", 0.0)
        for r in tables.get("switch", [])
        if r["et"] == "b"
        and not r["closed"]
        and int(r["bus"]) in names
        and int(r["element"]) in names
    ]
    yield from omission("open coupler", couplers)
    for kind in sorted(tables.keys() - _READ):
        rows = [row for row in active(tables, kind) if "in_service" in row]
        name = titles(kind, rows)
        yield from omission(kind, [(name[int(row["index"])], 0.0) for row in rows])


def _branches(tables: Tables, kind: str, names: Mapping[int, str]) -> list[tuple[Row, str]]:
    """Branches in service between buses in service, with the names they have in a case."""
    ends = ("hv_bus", "lv_bus") if kind == "trafo" else ("from_bus", "to_bus")
    labels = source_names(tables.get(kind, [])) or {}
    branches = []
    for row in active(tables, kind):
        start, stop = (names.get(int(row[end])) for end in ends)
        if start is not None and stop is not None:
            branches.append((row, labels.get(int(row["index"]), f"{start}-{stop}")))
    return branches


def _of_transformers(rows: list[tuple[Row, str]], vn_kv: Mapping[int, float]) -> Iterator[Omission]:
    taps, ratios, shifts, iron = [], [], [], []
    for row, title in rows:
        steps = number(row, "tap_pos", 0.0) - number(row, "tap_neutral", 0.0)
        percent, degrees = (
            steps * number(row, f"tap_step_{unit}", 0.0) for unit in ("percent", "degree")
        )
        if percent or degrees:
            taps.append((f"{title}: {steps:+g} steps, {percent:+g} %", 0.0))
        rated = number(row, "vn_hv_kv", math.nan) / number(row, "vn_lv_kv", math.nan)
        nominal = vn_kv[int(row["hv_bus"])] / vn_kv[int(row["lv_bus"])]
        if abs(rated / nominal - 1.0) > 1e-6:
            ratios.append((f"{title}: {rated:.4g} in place of {nominal:.4g}", 0.0))
        if number(row, "shift_degree", 0.0):
            shifts.append((f"{title}: {number(row, 'shift_degree', 0.0):g} deg", 0.0))
        if number(row, "pfe_kw", 0.0) or number(row, "i0_percent", 0.0):
            iron.append((title, number(row, "pfe_kw", 0.0) * number(row, "parallel", 1.0)))
    yield from omission("tap", taps)
    yield from omission("rated ratio", ratios)
    yield from omission("phase shift", shifts)
    yield from omission("magnetising branch", iron, "kW")


def _of_lines(
    rows: list[tuple[Row, str]], vn_kv: Mapping[int, float], f_hz: float
) -> Iterator[Omission]:
    charging, leaking = [], []
    for row, title in rows:
        square = number(row, "length_km", 0.0) * number(row, "parallel", 1.0)
        square *= vn_kv[int(row["from_bus"])] ** 2
        if farad := number(row, "c_nf_per_km", 0.0) * 1e-9:
            charging.append((title, 2.0 * math.pi * f_hz * farad * square))
        if siemens := number(row, "g_us_per_km", 0.0) * 1e-6:
            leaking.append((title, siemens * square))
    yield from omission("charging", charging, "Mvar")
    yield from omission("leakage", leaking, "MW")


def _of_impedances(rows: list[tuple[Row, str]]) -> Iterator[Omission]:
    def differs(row: Row) -> bool:
        there = {x: number(row, f"{x}ft_pu", 0.0) for x in "rx"}
        return any(number(row, f"{x}tf_pu", there[x]) != there[x] for x in "rx")

    uneven = [(title, 0.0) for row, title in rows if differs(row)]
    yield from omission("uneven impedance", uneven, instead="as seen from its from_bus")
    shunted = [
        (title, 0.0)
        for row, title in rows
        if any(number(row, f"{axis}{end}_pu", 0.0) for axis in "gb" for end in ("f", "t"))
    ]
    yield from omission("shunt of an impedance", shunted)


def _of_shunts(tables: Tables, names: Mapping[int, str]) -> Iterator[Omission]:
    rows = [row for row in active(tables, "shunt") if int(row["bus"]) in names]
    for element, key, unit in (("shunt conductance", "p_mw", "MW"), ("shunt", "q_mvar", "Mvar")):
        places = [
            (names[int(row["bus"])], size)
            for row in rows
            if (size := number(row, key, 0.0) * number(row, "step", 1.0))
        ]
        yield from omission(element, places, unit)
