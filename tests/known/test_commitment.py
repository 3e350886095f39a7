"""Integers and nonconvex curves: against enumeration, by hand, and when time runs out."""

import itertools

import numpy as np
import pytest

from resilience.case import Case, load_case
from resilience.models.case_program import horizon
from resilience.models.methods.conic import relaxation, with_all_held
from resilience.testing import small_case
from tests.known.solving import solved, watch_that_is_late

CURVE = [[0.0, 0.0], [1.0, 1.0], [2.0, 1.2]]


def economies_of_scale() -> Case:
    """Two units whose second MW costs a fifth of the first; 1.5 MW of load beside one of them."""
    unit = {"p_max_mw": 2.0, "cost_curve": CURVE, "q_min_mvar": -1.0, "q_max_mvar": 1.0}
    return small_case(
        slots=1,
        buses=2,
        lines=[(1, 2, 1e-5, 1e-5)],
        generator=[unit, unit | {"bus": "2"}],
        load=[{"bus": "2", "p_max_mw": 1.5, "shed_cost_per_mwh": 9.0}],
    )


@pytest.mark.parametrize(
    ("method", "physics"),
    [("lp", "copperplate"), ("milp", "lindistflow"), ("minlp", "distflow"), ("exact", "distflow")],
)
def test_a_concave_cost_curve_is_not_blended(method: str, physics: str) -> None:
    """One unit gives all: 1.0 + 0.2 * 0.5. A blend of its ends would cost 0.6 * 1.5, half and half
    of the units 1.5.
    """
    if method == "exact":
        pytest.importorskip("pyscipopt", reason="the extra `exact` is not installed")
    found = solved(economies_of_scale(), method, physics)  # type: ignore[arg-type]
    assert found.objective == pytest.approx(1.1, rel=1e-4)
    assert found.bound == pytest.approx(1.1, rel=1e-4)
    assert not found.answer.relaxed
    assert sorted(found["generator.p"][:, 0]) == pytest.approx([0.0, 1.5], abs=1e-3)


def test_its_conic_relaxation_blends_and_says_so() -> None:
    found = solved(economies_of_scale(), "socp")
    assert found.objective == pytest.approx(0.9, rel=1e-3)
    assert any("in two modes at once" in text for text in found.answer.relaxed)


def pair(*, must_take: bool = False) -> Case:
    """A storm of three hours, two units with minimum power and start cost, storage and PV."""
    unit = {"p_min_mw": 0.6, "p_max_mw": 1.5, "cost_per_mwh": 0.5, "start_cost": 0.3}
    unit |= {"no_load_cost_per_h": 0.1, "q_min_mvar": -1.0, "q_max_mvar": 1.0}
    return small_case(
        slots=3,
        buses=3,
        lines=[(1, 2, 0.02, 0.02), (2, 3, 0.03, 0.02)],
        profiles={"load": [0.5, 1.0, 0.3], "sun": [0.2, 0.5, 1.0]},
        generator=[unit, unit | {"bus": "3", "cost_per_mwh": 0.6, "p_min_mw": 0.3}],
        ess=[{"bus": "2", "p_max_mw": 0.5, "e_mwh": 1.0, "soc_initial": 0.2, "s_mva": 0.6}
             | {"degradation_cost_per_mwh": 0.2, "efficiency_charge": 0.95}],
        pv=[{"bus": "3", "p_max_mw": 0.5, "profile": "sun", "curtailable": not must_take}],
        load=[{"bus": "2", "p_max_mw": 2.0, "profile": "load", "power_factor": 0.95}
              | {"shed_cost_per_mwh": 1.5}],
    )  # fmt: skip


def enumerated(case: Case) -> float:
    """Cost of the best of all on/off schedules, each with its AC plan."""
    problem = horizon(case, "distflow")
    standard = problem.standard
    on = standard.columns("generator.on")
    best = np.inf
    for schedule in itertools.product((0.0, 1.0), repeat=on.size):
        vectors = problem.vectors.fixed(on.ravel(), np.array(schedule))
        found = relaxation(problem, vectors)
        if found.z is not None and found.bound < best:
            best = min(best, with_all_held(problem, found, vectors, lambda: 5.0).objective)
    return best


@pytest.mark.parametrize("must_take", [False, True])
def test_minlp_finds_the_best_of_all_schedules(must_take: bool) -> None:
    case = pair(must_take=must_take)
    best = enumerated(case)
    found = solved(case, "minlp", gap=1e-5)
    assert np.isfinite(best)
    assert found.bound <= best * (1 + 1e-6)
    assert found.objective == pytest.approx(best, rel=1e-5)
    assert solved(case, "lp").bound <= best


def test_scip_agrees() -> None:
    pytest.importorskip("pyscipopt", reason="the extra `exact` is not installed")
    found, other = solved(pair(), "exact"), solved(pair(), "minlp", gap=1e-5)
    assert found.answer.status == "optimal"
    assert found.objective == pytest.approx(other.objective, rel=1e-5)


def test_without_enough_gap_it_stops_early_and_says_so() -> None:
    loose = solved(pair(), "minlp", gap=0.5)
    assert loose.answer.status == "optimal"
    assert loose.answer.notes == []
    tight = solved(pair(), "minlp", gap=1e-5)
    assert loose.bound <= tight.objective <= loose.objective * (1 + 1e-6)


@pytest.mark.parametrize("method", ["lp", "milp", "minlp"])
def test_no_time_at_all_still_gives_a_plan(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """No time is enough for a day of commitment but that for one plan; the answer owns up to it."""
    clock = watch_that_is_late(monkeypatch)
    found = solved(load_case("ieee33-commitment"), method, time_limit=0.25, clock=clock)
    assert found.answer.status == "feasible"
    assert "best plan found" in " ".join(found.answer.notes)
    assert found.answer.relaxed == []
    assert found.violation < 1e-6
    assert 0.9 * found.objective < found.bound < found.objective


def test_a_relaxed_commitment_is_a_bound_and_named_relaxed() -> None:
    socp, minlp = solved(pair(), "socp"), solved(pair(), "minlp", gap=1e-5)
    assert socp.bound < minlp.bound <= minlp.objective
    assert any("integers fractional" in text for text in socp.answer.relaxed)
