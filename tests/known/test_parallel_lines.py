"""Lines side by side: admittances add up, and a line without impedance carries everything."""

from __future__ import annotations

import pytest

from resilience.case import Case
from resilience.models.methods import METHODS
from resilience.testing import small_case
from tests.known.solving import solved

NOTHING = (0.0, 0.0)


def coupled(*parallel: tuple[float, float], ratings: tuple[float, ...] = ()) -> Case:
    """1.2 MW behind 0.02 pu, and before that lines side by side."""
    names = ["1-2", *(f"1-2#{k}" for k in range(2, len(parallel) + 1))]
    tables = [{"name": n, "rating_mva": s} for n, s in zip(names, ratings, strict=False)]
    return small_case(
        slots=1,
        buses=3,
        lines=[*((1, 2, r, x) for r, x in parallel), (2, 3, 0.02, 0.01)],
        line_tables=tables,
        load=[{"bus": "3", "p_max_mw": 1.2, "shed_cost_per_mwh": 100.0}],
        grid=[{"import_max_mw": 5.0, "import_cost_per_mwh": 10.0}],
    )


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    "parallel", [(NOTHING, NOTHING), (NOTHING, (0.01, 0.02)), ((0.03, 0.0), NOTHING, NOTHING)]
)
def test_couplers_side_by_side_are_one(
    parallel: tuple[tuple[float, float], ...], method: str
) -> None:
    together, alone = solved(coupled(*parallel), method), solved(coupled(NOTHING), method)
    assert together.objective == pytest.approx(alone.objective, rel=1e-6)
    assert together.objective == pytest.approx(12.0, rel=0.03)
    assert together["load.shed"].max() < 1e-6


@pytest.mark.parametrize("method", ["lp", "minlp"])
def test_the_impedance_of_one_counts_for_nothing_beside_a_coupler(method: str) -> None:
    """Its rating neither: 0.4 + 0.5 MVA of couplers, whatever the third could carry."""
    case = coupled(NOTHING, (0.1, 0.2), NOTHING, ratings=(0.4, 7.0, 0.5))
    found = solved(case, method, gap=1e-5)
    assert abs(found.of("line.p", "1-2")[0]) == pytest.approx(0.9, abs=1e-3)
    assert found["load.shed"].sum() == pytest.approx(0.3, abs=0.02)


def test_with_impedances_the_first_to_reach_its_rating_counts() -> None:
    """1/3 and 2/3 of the flow at 0.02 and 0.01 pu: 0.3 MVA of the first is 0.9 of both."""
    found = solved(coupled((0.02, 0.0), (0.01, 0.0), ratings=(0.3, 5.0)), "lp", gap=1e-5)
    assert found["load.shed"].sum() == pytest.approx(0.3, abs=1e-3)
