"""How `Highs` ends where there is no optimum: presolve in doubt, rows that have to be missed, no
point to show; and `exact` and `lp` where their solver gives nothing.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from resilience.arrays import Floats
from resilience.case import Case
from resilience.errors import InfeasibleError, SolverError, UsageError
from resilience.models.algebra import Affine
from resilience.models.backends.base import INFEASIBLE, NOTHING, Solution
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower
from resilience.models.backends.pyomo import Pyomo
from resilience.models.case_program import horizon
from resilience.models.language.stage import Stage
from resilience.models.language.tree import Tree
from resilience.models.methods import METHODS, MethodOptions, linear
from resilience.models.methods.answer import GRACE_S, NOTHING_NEW
from resilience.models.methods.explain import conflict
from resilience.models.program.standard import Standard
from resilience.models.program.unroll import unroll
from resilience.testing import small_case


def earning(most: float) -> Standard:
    """Two columns without an upper bound earn 3 and 2 $ per unit; their difference is at least 0.7,
    their sum at most `most`.
    """
    stage = Stage(1.0)
    x, y = (stage.var(name, ["one"], 0.4, np.inf) for name in ("x", "y"))
    stage.le("apart", y + 0.7, x)
    stage.le("sum", x + y, most)
    stage.cost("earned", x, -3.0)
    stage.cost("earned too", y, -2.0)
    return unroll([stage], Tree.chain(["now"]))


def crowded(least: float, most: float) -> Standard:
    """Any two of three shares are at most 1.1 together, so all are at most 1.65, but for 0.01 that
    may be switched on; beside them `most` units may earn 3 $ each.
    """
    stage = Stage(1.0)
    earned = stage.var("earned", ["one"], 0.4, most)
    shares = stage.var("shares", ["a", "b", "c"], 0.0, 1.0)
    more = stage.binary("more", ["one"])
    pairs = np.array([[1.0, 1.0, 0.0], [0.0, 1.0, 1.0], [1.0, 0.0, 1.0]])
    stage.le("pairs", shares.mapped(pairs, ("ab", "bc", "ca")), 1.1)
    total = shares.mapped(np.ones((1, 3)), ("abc",)) + 0.01 * more
    stage.le("all", Affine.constant(least, 1), total)
    stage.cost("earned", earned, -3.0)
    return unroll([stage], Tree.chain(["now"]))


@pytest.mark.parametrize(
    ("least", "most", "status"),
    [
        (1.75, 0.9, "infeasible"),
        (1.75, np.inf, "infeasible"),
        (1.62, np.inf, "none"),
        (1.62, 0.9, "optimal"),
    ],
)
def test_what_presolve_leaves_open_is_told_without_it(
    least: float, most: float, status: str
) -> None:
    """Where something earns without end, presolve stops there, whether or not there is a point."""
    standard = crowded(least, most)
    solver = Highs(standard)
    solver.update(standard.vectors({}, {}))
    assert solver.solve().status == status
    assert solver.model.option("presolve") == "choose"


@pytest.mark.parametrize(
    ("most", "status"), [(np.inf, "none"), (1.4, "infeasible"), (2.5, "optimal")]
)
def test_a_linear_program_ends_in_one_of_three_ways(most: float, status: str) -> None:
    """An unbounded program has no answer, one that excludes itself is infeasible."""
    standard = earning(most)
    solver = Highs(standard)
    solver.update(standard.vectors({}, {}))
    solution = solver.solve()
    assert solution.status == status
    if status == "optimal":
        assert solution.objective == pytest.approx(-3.0 * 2.1 - 2.0 * 0.4)
    else:
        assert solution.z is None
        with pytest.raises(ValueError, match="has no point"):
            _ = solution.point


def test_solvers_run_beside_the_main_thread_as_well() -> None:
    """Only the main thread may say what Ctrl-C does."""
    standard, found = earning(2.5), list[float]()

    def solve() -> None:
        solver = Highs(standard)
        solver.update(standard.vectors({}, {}))
        found.append(solver.solve().objective)

    thread = threading.Thread(target=solve)
    thread.start()
    thread.join()
    assert found == pytest.approx([-7.1])


def test_without_multipliers_a_bound_is_the_solvers_own() -> None:
    """They are asked for at the start only, and know nothing of cuts that came later."""
    standard = earning(2.5)
    vectors = standard.vectors({}, {})
    silent, told = Highs(standard, duals=False), Highs(standard)
    for solver in (silent, told):
        solver.update(vectors)
        found = solver.solve()
        assert (found.duals is None) == (solver is silent)
        own = replace(found, bound=-9.5)
        assert solver.certified_bound(own) == pytest.approx(-9.5 if solver is silent else -7.1)


def glaring() -> Case:
    """A unit forms an island of 0.6 MW; of the sun 1.4 MW times 0.4, then 0.7, must be taken."""
    return small_case(
        slots=2,
        profiles={"sun": [0.4, 0.7]},
        load=[{"p_max_mw": 0.6, "shed_cost_per_mwh": 9.0}],
        pv=[{"p_max_mw": 1.4, "curtailable": False, "profile": "sun"}],
        generator=[{"p_max_mw": 0.5, "cost_per_mwh": 3.0}],
    )


def test_rows_that_have_to_be_missed_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    program = horizon(glaring(), "copperplate")
    solver = Highs(lower(program.standard))
    rows = program.standard.rows("balance.p").ravel()
    assert solver.missed(rows[:0]) == []
    solver.update(program.vectors)
    assert solver.solve().status == "infeasible"
    assert solver.missed(rows, 20.0) == ["balance.p[1, 01:00]"]
    # They are named where no small conflict was found.
    monkeypatch.setattr(Highs, "conflict", lambda *_: [])
    solver = Highs(lower(program.standard))
    solver.update(program.vectors)
    assert conflict(program, solver) == ["balance.p[1, 01:00]"]


def test_a_linear_solver_that_gives_nothing_in_time_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of cones, which a linear program does not have, nothing is said."""
    monkeypatch.setattr(Highs, "solve", lambda solver: NOTHING)
    with pytest.raises(SolverError) as error:
        METHODS["lp"][0](horizon(glaring(), "copperplate"), MethodOptions())
    assert error.value.message == "HiGHS found no plan, though the linear relaxation has one"


