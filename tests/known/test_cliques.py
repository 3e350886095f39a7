"""Rows on the cliques of loops: no power flow breaks them, and they bring the bound to the plan."""

from __future__ import annotations

import numpy as np
import pytest

import resilience as rs
from resilience.models.backends.conic import Conic
from resilience.models.case_program import CaseProgram, horizon
from resilience.models.program.cliques import Cliques
from tests.known.solving import solved
from tests.known.test_branches import GRID, feeder, truth
from tests.known.test_meshes import LOADS, MESHES, RING
from tests.known.ybus import Pi

SQUARE = [Pi(1, 2, 0.02, 0.03), Pi(2, 3, 0.02, 0.01), Pi(3, 4, 0.01, 0.03), Pi(1, 4, 0.03, 0.02)]
PENTAGON = [*SQUARE[:3], Pi(4, 5, 0.02, 0.02), Pi(1, 5, 0.01, 0.03)]
FOUR = LOADS | {4: 0.4 + 0.2j}
RINGS = {"three buses": (RING, LOADS), "four": (SQUARE, FOUR), "five": (PENTAGON, FOUR)}


def cliques_of(program: CaseProgram) -> Cliques:
    found = Cliques.of_program(program.standard, program.vectors)
    assert found is not None
    return found


def rounds(program: CaseProgram, cliques: Cliques, n: int) -> list[float]:
    """Bounds of the relaxation, each with the rows that the point before breaks."""
    standard, vectors = cliques.widened(program.standard, program.vectors)
    bounds = []
    for _ in range(n):
        solver = Conic(standard)
        solver.update(vectors)
        solver.add_rows(*cliques.rows)
        solution = solver.solve()
        bounds.append(solution.bound)
        cliques.separate(solution.point, 1e-7)
    return bounds


@pytest.mark.parametrize("name", RINGS)
def test_the_power_flow_keeps_every_row(name: str) -> None:
    """Rows are of products of voltages: those of an own power flow, whatever the fill is."""
    branches, loads = RINGS[name]
    program = horizon(feeder(branches, loads), "distflow")
    cliques = cliques_of(program)
    assert len(cliques.fill) == 2 * (len(branches) - 3)  # a ring of n has n - 3 chords
    bounds = rounds(program, cliques, 4)
    assert bounds[-1] > bounds[0] * (1.0 + 1e-5)
    known = truth(branches, loads, {})
    z = np.zeros(cliques.n_columns + len(cliques.fill))
    values = {"bus.v_sq": np.abs(known.volts) ** 2}
    sent = np.array([known.ends[k, 0] for k in range(len(branches))])
    sent += [0.5j * b.b * abs(known.volts[b.i - 1]) ** 2 for b in branches]
    values |= {"line.p": sent.real, "line.q": sent.imag}
    for variable, value in values.items():
        z[program.standard.columns(variable)[:, 0]] = value
    bus = {int(c): k for k, c in enumerate(program.standard.columns("bus.v_sq")[:, 0])}
    first, second = (
        known.volts[[bus[c] for c in ends.tolist()]]
        for ends in (cliques.products.first, cliques.products.second)
    )
    chords = (first * second.conj())[len(branches) :]
    z[cliques.fill] = np.concatenate([chords.real, chords.imag])
    np.testing.assert_allclose(cliques.products.values(z), first * second.conj(), atol=1e-9)
    g, h = cliques.rows
    assert len(h) > 1
    assert (g @ z - h).max() < 1e-9


@pytest.mark.parametrize("name", MESHES)
def test_the_bound_of_a_mesh_meets_its_plan(name: str) -> None:
    """Taps, shifts and parallel branches are in the products as the plan has them."""
    found = solved(feeder(*MESHES[name]), "minlp", gap=1e-7)
    assert found.answer.relaxed == []
    assert found.objective - found.bound < 1e-6 * found.objective


def test_a_line_that_is_out_is_in_no_clique() -> None:
    """Its product says nothing; in the other slot the ring is whole."""
    lines = [{"name": "3-4", "breakpoint": True}]
    branches = [*SQUARE, Pi(2, 4, 0.01, 0.01)]
    case = feeder(branches, FOUR, slots=2, line_tables=lines, outages=["3-4@01:00-02:00"])
    whole, broken = ([1, 2, 4], [2, 3, 4]), [1, 2, 4]
    program = horizon(case, "distflow")
    ((squares, _, _),) = cliques_of(program).groups
    columns = program.standard.columns("bus.v_sq")
    expected = [columns[np.array(buses) - 1, 0] for buses in whole]
    expected.append(columns[np.array(broken) - 1, 1])
    assert sorted(squares.tolist()) == sorted(e.tolist() for e in expected)
    found = solved(case, "minlp", gap=1e-7)
    assert found.objective - found.bound < 1e-6 * found.objective


def test_trees_have_none() -> None:
    program = horizon(feeder(RING[:2], LOADS), "distflow")
    assert Cliques.of_program(program.standard, program.vectors) is None


def test_a_mesh_of_kilowatts_is_the_same_mesh() -> None:
    """Angles are told from voltages, which have no unit of power: of a farm, too."""
    known = truth(RING, LOADS, {})
    branches = [Pi(b.i, b.j, 1e3 * b.r, 1e3 * b.x, b=1e-3 * b.b) for b in RING]
    small = {bus: 1e-3 * load for bus, load in LOADS.items()}
    grid = GRID | {"import_max_mw": 0.01, "q_max_mvar": 0.01}
    plan = rs.solve(feeder(branches, small, grid=[grid]), method="minlp")
    assert plan.relaxed == []
    np.testing.assert_allclose(plan.tables["voltage"].values[:, 0], np.abs(known.volts), atol=1e-6)
