"""Branch and bound over trees: no forest is lost, no bound is above what a forest costs."""

from __future__ import annotations

import itertools
from functools import partial
from typing import Any

import networkx as nx
import numpy as np
import pytest

from resilience.case import Case
from resilience.models.case_program import CaseProgram, horizon
from resilience.models.methods.trees.branch import TreeBranching, can_branch
from resilience.models.methods.trees.oriented import oriented
from resilience.testing import small_case
from tests.known.feeder33 import BASE_OPEN, BEST_OPEN, LOAD_MW, case33, exchanges, losses_kw
from tests.known.solving import solved

GRAPH = ((1, 2), (2, 3), (3, 4), (4, 5), (5, 1), (2, 5), (1, 4))
"""Seven lines between five buses: 24 spanning trees, as the matrix-tree theorem has it."""


def meshed(seed: int, *, closed: tuple[int, ...] | None = None, fixed: int = 0) -> Case:
    """Random impedances and loads; one bus may feed more than it takes, and charge a line.

    Args:
        seed: of the numbers.
        closed: lines, the others open, none to be switched; or all may be.
        fixed: so many lines that have no switch.
    """
    rng = np.random.default_rng(seed)
    z = rng.uniform(0.01, 0.05, (len(GRAPH), 2))
    load = rng.uniform(0.2, 1.0, 5)
    names = [f"{i}-{j}" for i, j in GRAPH]
    switches = [{"name": name, "switchable": True} for name in names[fixed:]]
    charging = 300.0 if seed % 3 == 2 else 0.0
    service = [closed is None or k in closed for k in range(len(GRAPH))]
    devices: dict[str, Any] = {
        "load": [
            {"bus": str(b), "p_max_mw": load[b - 1], "power_factor": 0.9}
            | {"shed_cost_per_mwh": 5000.0}
            for b in range(2, 6)
        ],
        "grid": [{"import_max_mw": 9.0, "import_cost_per_mwh": 50.0, "v_pu": 1.0}],
    }
    if seed % 2:
        devices["generator"] = [
            {"bus": "3", "p_max_mw": 1.5, "cost_per_mwh": 20.0, "grid_forming": False}
        ]
    return small_case(
        slots=1,
        buses=5,
        lines=[
            (*ends, *z[k], {"in_service": service[k], "b_us": charging})
            for k, ends in enumerate(GRAPH)
        ],
        line_tables=switches if closed is None else [],
        **devices,
    ).replace(loss_cost_per_mwh=30.0)


def trees(fixed: int = 0) -> list[tuple[int, ...]]:
    """Spanning trees that have the lines without a switch."""
    return [
        chosen
        for chosen in itertools.combinations(range(len(GRAPH)), 4)
        if set(range(fixed)) <= set(chosen) and nx.is_tree(nx.Graph([GRAPH[k] for k in chosen]))
    ]


def test_there_are_as_many_trees_as_kirchhoff_counts() -> None:
    laplacian = nx.laplacian_matrix(nx.Graph(GRAPH)).toarray()
    assert len(trees()) == round(float(np.linalg.det(laplacian[1:, 1:])))


@pytest.mark.parametrize(("seed", "fixed"), [(0, 0), (1, 0), (2, 0), (3, 2), (5, 1)])
def test_the_best_of_all_trees_is_proven(seed: int, fixed: int) -> None:
    """With consumers alone, with a generator that feeds back, with charging, with fixed lines."""
    best = min(solved(meshed(seed, closed=t), "nlp").objective for t in trees(fixed))
    found = solved(meshed(seed, fixed=fixed), "minlp", gap=1e-6)
    assert found.objective == pytest.approx(best, rel=1e-6)
    assert found.bound == pytest.approx(best, rel=1e-5)
    assert found.bound <= best * (1.0 + 1e-7)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_every_tree_is_a_point_of_the_relaxation(seed: int) -> None:
    """With its switches held, the bound is what the tree costs; with none, below all of them."""
    program = horizon(meshed(seed), "distflow")
    relaxation = oriented(program)
    costs = []
    for tree in trees():
        closed = np.isin(np.arange(len(GRAPH)), tree)[:, None]
        point = relaxation.cones.solve(*relaxation.box(closed, closed), np.inf)
        cost = solved(meshed(seed, closed=tree), "nlp").objective
        assert point.bound == pytest.approx(cost, rel=1e-6)
        costs.append(cost)
    free = np.zeros_like(closed), np.ones_like(closed)
    loosest = relaxation.cones.solve(*relaxation.box(*free), np.inf).bound
    assert 0.0 < loosest < min(costs)


def program33() -> CaseProgram:
    return horizon(case33(switchable=True).replace(loss_cost_per_mwh=1.0), "distflow")


def test_the_relaxation_holds_trees_of_33_buses() -> None:
    program = program33()
    relaxation, chosen = oriented(program), [BASE_OPEN, BEST_OPEN, *exchanges(BEST_OPEN)[5::25]]
    for tree, loss in zip(chosen, losses_kw(chosen)[0], strict=True):
        closed = ~np.isin(np.arange(1, 38), tree)[:, None]
        bound = relaxation.cones.solve(*relaxation.box(closed, closed), np.inf).bound
        assert bound == pytest.approx(LOAD_MW + 2.0 * loss / 1e3, rel=1e-6)


def test_a_bound_of_no_time_is_a_bound() -> None:
    """Out of time at once, after a few nodes, and at the end: never above the optimum."""
    program, optimum = program33(), LOAD_MW + 2.0 * 0.139551347
    for nodes in (0, 3, 9):
        search = TreeBranching(program, partial(next, iter([1.0] * 4 * nodes), 0.0))
        handed_out = list(search.leaves(lambda: optimum))
        assert handed_out == []
        assert search.bound <= optimum
        assert nodes == 0 or search.bound > LOAD_MW + 2.0 * 0.12


def test_only_what_is_decided_by_switches_is_branched_on() -> None:
    assert can_branch(program33())
    assert not can_branch(horizon(case33(), "distflow"))
    assert not can_branch(horizon(case33(switchable=True), "lindistflow"))