def test_a_search_without_anything_new_to_hold_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """A plan that costs 0.7 $ more than its relaxation, which breaks nothing; that is all."""
    program = horizon(glaring().replace(pv=()), "copperplate")
    monkeypatch.setattr(
        linear,
        "_plan",
        lambda search, relaxed, _: replace(relaxed, objective=relaxed.objective + 0.7),
    )
    found = METHODS["lp"][0](program, MethodOptions())
    assert (found.objective, found.bound) == pytest.approx((4.8 + 0.7, 4.8))
    assert (found.status, found.notes) == ("feasible", [NOTHING_NEW])


def test_pyomo_writes_what_it_knows_by_its_suffix(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"cannot export to 'plan\.txt'; allowed suffixes: \.lp"):
        Pyomo(by_unit().standard, solver="scip").write(tmp_path / "plan.txt")


def test_pyomo_sends_no_cones_to_highs() -> None:
    with pytest.raises(UsageError, match="cannot hold the cones of distflow; allowed: lindistflow"):
        Pyomo(by_unit().standard, solver="highs")


def by_unit() -> Any:
    """A unit of 0.3 MW at least beside a load of 0.9 MW, at the end of a line from the grid."""
    unit = {"bus": "2", "p_min_mw": 0.3, "p_max_mw": 0.5, "cost_per_mwh": 3.0}
    return horizon(
        small_case(
            buses=2,
            lines=[(1, 2, 0.02, 0.03)],
            load=[{"bus": "2", "p_max_mw": 0.9, "shed_cost_per_mwh": 9.0}],
            generator=[unit | {"no_load_cost_per_h": 0.2}],
            grid=[{"import_max_mw": 0.7, "import_cost_per_mwh": 2.0}],
        ),
        "distflow",
    )


def scripted(monkeypatch: pytest.MonkeyPatch, answers: Iterator[Solution]) -> list[float]:
    """Answers of SCIP, one after the other, and the seconds that it is given."""
    pytest.importorskip("pyscipopt", reason="the extra `exact` is not installed")
    given: list[float] = []

    def solve(solver: Pyomo) -> Solution:
        given.append(solver.time_limit)
        return next(answers)

    monkeypatch.setattr(Pyomo, "solve", solve)
    return given


def test_scip_may_find_its_plan_in_the_last_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """The convex program gives a bound and no point; what breaks a fact of the model is no plan."""
    program = by_unit()
    plan = METHODS["minlp"][0](program, MethodOptions(gap=1e-7))
    bound_only = Solution("none", None, np.inf, plan.objective - 0.5)
    strict = Solution("feasible", plan.z, plan.objective, plan.objective - 0.25)
    scripted(monkeypatch, iter([bound_only, strict]))
    found = METHODS["exact"][0](program, MethodOptions())
    assert (found.objective, found.bound) == (strict.objective, strict.bound)
    assert found.status == "feasible"
    broken: Floats = plan.z.copy()
    broken[program.standard.integer] = 0.5
    scripted(monkeypatch, iter([bound_only, Solution("feasible", broken, 0.0, -0.25)]))
    with pytest.raises(SolverError, match="SCIP found no plan"):
        METHODS["exact"][0](program, MethodOptions())


def test_scip_says_what_is_infeasible(monkeypatch: pytest.MonkeyPatch) -> None:
    for answers in ([INFEASIBLE], [NOTHING, INFEASIBLE]):
        scripted(monkeypatch, iter(answers))
        with pytest.raises(InfeasibleError, match="no plan satisfies the distflow model"):
            METHODS["exact"][0](by_unit(), MethodOptions())


def test_scip_is_not_asked_when_no_second_remains(monkeypatch: pytest.MonkeyPatch) -> None:
    given = scripted(monkeypatch, iter([]))
    readings = iter([17.0])
    late = 17.5 + GRACE_S + 0.1
    options = MethodOptions(0.5, clock=lambda: next(readings, late))
    with pytest.raises(SolverError, match=r"SCIP found no plan within 0\.5 s"):
        METHODS["exact"][0](by_unit(), options)
    assert given == []
