"""What of the wires of a pandapower network a case does not model."""

from __future__ import annotations

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

_TABLED = {"trafo": "tap_dependency_table", "shunt": "step_dependency_table"}
_WORDS = {"trafo": "transformer", "shunt": "shunt"}


def omissions(
    tables: Tables, names: Mapping[int, str], shorted: Sequence[str]
) -> Iterator[Omission]:
    """What of buses, branches and switches is left out.

    Args:
        tables: of the network.
        names: of the buses in service by index.
        shorted: branches whose ends closed switches make one bus.
    """
    for kind in ("trafo", "shunt"):
        rows = [
            row
            for row in active(tables, kind)
            if number(row, _TABLED[kind], 0.0) and (kind == "trafo" or int(row["bus"]) in names)
        ]
        name = titles(kind, rows)
        places = [(name[int(row["index"])], 0.0) for row in rows]
        yield from omission(f"{_TABLED[kind].split('_')[0]} table of a {_WORDS[kind]}", places)
    yield from _of_impedances(_branches(tables, "impedance", names))
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


def _of_impedances(rows: list[tuple[Row, str]]) -> Iterator[Omission]:
    def differs(row: Row) -> bool:
        there = {x: number(row, f"{x}ft_pu", 0.0) for x in "rx"}
        return any(number(row, f"{x}tf_pu", there[x]) != there[x] for x in "rx")

    uneven = [(title, 0.0) for row, title in rows if differs(row)]
    yield from omission("uneven impedance", uneven, instead="as seen from its from_bus")
