"""Three feeders of three substations, 16 buses (Civanlar et al. 1988): one grid per tree.

Data: S. Civanlar, J. J. Grainger, H. Yin, S. S. H. Lee, Distribution Feeder Reconfiguration for
Loss Reduction, IEEE Transactions on Power Delivery 3 (1988) 1217-1223; ohms at 10 kV here, which
is its per unit at 100 MVA.
"""

from __future__ import annotations

from datetime import datetime
from typing import Any

import numpy as np
import pytest

from resilience.case import Case
from resilience.case.document import Document
from resilience.case.load import build_case
from tests.known.solving import Solved, solved

BRANCHES = [
    (1, 4, 0.075, 0.10), (4, 5, 0.08, 0.11), (4, 6, 0.09, 0.18), (6, 7, 0.04, 0.04),
    (2, 8, 0.11, 0.11), (8, 9, 0.08, 0.11), (8, 10, 0.11, 0.11), (9, 11, 0.11, 0.11),
    (9, 12, 0.08, 0.11), (3, 13, 0.11, 0.11), (13, 14, 0.09, 0.12), (13, 15, 0.08, 0.11),
    (15, 16, 0.04, 0.04), (5, 11, 0.04, 0.04), (10, 14, 0.04, 0.04), (7, 16, 0.09, 0.12),
]  # fmt: skip
"""From, to, r and x in ohms; the last three are the ties, open as published."""
TIES = 13
"""Number of the first of them."""
LOADS = {
    4: (2.0, 1.6), 5: (3.0, 1.5), 6: (2.0, 0.8), 7: (1.5, 1.2), 8: (4.0, 2.7), 9: (5.0, 3.0),
    10: (1.0, 0.9), 11: (0.6, 0.1), 12: (4.5, 2.0), 13: (1.0, 0.9), 14: (1.0, 0.7),
    15: (1.0, 0.9), 16: (2.1, 1.0),
}  # fmt: skip
"""MW and Mvar."""
CAPACITORS = {5: 1.1, 6: 1.2, 9: 1.2, 11: 0.6, 12: 3.7, 14: 1.8, 16: 1.8}
"""Mvar."""
DEMAND_MW = sum(p for p, _ in LOADS.values())
MIDNIGHT = datetime(2026, 1, 1)
ONE_TREE_EACH = {"8-10", "9-11", "7-16"}
"""Lines open at the known optimum."""


def feeders(*, parallel: bool, switchable: bool = True) -> Case:
    """One hour; a MWh costs 1 $, so that the objective is the demand and the losses."""
    names = [f"{i}-{j}" for i, j, _, _ in BRANCHES]
    network: dict[str, Any] = {
        "v_min_pu": 0.9,
        "v_max_pu": 1.1,
        "parallel_grids": parallel,
        "bus": [{"name": str(k), "vn_kv": 10.0} for k in range(1, 17)],
        "line": [
            {"name": names[k], "from": str(i), "to": str(j), "r_ohm": r, "x_ohm": x}
            | {"in_service": switchable or k < TIES}
            for k, (i, j, r, x) in enumerate(BRANCHES)
        ],
    }
    return build_case(Document(None, {
        "name": "civanlar",
        "terminal_value_per_mwh": 0.0,
        "time": {"start": MIDNIGHT, "slots": 1, "step_min": 60},
        "network": network,
        "line": [{"name": name, "switchable": True} for name in names if switchable],
        "load": [
            {"name": f"load{k}", "bus": str(k), "p_max_mw": p, "shed_cost_per_mwh": 1000.0}
            | {"power_factor": p / np.hypot(p, q)}
            for k, (p, q) in LOADS.items()
        ],
        "generator": [
            {"name": f"capacitor{k}", "bus": str(k), "p_max_mw": 0.0, "grid_forming": False}
            | {"cost_per_mwh": 1.0, "q_min_mvar": q, "q_max_mvar": q}
            for k, q in CAPACITORS.items()
        ],
        "grid": [
            {"name": f"substation{k}", "bus": str(k), "v_pu": 1.0, "import_max_mw": 40.0}
            | {"import_cost_per_mwh": 1.0, "q_max_mvar": 40.0}
            for k in (1, 2, 3)
        ],
    }))  # fmt: skip


def losses_kw(found: Solved) -> float:
    return 1000.0 * (found.objective - DEMAND_MW)


def opened(found: Solved) -> set[str]:
    names = found.problem.standard.labels("line.closed")
    return {name for name, on in zip(names, found["line.closed"][:, 0], strict=True) if on < 0.5}


def test_the_published_switches_lose_511_kw() -> None:
    found = solved(feeders(parallel=False, switchable=False), "minlp")
    assert losses_kw(found) == pytest.approx(511.4, abs=0.1)


def test_three_grids_feed_three_trees_at_the_known_optimum() -> None:
    found = solved(feeders(parallel=False), "minlp", gap=1e-5)
    assert opened(found) == ONE_TREE_EACH
    assert losses_kw(found) == pytest.approx(466.1, abs=0.1)
    assert found.objective - found.bound <= 1e-5 * found.objective


def test_grids_in_parallel_close_all_lines_but_one() -> None:
    """One tree with three roots, which no substation would run, and which loses less."""
    found = solved(feeders(parallel=True), "minlp", gap=1e-5)
    assert len(opened(found)) == 1
    assert losses_kw(found) < 466.0
