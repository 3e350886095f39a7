"""What large programs do otherwise, done to small ones: no answer changes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

import resilience as rs
from resilience.case import Case
from resilience.models.backends.highs import Highs, rows_among
from resilience.models.backends.highs_model import BASIC
from resilience.models.backends.lower import lower
from resilience.models.backends.node_by_node import node_statuses
from resilience.models.case_program import horizon, terminal_cuts
from resilience.models.language.tree import Tree
from resilience.models.methods import conic, large, tidy
from resilience.models.microgrid import Microgrid
from resilience.models.program.unroll import unroll
from resilience.models.structures import Disc
from resilience.planning.plan import Plan
from resilience.testing import small_case


def rated_feeder(rating_mva: float = 0.72, **more: Any) -> Case:
    """Two loads of poor power factor behind a line that cannot carry them, and an inverter."""
    demand = [0.5, 0.8, 1.0, 0.9, 0.7, 0.4]
    return small_case(
        slots=6,
        buses=3,
        lines=[(1, 2, 0.01, 0.02), (2, 3, 0.02, 0.02)],
        line_tables=[{"name": "1-2", "rating_mva": rating_mva}, {"name": "2-3", "rating_mva": 0.5}],
        profiles={"demand": demand},
        load=[
            {"bus": "2", "p_max_mw": 0.5, "power_factor": 0.8, "profile": "demand",
             "shed_cost_per_mwh": 100.0},
            {"bus": "3", "p_max_mw": 0.6, "power_factor": 0.9, "profile": "demand",
             "shed_cost_per_mwh": 90.0},
        ],
        ess=[{"bus": "3", "p_max_mw": 0.3, "e_mwh": 0.8, "soc_initial": 0.4, "s_mva": 0.32,
              "efficiency_charge": 0.9}],
        generator=[{"bus": "2", "p_max_mw": 0.2, "cost_per_mwh": 30.0, "ramp_up_mw_per_h": 0.1,
                    "q_max_mvar": 0.1}],
        grid=[{"import_max_mw": 3.0, "import_cost_per_mwh": 10.0}],
        terminal_value_per_mwh=5.0,
        **more,
    )  # fmt: skip


def treat_as_large(monkeypatch: pytest.MonkeyPatch, *, is_loaded: bool = False) -> None:
    """Where it is loaded, all discs of a structure are held as soon as one is exceeded."""
    monkeypatch.setattr(large, "EXCEEDED_SHARE", 0.0 if is_loaded else 1.0)
    for module in (conic, large, tidy):
        monkeypatch.setattr(module, "LONG_COLUMNS", 0)
    monkeypatch.setattr(large, "FEW_DISCS", 0)


def solved(case: Case, method: str) -> Plan:
    plan = rs.solve(case, method)
    assert isinstance(plan, Plan)
    return plan


@pytest.mark.parametrize("rating_mva", [0.5, 0.72, 5.0])
@pytest.mark.parametrize("is_loaded", [False, True])
@pytest.mark.parametrize("method", ["lp", "milp", "socp", "nlp", "minlp"])
def test_plans_are_as_cheap_and_hold_as_much(
    method: str, is_loaded: bool, rating_mva: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = rated_feeder(rating_mva, outages=["1-2@03:00-05:00"])
    before = solved(case, method)
    treat_as_large(monkeypatch, is_loaded=is_loaded)
    after = solved(case, method)
    assert after.objective == pytest.approx(before.objective, rel=1e-3)
    assert before.bound is not None
    assert after.bound is not None
    assert max(before.bound, after.bound) <= min(before.objective, after.objective) + 1e-6
    assert after.gap == pytest.approx(before.gap, abs=1e-3)
    assert after.audit is not None
    assert max(after.audit.values()) <= 1e-6
    assert after.status == before.status


def test_polygons_are_made_where_a_point_exceeds_its_disc(monkeypatch: pytest.MonkeyPatch) -> None:
    treat_as_large(monkeypatch)
    made = []
    for rating_mva in (0.72, 5.0):
        program = horizon(rated_feeder(rating_mva))
        polygons = large.first_discs(program.standard)
        assert not any(held.any() for held in polygons.values())
        bare = lower(program.standard, integer="none", modes={}, polygons=polygons)
        assert bare.a.shape[0] == program.standard.n_rows
        solver = Highs(bare)
        solver.update(program.vectors)
        new = large.exceeded_discs(program.standard, solver.solve().point, polygons)
        made.append(sum(int(elements.sum()) for elements in new.values()))
    assert made[0] > made[1]


def forked() -> Tree:
    """Two hours that are common, then three ends."""
    return Tree(
        parent=np.array([-1, 0, 1, 2, 1, 4, 1]),
        probability=np.array([1.0, 1.0, 0.5, 0.5, 0.3, 0.3, 0.2]),
        stage=np.zeros(7, np.intp),
        labels=tuple("abcdefg"),
    )


@pytest.mark.parametrize("alone", [True, False])
def test_nodes_solved_by_themselves_are_a_basis(alone: bool) -> None:
    """Where no node has to do with another it is the best; else a good one to start from."""
    case = rated_feeder()
    if alone:
        units = [unit.model_copy(update={"ramp_up_mw_per_h": None}) for unit in case.generator]
        case = case.replace(ess=[], generator=units, terminal_value_per_mwh=0.0)
    microgrid = Microgrid.build(case, "lindistflow")
    tree = forked()
    slots = np.array([0, 1, 2, 3, 2, 3, 2])
    standard = unroll([microgrid.stage(1.0)], tree, terminal_cuts(microgrid))
    situation = microgrid.situation(
        np.ones((2, tree.n), bool), lambda name: case.profile(name)[slots]
    )
    vectors = standard.vectors(microgrid.data(situation), microgrid.start())
    results = []
    for start in (False, True):
        solver = Highs(lower(standard, integer="none", modes={}, polygons={}))
        solver.update(vectors)
        if start:
            solver.start_node_by_node()
            given = node_statuses(standard, vectors)
        results.append(solver.solve().objective)
    assert results[1] == pytest.approx(results[0], rel=1e-9)
    columns, rows = given
    assert sum(s == BASIC for s in (*columns, *rows)) == standard.n_rows
    if alone:
        assert solver.model.statuses == (columns.tolist(), rows.tolist())


def _last_alone(polygons: dict[int, np.ndarray]) -> dict[int, np.ndarray]:
    """Only the last disc of the last structure, so that rows come before and between."""
    last = max(polygons)
    none = {k: np.zeros_like(held) for k, held in polygons.items()}
    none[last][-1] = True
    return none


def test_rows_are_found_where_they_went() -> None:
    """Equal ones in their order; a row that differs in one coefficient is not there."""
    rows = np.array([[1.0, 0.0, 2.0], [0.0, 3.0, 0.0], [1.0, 0.0, 2.0], [4.0, 0.0, 0.0]])
    more = np.array([[0.0, 3.0, 0.0], [1.0, 0.0, 2.0], [9.0, 9.0, 9.0], [4.0, 0.0, 0.0], [1, 0, 2]])
    places = rows_among(sp.csr_array(rows), sp.csr_array(more))
    assert places is not None
    assert places.tolist() == [1, 0, 4, 3]
    more[4, 2] = 2.0001
    assert rows_among(sp.csr_array(rows), sp.csr_array(more)) is None
    assert rows_among(sp.csr_array(more), sp.csr_array(rows)) is None


def test_a_start_is_taken_over_where_rows_are_added_and_refused_elsewhere() -> None:
    program = horizon(rated_feeder(0.5))
    standard = program.standard
    discs = standard.structures_of(Disc)
    none, every = ({k: np.full(u.n, held) for k, u in discs.items()} for held in (False, True))
    first, more, fewer = (
        Highs(lower(standard, integer="none", modes={}, polygons=held))
        for held in (none, every, none)
    )
    for solver in (first, more, fewer):
        solver.update(program.vectors)
    first.solve()
    assert more.start_as(first)
    between = Highs(lower(standard, integer="none", modes={}, polygons=_last_alone(every)))
    between.update(program.vectors)
    between.solve()
    assert more.start_as(between)
    cold = Highs(lower(standard, integer="none", modes={}, polygons=every))
    cold.update(program.vectors)
    assert more.solve().objective == pytest.approx(cold.solve().objective, rel=1e-9)
    assert not fewer.start_as(more)
