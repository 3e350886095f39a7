"""What the gate lets pass, and what it refuses by name."""

import math

import numpy as np
import pytest

from resilience.errors import CertificateError
from resilience.models.program.gate import (
    check_audit,
    check_costs,
    cost_scale,
    gap,
    rounding,
    status_of,
)
from resilience.models.program.referee import Audit
from resilience.models.program.standard import Vectors
from resilience.tolerances import BOUND_TOLERANCE


def _vectors(cost: list[float], lower: list[float], upper: list[float]) -> Vectors:
    nothing = np.empty(0)
    return Vectors(np.array(cost), 7.0, np.array(lower), np.array(upper), nothing, nothing)


def test_the_scale_is_the_dearest_column_at_its_farthest() -> None:
    vectors = _vectors([3.0, -40.0, 50.0], [-2.0, -0.5, 0.1], [1.5, 0.25, 0.3])
    assert cost_scale(vectors) == pytest.approx(20.0)  # 40 $ * 0.5


def test_a_column_without_an_end_counts_as_one_that_reaches_one() -> None:
    assert cost_scale(_vectors([3.0, 2.0], [0.1, 0.2], [math.inf, 0.7])) == pytest.approx(3.0)


def test_a_gap_is_relative_to_the_objective() -> None:
    assert gap(-8.0, -10.0, 5.0) == pytest.approx(0.25)


def test_a_gap_is_relative_to_rounding_where_nothing_is_spent() -> None:
    assert gap(2e-6, 0.0, 4.0) == pytest.approx(0.5)
    assert gap(0.0, 0.0, 0.0) == 0.0


@pytest.mark.parametrize(
    ("objective", "bound"), [(math.inf, 3.0), (5.0, -math.inf), (math.inf, math.inf)]
)
def test_without_an_answer_or_a_bound_the_gap_is_infinite(objective: float, bound: float) -> None:
    assert gap(objective, bound, 2.0) == math.inf


@pytest.mark.parametrize(
    ("objective", "bound"), [(math.nan, 3.0), (5.0, math.nan), (5.0, math.inf), (-math.inf, 3.0)]
)
def test_what_is_no_number_proves_nothing(objective: float, bound: float) -> None:
    with pytest.raises(CertificateError):
        gap(objective, bound, 2.0)


@pytest.mark.parametrize("unit", [1e-6, 1e-3, 1e3, 1e6])
def test_a_bound_above_the_objective_is_refused_in_every_currency(unit: float) -> None:
    objective, scale = 4.0 * unit, 30.0 * unit
    room = rounding(objective, scale)
    assert gap(objective, objective + 0.9 * room, scale) == 0.0
    with pytest.raises(CertificateError, match="fault of the program or of the solver"):
        gap(objective, objective + 1.1 * room, scale)


@pytest.mark.parametrize(
    ("objective", "largest"), [(-70.0, 70.0), (70.0, 70.0), (-3.0, 11.0), (3.0, 11.0)]
)
def test_rounding_is_of_the_objective_spent_or_earned_or_of_the_dearest_column(
    objective: float, largest: float
) -> None:
    room = BOUND_TOLERANCE * largest
    assert rounding(objective, 11.0) == pytest.approx(room)
    assert rounding(np.array([5.0, objective]), 11.0)[1] == pytest.approx(room)
    assert gap(objective, objective + 0.9 * room, 11.0) == 0.0
    with pytest.raises(CertificateError):
        gap(objective, objective + 1.1 * room, 11.0)


@pytest.mark.parametrize(
    ("reached", "status"),
    [(-0.0, "optimal"), (0.02, "optimal"), (0.021, "feasible"), (math.inf, "feasible")],
)
def test_optimal_is_what_is_within_the_gap_wanted(reached: float, status: str) -> None:
    assert status_of(reached, 0.02) == status


def test_a_gap_that_is_no_number_proves_nothing() -> None:
    assert status_of(math.nan, 0.02) == "feasible"


def test_terms_have_to_add_up() -> None:
    terms = {"grid.import": 9.5, "credit": -2.25}
    check_costs(7.25, terms, 3.0)
    with pytest.raises(CertificateError, match=r"add up to 7\.25 .*grid\.import 9\.5"):
        check_costs(7.26, terms, 3.0)
    with pytest.raises(CertificateError):
        check_costs(math.nan, terms, 3.0)
    with pytest.raises(CertificateError):
        check_costs(7.25, {"grid.import": math.nan}, 3.0)


def test_the_worst_row_is_named_unless_it_is_relaxed() -> None:
    audit = Audit(
        {"balance.p": 3e-5, "line.flow": 0.2, "bounds": 9e-6},
        {"balance.p": "balance.p[2, 01:00]", "line.flow": "line.flow[1-2, 03:00]", "bounds": "x"},
    )
    with pytest.raises(CertificateError, match=r"line\.flow\[1-2, 03:00\] by 0\.2"):
        check_audit(audit, [])
    with pytest.raises(CertificateError, match=r"balance\.p\[2, 01:00\]"):
        check_audit(audit, ["line.flow"])
    check_audit(audit, ["line.flow", "balance.p"])


def test_no_number_is_a_violation() -> None:
    with pytest.raises(CertificateError):
        check_audit(Audit({"balance.p": math.nan}, {"balance.p": "balance.p[2, 01:00]"}), [])
