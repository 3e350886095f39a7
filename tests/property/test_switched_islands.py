"""Random islands that switches shape and units form, against an enumeration of their own."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from resilience.arrays import Bools
from resilience.case import Case
from resilience.models.case_program import status
from resilience.testing import small_case
from tests.known.solving import solved

SLOTS = 3
LINES = [(1, 2), (2, 3), (3, 4), (2, 4)]
SWITCHED = [1, 2, 3]
"""Numbers of those that are switchable, a ring; the first one joins it to the grid."""
SHORT = 1e-4
"""Per unit: lines lose 1e-4 of what they carry."""


def drawn(seed: int) -> Case:
    """A grid, and behind a line that fails a ring of switches with diesels, sun and loads."""
    rng = np.random.default_rng([seed, 16])

    def some(low: float, high: float) -> float:
        return round(float(rng.uniform(low, high)), 2)

    def diesel(bus: str) -> dict[str, object]:
        p_max = some(0.5, 1.4)
        return {
            "bus": bus,
            "p_max_mw": p_max,
            "p_min_mw": some(0.1, 0.3),
            "q_min_mvar": -p_max,
            "q_max_mvar": p_max,
            "cost_per_mwh": some(6.0, 12.0),
            "no_load_cost_per_h": some(2.0, 16.0),
            "start_cost": some(1.0, 7.0),
            "grid_forming": bool(rng.random() < 0.75),
        }

    first, stop = sorted(rng.choice(SLOTS + 1, 2, replace=False))
    hit = int(rng.integers(1, len(LINES)))
    other = sorted(rng.choice(SLOTS + 1, 2, replace=False))
    name = [f"{i}-{j}" for i, j in LINES]
    return small_case(
        slots=SLOTS,
        buses=4,
        lines=[(i, j, SHORT, 1.3 * SHORT) for i, j in LINES],
        line_tables=[
            {"name": name[k], "switchable": True, "switching_cost": some(0.2, 3.0)}
            for k in SWITCHED
        ],
        outages=[
            f"{name[k]}@{a:02}:00-{b:02}:00" for k, (a, b) in ((0, (first, stop)), (hit, other))
        ],
        profiles={
            "sun": [some(0.1, 1.4) for _ in range(SLOTS)],
            "demand": [some(0.4, 1.3) for _ in range(SLOTS)],
        },
        load=[
            {"bus": b, "p_max_mw": some(0.2, 0.8), "profile": "demand"}
            | {"shed_cost_per_mwh": some(15, 60)}
            for b in "234"
        ],
        grid=[{"import_max_mw": 5.0, "import_cost_per_mwh": some(3, 9), "v_pu": 1.02}],
        pv=[{"bus": "4", "p_max_mw": some(0.3, 0.9), "profile": "sun", "s_mva": 2.3}],
        generator=[diesel("2"), diesel("3")],
    )  # fmt: skip


def islands(closed: tuple[bool, ...]) -> list[set[str]] | None:
    """Sets of buses that closed lines join; None where they make a cycle."""
    groups = [{str(k)} for k in range(1, 5)]
    for (i, j), on in zip(LINES, closed, strict=True):
        if on:
            a = next(g for g in groups if str(i) in g)
            b = next(g for g in groups if str(j) in g)
            if a is b:
                return None
            groups.remove(b)
            a |= b
    return groups


def slot_cost(case: Case, t: int, group: set[str], on: tuple[bool, ...]) -> float:
    """$ of an island in merit order.

    It is inf where units that run, or lines that are closed by switches, stand in the dark, and
    where units give too much.
    """
    loads = [load for load in case.load if load.bus in group]
    demand = {load.shed_cost_per_mwh: 0.0 for load in loads}
    for load in loads:
        demand[load.shed_cost_per_mwh] += load.p_max_mw * case.profile("demand")[t]
    units = [u for u, runs in zip(case.generator, on, strict=True) if runs and u.bus in group]
    (grid,), (sun,) = case.grid, case.pv
    alive = grid.bus in group or any(u.grid_forming for u in units)
    if not alive:
        return (
            np.inf if units or len(group) > 1 else sum(price * mw for price, mw in demand.items())
        )
    offers = [(u.cost_per_mwh, u.p_max_mw - u.p_min_mw) for u in units]
    if sun.bus in group:
        offers.append((0.0, sun.p_max_mw * case.profile("sun")[t]))
    if grid.bus in group:
        offers.append((float(grid.import_cost_per_mwh or 0.0), grid.import_max_mw))
    offers += list(demand.items())
    cost = sum(u.cost_per_mwh * u.p_min_mw + u.no_load_cost_per_h for u in units)
    need = sum(demand.values()) - sum(u.p_min_mw for u in units)
    if need < 0.0:
        return np.inf
    for price, mw in sorted(offers):
        cost += price * min(mw, need)
        need -= min(mw, need)
    return float(cost)


def optimum(case: Case) -> float:
    """The least cost over all states of switches and units, by dynamic programming."""
    up: Bools = status(case)
    switches = list(product((False, True), repeat=len(SWITCHED)))
    units = list(product((False, True), repeat=len(case.generator)))
    tables = {table.name: table for table in case.line}
    prices = [tables[f"{i}-{j}"].switching_cost for i, j in (LINES[k] for k in SWITCHED)]
    # As published the ring is closed: what is open at first has been opened.
    best = {((True,) * len(SWITCHED), (False,) * len(case.generator)): 0.0}
    for t in range(SLOTS):
        after: dict[tuple[tuple[bool, ...], tuple[bool, ...]], float] = {}
        for closed in switches:
            if any(on and not up[k, t] for k, on in zip(SWITCHED, closed, strict=True)):
                continue
            groups = islands((bool(up[0, t]), *closed))
            if groups is None:
                continue
            for on in units:
                here = sum(slot_cost(case, t, group, on) for group in groups)
                moved = min(
                    cost
                    + sum(p for p, a, b in zip(prices, closed, before, strict=True) if a != b)
                    + sum(
                        u.start_cost
                        for u, a, b in zip(case.generator, on, ran, strict=True)
                        if a and not b
                    )
                    for (before, ran), cost in best.items()
                )
                after[closed, on] = here + moved
        best = after
    return min(best.values())


@pytest.mark.parametrize("seed", range(12))
def test_switches_and_units_that_form_cost_what_an_enumeration_says(seed: int) -> None:
    case = drawn(seed)
    right = optimum(case)
    found = solved(case, "milp", "copperplate", gap=1e-6)
    assert found.objective == pytest.approx(right, rel=1e-5)
    assert found.bound <= right * (1.0 + 1e-5)


@pytest.mark.parametrize("seed", range(12, 15))
def test_with_losses_they_cost_hardly_more(seed: int) -> None:
    """Lines lose at most 1e-4 of the power of all loads."""
    case = drawn(seed)
    right = optimum(case)
    found = solved(case, "minlp", gap=1e-4)
    assert right * (1.0 - 1e-6) <= found.objective <= right * 1.001
    assert found.bound <= right * 1.001
