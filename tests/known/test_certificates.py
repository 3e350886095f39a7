"""Answers that once were called what they are not; the right values stand beside each case.

Each was computed apart from this package: by a program of its own with polygons of 400 sides, by
enumeration, or by hand.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from resilience.case import Case, load_case
from resilience.errors import CertificateError
from resilience.models.backends.base import Solution
from resilience.models.case_program import horizon
from resilience.models.methods import METHODS, MethodOptions, MethodResult
from resilience.models.methods.answer import broken_facts
from resilience.models.methods.tidy import with_least_circulation
from tests.known.solving import solved

FOLDER = Path(__file__).parent / "certificates"


def case(name: str) -> Case:
    return load_case(FOLDER / f"{name}.toml")


@pytest.mark.parametrize("method", ["lp", "milp"])
@pytest.mark.parametrize(("name", "optimum"), [("r0", 9.299057), ("r22", -28.66296)])
def test_the_tie_break_leaves_modes_as_they_were_proven(
    method: str, name: str, optimum: float
) -> None:
    """Prices of zero let modes and weights of a cost curve move, were they not held."""
    found = solved(case(name), method, gap=1e-3)
    assert found.answer.status == "optimal"
    assert found.answer.relaxed == []
    assert found.objective == pytest.approx(optimum, rel=2e-6)
    spent = found.problem.standard.cost_terms(found.z, found.problem.data)
    assert sum(float(s.sum()) for s in spent.values()) == pytest.approx(optimum, rel=2e-6)


@pytest.mark.parametrize("method", ["lp", "milp"])
def test_a_binding_rating_does_not_keep_the_gap_open(method: str) -> None:
    """The plan is sought on the discs themselves; within the 12-gon it costs 31.727."""
    found = solved(case("r74"), method, gap=1e-3)
    assert found.answer.status == "optimal"
    assert found.answer.relaxed == []
    assert found.objective == pytest.approx(31.266, rel=3e-5)
    assert found.bound <= found.objective * (1 + 1e-6)


def test_a_local_optimum_is_not_called_optimal() -> None:
    """Ipopt ends at -10 where the optimum is -11.17 (by hand) and the relaxation says -29."""
    found = solved(case("full_storage"), "nlp", gap=1e-3)
    assert found.answer.status == "feasible"
    assert "local optimum" in found.answer.notes[-1]
    assert solved(case("full_storage"), "minlp", gap=1e-3).objective == pytest.approx(-11.17284)
    assert solved(case("full_storage"), "socp", gap=1e-3).answer.relaxed


@pytest.mark.parametrize("method", ["minlp", "exact"])
def test_a_feeder_of_a_kilowatt_has_the_optimum_of_one_in_megawatts(method: str) -> None:
    if method == "exact":
        pytest.importorskip("pyscipopt", reason="SCIP is an extra")
    found = solved(case("kw_exact"), method, gap=1e-5)
    assert found.answer.relaxed == []
    assert found.objective == pytest.approx(0.17127, rel=2e-5)
    assert found.bound <= found.objective * (1 + 1e-6)


def test_a_bound_above_the_objective_is_an_error_and_a_hair_is_kept() -> None:
    problem = horizon(case("r74"), "lindistflow")
    answer = METHODS["lp"][0](problem, MethodOptions(60.0, 1e-3))
    point = Solution("optimal", answer.z, answer.objective, answer.bound)

    def judged(bound: float) -> MethodResult:
        return MethodResult.from_solution(problem, point, bound, 1e-3, "too far off")

    assert judged(answer.objective + 1e-9).bound == answer.objective + 1e-9
    assert judged(answer.objective * 0.9).notes == ["too far off"]
    assert judged(answer.objective * 0.9).status == "feasible"
    assert judged(-np.inf).status == "feasible"
    with pytest.raises(
        CertificateError, match=r"a bound of 36\.26.* is proven, but an answer costs"
    ):
        judged(answer.objective + 5.0)


def test_the_tie_break_gives_way_where_it_would_hold_less() -> None:
    """Reactive power that two inverters could share is tidied within their ratings, or not."""
    problem = horizon(case("r74"), "lindistflow")
    standard, vectors = problem.standard, problem.vectors
    answer = METHODS["lp"][0](problem, MethodOptions(60.0, 1e-3))
    before = Solution("optimal", answer.z, answer.objective, answer.bound)
    after = with_least_circulation(problem, before, 30.0).point
    assert broken_facts(standard, after) == []
    assert vectors.cost @ after == pytest.approx(vectors.cost @ answer.z, abs=1e-9)
    weights = standard.tiebreak
    assert weights @ np.abs(after) <= weights @ np.abs(answer.z) + 1e-9
    assert with_least_circulation(problem, before, 0.0) is before
