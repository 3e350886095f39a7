"""Cases of a few buses, slots and devices, built in memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from resilience.arrays import Floats
from resilience.case import Case
from resilience.case.document import Document
from resilience.case.load import build_case
from resilience.models.backends.highs import Highs
from resilience.models.case_program import CaseProgram, horizon
from resilience.models.microgrid import Physics
from resilience.models.program.referee import audit, settle
from resilience.tolerances import RELAXATION_TOLERANCE

BASE_OHM = 100.0  # 1 pu: 10 kV on a base of 1 MVA
MIDNIGHT = datetime(2016, 7, 12)
DeviceKeys = Mapping[str, Any]


def small_case(  # noqa: PLR0913 every one is a key of the case
    *,
    slots: int = 2,
    step_min: float = 60.0,
    start: datetime = MIDNIGHT,
    buses: int = 1,
    lines: Sequence[tuple[int, int, float, float] | tuple[int, int, float, float, DeviceKeys]] = (),
    bus_tables: Mapping[int, DeviceKeys] | None = None,
    line_tables: Sequence[DeviceKeys] = (),
    tanks: Sequence[DeviceKeys] = (),
    profiles: Mapping[str, Sequence[float]] | None = None,
    outages: Sequence[str] = (),
    terminal_value_per_mwh: float = 0.0,
    voltage_band_pu: tuple[float, float] = (0.9, 1.1),
    parallel_grids: bool = False,
    **devices: Sequence[DeviceKeys],
) -> Case:
    """A case with buses "1", "2", ... of 10 kV.

    Args:
        slots: of the horizon.
        step_min: length of a slot, minutes.
        start: of the horizon.
        buses: how many there are.
        lines: (from, to, r in pu, x in pu), called "from-to"; what else its table says may follow.
        bus_tables: what the table of a bus says beside, by its number.
        line_tables: `[[line]]` tables.
        tanks: `[[tank]]` tables, called "tank1", "tank2", ...
        profiles: values by name, (slots,) per unit.
        outages: as a case states them, `"1-2@14:00-17:30"`.
        terminal_value_per_mwh: credit for energy left at the end, $/MWh.
        voltage_band_pu: lowest and highest voltage, pu.
        parallel_grids: whether several grid connections may feed one tree.
        devices: tables by kind (load=, pv=, ess=, generator=, grid=), at bus "1" unless they say
            otherwise, and called after their kind and number.

    Raises:
        CaseError: tables with mistakes; all of them are listed.
    """
    branches = [
        {"from": str(i), "to": str(j), "r_ohm": r * BASE_OHM, "x_ohm": x * BASE_OHM}
        | (dict(keys[0]) if keys else {})
        for i, j, r, x, *keys in lines
    ]
    more = bus_tables or {}
    document: dict[str, Any] = {
        "name": "small",
        "terminal_value_per_mwh": terminal_value_per_mwh,
        "outages": list(outages),
        "time": {"start": start, "slots": slots, "step_min": step_min},
        "network": {
            "v_min_pu": voltage_band_pu[0],
            "v_max_pu": voltage_band_pu[1],
            "parallel_grids": parallel_grids,
            "bus": [
                {"name": str(k), "vn_kv": 10.0} | dict(more.get(k, {})) for k in range(1, buses + 1)
            ],
            "line": branches,
        },
        "line": [dict(table) for table in line_tables],
        "tank": [{"name": f"tank{k + 1}", **table} for k, table in enumerate(tanks)],
        "profiles": {"columns": {name: list(v) for name, v in (profiles or {}).items()}},
    }
    for kind, tables in devices.items():
        document[kind] = [
            {"name": f"{kind}{k + 1}", "bus": "1", **table} for k, table in enumerate(tables)
        ]
    return build_case(Document(None, document))


@dataclass(frozen=True)
class CaseOptimum:
    """The optimum of a case by HiGHS alone; `optimum["ess.charge"]` is (units, slots).

    Attributes:
        program: what was solved.
        objective: $.
        z: (columns,) values, with every structure settled.
    """

    program: CaseProgram
    objective: float
    z: Floats

    def __getitem__(self, name: str) -> Floats:
        return self.z[self.program.standard.columns(name)]


def case_optimum(case: Case, physics: Physics = "copperplate") -> CaseOptimum:
    """The optimum of a case with all its integers and modes.

    Args:
        case: the case.
        physics: copperplate or lindistflow.

    Raises:
        AssertionError: there is none, or it fails the audit.
    """
    program = horizon(case, physics)
    backend = Highs(program.standard, gap=0.0)
    backend.update(program.vectors)
    solution = backend.solve()
    assert solution.status == "optimal", solution.status
    z = settle(program.standard, solution.point, program.vectors)
    worst = audit(program.standard, z, program.vectors).maximum
    assert worst < RELAXATION_TOLERANCE, f"a row is violated by {worst:g}"
    return CaseOptimum(program, solution.objective, z)
