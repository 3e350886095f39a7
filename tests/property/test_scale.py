"""A case in kW, in GW, or in another currency is the same case: every method answers it alike.

What is scaled: all powers and energies by one factor, impedances by its inverse, so that voltages
in pu are the same; all prices by another.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import Phase, given, settings

from resilience.case import Case
from resilience.models.case_program import horizon
from resilience.models.methods import METHODS, MethodOptions, MethodResult
from resilience.models.program.gate import cost_scale
from resilience.testing import small_case
from tests.property.random_cases import PRICES, documents, quick

EXTENSIVE = ("_mw", "_mwh", "_mva", "_mvar", "_mw_per_h")
SPENT = ("no_load_cost_per_h", "start_cost")
"""Costs of a device, not of its energy: they grow with its size."""
GAP = 1e-5
SAME = 2e-5  # of the most that anything costs: Clarabel, Ipopt and SCIP stop at 1e-8 to 1e-6
FEW = settings(quick, max_examples=5, phases=[Phase.explicit, Phase.generate])


def scaled(document: dict[str, Any], power: float, price: float) -> Case:
    """The case of a document with every power and every price multiplied."""

    def table(row: dict[str, Any]) -> dict[str, Any]:
        factor = {key: power for key in row if key.endswith(EXTENSIVE)}
        factor |= {key: price for key in row if key in PRICES}
        factor |= {key: price * power for key in row if key in SPENT}
        return {key: value * factor[key] if key in factor else value for key, value in row.items()}

    changed: dict[str, Any] = {
        key: [table(row) for row in value] if key in ("load", "pv", "ess", "generator", "grid")
        else value for key, value in document.items()
    }  # fmt: skip
    changed["lines"] = [(i, j, r / power, x / power) for i, j, r, x in document["lines"]]
    changed["terminal_value_per_mwh"] = document["terminal_value_per_mwh"] * price
    return small_case(**changed)


def answered(case: Case, method: str) -> tuple[MethodResult, float]:
    """The answer, and the most that anything costs in its program, $."""
    solve, physics = METHODS[method]
    program = horizon(case, physics)
    return solve(program, MethodOptions(60.0, GAP)), cost_scale(program.vectors)


@pytest.mark.parametrize("method", METHODS)
@given(document=documents())
@FEW
def test_a_method_answers_a_scaled_case_alike(method: str, document: dict[str, Any]) -> None:
    if method == "exact":
        pytest.importorskip("pyscipopt", reason="SCIP is an extra")
    plain, most = answered(scaled(document, 1.0, 1.0), method)
    for power, price in [(1e-3, 1.0), (20.0, 1.0), (1.0, 1e-6), (1.0, 4e4), (1e-4, 1e-5)]:
        other, other_most = answered(scaled(document, power, price), method)
        assert other_most == pytest.approx(most * power * price, rel=1e-9)
        assert other.status == plain.status, (power, price)
        assert len(other.relaxed) == len(plain.relaxed), (power, price, other.relaxed)
        mine, others = (
            np.array([x.objective, x.bound]) / scale
            for x, scale in ((plain, most), (other, other_most))
        )
        np.testing.assert_allclose(others, mine, atol=SAME, err_msg=f"{power:g}, {price:g}")
