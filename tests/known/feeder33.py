"""Baran and Wu's feeder with its own loads, and a power flow of its own for any of its trees.

The sweep is a fixed point on the bus impedance matrix, V = V_1 - Z conj(S / V), for many topologies
at once. It shares nothing with the package but the line and load data of pandapower.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import cache
from typing import Any

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.case import Case
from resilience.case.document import Document
from resilience.case.load import build_case

LOAD_MW = 3.715
BASE_OPEN = (33, 34, 35, 36, 37)
BEST_OPEN = (7, 9, 14, 32, 37)
TREES = 50_751
SHED = 3.0  # $/MWh, dear enough that nothing is shed, cheap enough for SCIP's tolerance on bounds


@dataclass(frozen=True)
class Feeder:
    """Lines 1 to 37 of the literature in order; impedances and loads in pu on 1 MVA."""

    ends: Ints
    z: Any
    load: Any


@cache
def net() -> Any:
    import pandapower.networks

    return pandapower.networks.case33bw()


@cache
def feeder() -> Feeder:
    line, load = net().line, net().load
    ohm = (line.r_ohm_per_km + 1j * line.x_ohm_per_km) * line.length_km
    power = np.zeros(33, complex)
    np.add.at(power, load.bus.to_numpy(), (load.p_mw + 1j * load.q_mvar).to_numpy())
    ends = line[["from_bus", "to_bus"]].to_numpy(np.intp)
    return Feeder(ends, ohm.to_numpy() / 12.66**2, power)


def case33(switchable: bool = False) -> Case:
    """One hour of the feeder at 1 $/MWh, so that its objective is load plus losses in MW."""
    names = [f"{i + 1}-{j + 1}" for i, j in feeder().ends]
    loads = [
        {
            "name": f"load{k + 1}",
            "bus": str(k + 1),
            "p_max_mw": float(s.real),
            "power_factor": math.cos(math.atan2(s.imag, s.real)),
            "shed_cost_per_mwh": SHED,
        }
        for k, s in enumerate(feeder().load)
        if s
    ]
    document: dict[str, Any] = {
        "name": "case33",
        "network": {"pandapower": "case33bw", "v_min_pu": 0.9},
        "time": {"start": datetime(2016, 7, 12), "slots": 1, "step_min": 60.0},
        "grid": [{"bus": "1", "import_max_mw": 5.0, "import_cost_per_mwh": 1.0}],
        "load": loads,
        "line": [{"name": name, "switchable": True} for name in names] if switchable else [],
    }
    return build_case(Document(None, document))


def exchanges(open_lines: tuple[int, ...]) -> list[tuple[int, ...]]:
    """All trees that differ from this one by one branch exchange, itself first."""
    found = {open_lines}
    for shut, opened in itertools.product(open_lines, range(1, 38)):
        found.add(tuple(sorted({*open_lines, opened} - {shut})))
    five = sorted((lines for lines in found if len(lines) == 5), key=lambda t: t != open_lines)
    return [lines for lines, tree in zip(five, are_trees(five), strict=True) if tree]


def all_trees() -> list[tuple[int, ...]]:
    """Every choice of five open lines that leaves a spanning tree."""
    chosen = list(itertools.combinations(range(1, 38), 5))
    return [chosen[k] for k in np.flatnonzero(are_trees(chosen))]


def are_trees(chosen: Sequence[tuple[int, ...]]) -> Any:
    """(n,) whether 32 lines are left that reach all 33 buses from the first."""
    closed = _closed(chosen)
    reached = np.zeros((len(chosen), 33), bool)
    reached[:, 0] = True
    count = 0
    while count != reached.sum():
        count = reached.sum()
        for k, (i, j) in enumerate(feeder().ends):
            either = (reached[:, i] | reached[:, j]) & closed[:, k]
            reached[:, i] |= either
            reached[:, j] |= either
    return reached.all(1) & (closed.sum(1) == 32)


def losses_kw(chosen: list[tuple[int, ...]], chunk: int = 4000) -> tuple[Floats, Floats]:
    """(n,) losses in kW and lowest voltage in pu of each tree; inf where the flow diverges."""
    parts = [_losses(chosen[k : k + chunk]) for k in range(0, len(chosen), chunk)]
    loss, lowest = (np.concatenate(part) for part in zip(*parts, strict=True))
    return loss, lowest


def _closed(chosen: Sequence[tuple[int, ...]]) -> Any:
    closed = np.ones((len(chosen), 37), bool)
    closed[np.arange(len(chosen))[:, None], np.array(chosen) - 1] = False
    return closed


def _losses(chosen: list[tuple[int, ...]]) -> tuple[Floats, Floats]:
    data = feeder()
    incidence = np.zeros((37, 33))
    incidence[np.arange(37), data.ends[:, 0]], incidence[np.arange(37), data.ends[:, 1]] = 1, -1
    a = incidence[:, 1:]
    y = _closed(chosen) / data.z
    z = np.linalg.inv(np.einsum("li,nl,lj->nij", a, y, a, optimize=True))
    v = np.ones((len(chosen), 32), complex)
    with np.errstate(all="ignore"):
        for _ in range(100):
            before = v
            v = 1.0 - np.einsum("nij,nj->ni", z, np.conj(data.load[1:] / v))
            if np.nanmax(np.abs(v - before)) < 1e-12:
                break
        settled = np.abs(v - before).max(1) < 1e-9
        every = np.concatenate([np.ones((len(v), 1)), v], axis=1)
        sent = np.abs(every @ incidence.T) ** 2 * np.real(np.conj(y))
    loss = np.where(settled, 1e3 * sent.sum(1), np.inf)
    return loss, np.where(settled, np.abs(every).min(1), 0.0)
