"""Names survive: every row and column is called after its device and its time."""

from __future__ import annotations

import numpy as np
import pytest

from resilience.models.case_program import CaseProgram, horizon
from resilience.models.language.stage import Stage
from resilience.models.language.tree import Cut, Tree
from resilience.models.program.standard import Standard
from resilience.models.program.unroll import unroll
from resilience.testing import small_case


@pytest.fixture(scope="module")
def day() -> CaseProgram:
    unit = {"p_max_mw": 1.0, "e_mwh": 2.0}
    return horizon(
        small_case(slots=48, step_min=30.0, ess=[unit, unit], terminal_value_per_mwh=1.0),
        "copperplate",
    )


def test_rows_and_columns_name_device_and_time(day: CaseProgram) -> None:
    problem = day.standard
    assert problem.row_name(problem.rows("ess.dynamics")[1, 29]) == "ess.dynamics[ess2, 14:30]"
    assert problem.column_name(problem.columns("ess.charge")[0, 0]) == "ess.charge[ess1, 00:00]"
    assert problem.column_name(problem.initial["ess.energy"][1]) == "ess.energy[ess2, start]"
    assert problem.column_name(problem.future[0]) == "future[23:30]"
    assert problem.row_name(problem.n_rows - 1) == "cut[1, 23:30]"


def stage(dt: float) -> Stage:
    made = Stage(dt)
    now, after = made.state("energy", ["a", "b"], 0.0, 1.0, unit="MWh")
    made.var("nothing", [])
    power = made.var("power", ["a", "b"], 0.0, 1.0)
    made.eq("dynamics", after, now + power * dt)
    made.le("total", power.sum(), 1.0)
    made.var("nothing either", [])
    return made


@pytest.fixture(scope="module")
def forest() -> Standard:
    """A fan whose nodes are of two durations by turns, with two cuts behind each of two leaves."""
    tree = Tree(
        parent=np.array([-1, 0, 0, 1, 2]),
        probability=np.array([1.0, 0.5, 0.5, 0.5, 0.5]),
        stage=np.array([0, 1, 0, 0, 1]),
        labels=("now", "low 1", "high 1", "low 2", "high 2"),
    )
    cuts = [Cut(float(k), {"energy": np.array([-1.0, 0.0])}) for k in range(2)]
    return unroll([stage(0.25), stage(1.0)], tree, cuts)


def test_every_column_has_a_name_of_its_own_that_leads_back(forest: Standard) -> None:
    names = [forest.column_name(j) for j in range(forest.n_columns)]
    assert len(set(names)) == len(names)
    for name in forest.names:
        for label, columns in zip(forest.labels(name), forest.columns(name), strict=True):
            for slot, j in zip(forest.tree.labels, columns, strict=True):
                assert names[j] == f"{name}[{label}, {slot}]"
    with pytest.raises(IndexError):
        forest.column_name(forest.n_columns)


def test_every_row_has_a_name_of_its_own_that_leads_back(forest: Standard) -> None:
    names = [forest.row_name(i) for i in range(forest.n_rows)]
    assert len(set(names)) == len(names)
    assert names[-4:] == ["cut[1, low 2]", "cut[1, high 2]", "cut[2, low 2]", "cut[2, high 2]"]
    for label, rows in zip("ab", forest.rows("dynamics"), strict=True):
        assert [names[i] for i in rows] == [f"dynamics[{label}, {s}]" for s in forest.tree.labels]
    with pytest.raises(IndexError):
        forest.row_name(forest.n_rows)


def test_an_unknown_name_lists_what_there_is(forest: Standard) -> None:
    with pytest.raises(KeyError, match=r"energy.*power"):
        forest.columns("heat")
    with pytest.raises(KeyError, match=r"dynamics.*total"):
        forest.rows("heat")
    with pytest.raises(KeyError):
        forest.labels("heat")
