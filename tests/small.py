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

Z_BASE = 100.0  # ohm at 10 kV on a base of 1 MVA
Device = Mapping[str, Any]


def small(
    *,
    slots: int = 2,
    step_min: float = 60.0,
    buses: int = 1,
    lines: Sequence[tuple[int, int, float, float]] = (),
    about: Sequence[Device] = (),
    columns: Mapping[str, Sequence[float]] | None = None,
    outages: Sequence[str] = (),
    terminal: float = 0.0,
    band: tuple[float, float] = (0.9, 1.1),
    **devices: Sequence[Device],
) -> Case:
    """A case with buses "1", "2", ... of 10 kV, its horizon from midnight.

    Args:
        slots, step_min: the horizon.
        buses: how many there are.
        lines: (from, to, r in pu, x in pu), called "from-to".
        about: `[[line]]` tables.
        columns: inline profiles.
        outages, terminal: keys of the case's head.
        band: limits of the voltage in pu.
        devices: tables by kind (load=, pv=, ess=, generator=, grid=), at bus "1" unless they say
            otherwise, and called after their kind and number.
    """
    branches = [
        {"from": str(i), "to": str(j), "r_ohm": r * Z_BASE, "x_ohm": x * Z_BASE}
        for i, j, r, x in lines
    ]
    document: dict[str, Any] = {
        "name": "small",
        "terminal_value_per_mwh": terminal,
        "outages": list(outages),
        "time": {"start": datetime(2016, 7, 12), "slots": slots, "step_min": step_min},
        "network": {
            "v_min_pu": band[0],
            "v_max_pu": band[1],
            "bus": [{"name": str(k + 1), "vn_kv": 10.0} for k in range(buses)],
            "line": branches,
        },
        "line": [dict(table) for table in about],
        "profiles": {"columns": {k: list(v) for k, v in (columns or {}).items()}},
    }
    for kind, tables in devices.items():
        document[kind] = [
            {"name": f"{kind}{k + 1}", "bus": "1", **table} for k, table in enumerate(tables)
        ]
    return build_case(Document(None, document))


@dataclass(frozen=True)
class Best:
    """An optimum by direct HiGHS, settled: $ and the values of every variable, (labels, nodes)."""

    problem: CaseProgram
    objective: float
    z: Floats

    def __getitem__(self, name: str) -> Floats:
        return self.z[self.problem.standard.columns(name)]


def best(case: Case, physics: Physics = "copperplate") -> Best:
    """The optimum of a case with all its integers and modes.

    Raises:
        AssertionError: there is none.
    """
    problem = horizon(case, physics)
    solver = Highs(problem.standard, gap=0.0)
    solver.update(problem.vectors)
    found = solver.solve()
    assert found.status == "optimal", found.status
    z = settle(problem.standard, found.point, problem.vectors)
    assert audit(problem.standard, z, problem.vectors).maximum < 1e-6
    return Best(problem, found.objective, z)
