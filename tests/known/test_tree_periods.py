"""Trees over a horizon: the load moves round a ring, and a switch costs something each time."""

from __future__ import annotations

import itertools
from functools import cache

import pytest

from resilience.case import Case
from resilience.models.case_program import horizon
from resilience.models.methods.conic import relaxation
from resilience.models.methods.trees import better_switches
from resilience.testing import small_case
from tests.known.solving import solved

RING = ("1-2", "2-3", "3-4", "4-1")
DEMAND = {"2": (2.0, 1.0, 0.1), "3": (1.0, 0.9, 1.0), "4": (0.1, 1.0, 2.0)}


def ring(switching_cost: float, closed: str = "", slot: int | None = None) -> Case:
    """Three hours, or one; `closed`: lines that are, none of them switchable; else all may."""
    slots = range(3) if slot is None else (slot,)
    tables = [{"name": name, "switchable": True, "switching_cost": switching_cost} for name in RING]
    return small_case(
        slots=len(slots),
        buses=4,
        lines=[
            (1, 2, 0.02, 0.01, {"in_service": "1-2" in closed or not closed}),
            (2, 3, 0.03, 0.02, {"in_service": "2-3" in closed or not closed}),
            (3, 4, 0.02, 0.02, {"in_service": "3-4" in closed or not closed}),
            (4, 1, 0.02, 0.01, {"in_service": "4-1" in closed}),
        ],
        line_tables=[] if closed else tables,
        profiles={f"p{bus}": [demand[t] / 2.0 for t in slots] for bus, demand in DEMAND.items()},
        load=[
            {"bus": bus, "p_max_mw": 2.0, "profile": f"p{bus}", "shed_cost_per_mwh": 3000.0}
            for bus in DEMAND
        ],
        grid=[{"import_max_mw": 9.0, "import_cost_per_mwh": 0.0, "v_pu": 1.0}],
    ).replace(loss_cost_per_mwh=100.0)


@cache
def losses() -> dict[tuple[int, int], float]:
    """$ by the line that is open and the slot, each tree and slot alone."""
    return {
        (k, t): solved(ring(0.0, " ".join(RING[:k] + RING[k + 1 :]), t), "socp").objective
        for k, t in itertools.product(range(4), range(3))
    }


def cheapest(switching_cost: float) -> float:
    """The best of all 64 sequences; line 4-1 is open at the start."""
    sequences = itertools.product(range(4), repeat=3)
    return min(
        sum(losses()[k, t] for t, k in enumerate(sequence))
        + sum(2 * switching_cost * (a != b) for a, b in itertools.pairwise((3, *sequence)))
        for sequence in sequences
    )


@pytest.mark.parametrize("switching_cost", [0.0, 0.4, 1.0, 50.0])
def test_the_exchange_finds_the_best_of_all_sequences(switching_cost: float) -> None:
    case = ring(switching_cost)
    program = horizon(case, "distflow")
    root = relaxation(program, program.vectors)
    closed = better_switches(program, root.point, 10.0)
    assert closed is not None
    opened = [int(k) for k in closed.argmin(0)]
    assert closed.sum(0) == pytest.approx(3.0)
    total = sum(losses()[k, t] for t, k in enumerate(opened))
    total += sum(2 * switching_cost * (a != b) for a, b in itertools.pairwise((3, *opened)))
    assert total == pytest.approx(cheapest(switching_cost), rel=1e-6)


@pytest.mark.parametrize("switching_cost", [0.0, 1.0])
def test_minlp_pays_for_a_switch_where_it_saves_more(switching_cost: float) -> None:
    found = solved(ring(switching_cost), "minlp", gap=1e-5)
    assert found.objective == pytest.approx(cheapest(switching_cost), rel=1e-5)
