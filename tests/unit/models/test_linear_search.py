"""A round of `lp` and `milp` by itself: solvers answer what a test says."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from resilience.models.backends.base import NOTHING, Solution
from resilience.models.case_program import CaseProgram, horizon
from resilience.models.methods import MethodOptions, linear
from resilience.models.methods.answer import broken_modes
from resilience.testing import small_case


@dataclass
class Scripted(linear.LinearSearch):
    """A search whose solvers answer from a script.

    Attributes:
        answers: one after the other.
        asked: how the solvers that were asked see discs.
    """

    answers: Iterator[Solution] = field(default_factory=lambda: iter(()))
    asked: list[str] = field(default_factory=list)

    def solver(self, vectors: Any, discs: Any = "outer") -> Any:
        return discs

    def solve(self, solver: Any, seconds: float) -> Solution:
        self.asked.append(solver)
        return next(self.answers)


def program() -> CaseProgram:
    """A store of 0.9 MW behind a converter of 0.6 MVA."""
    case = small_case(
        slots=2,
        buses=2,
        lines=[(1, 2, 0.02, 0.03)],
        load=[{"bus": "2", "p_max_mw": 0.8, "shed_cost_per_mwh": 9.0}],
        ess=[{"bus": "2", "p_max_mw": 0.9, "e_mwh": 1.9, "s_mva": 0.6}],
        grid=[{"import_max_mw": 1.7, "import_cost_per_mwh": 3.0}],
    )
    return horizon(case, "lindistflow")


def point(of: CaseProgram, charge: float, discharge: float, objective: float) -> Solution:
    z = np.zeros(of.standard.n_columns)
    for way, power in (("charge", charge), ("discharge", discharge)):
        z[of.standard.columns(f"ess.{way}")] = power
    return Solution("feasible", z, objective, 20.0)


@pytest.mark.parametrize(
    ("charge", "discharge", "costs", "objective"),
    [
        (0.8, 0.0, [20.1], 20.1),  # beyond the converter: a plan within is enough
        (0.8, 0.0, [np.inf, 20.15], 20.15),  # none with these integers: any are sought
        (0.88, 0.22, [np.inf], np.inf),  # a mode is broken, too: the next round is to hold it
        (0.4, 0.3, [np.inf], np.inf),  # only a mode is broken
    ],
)
def test_other_integers_are_sought_only_where_discs_alone_left_no_plan(
    charge: float,
    discharge: float,
    costs: list[float],
    objective: float,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(linear, "relaxation", lambda *_, **__: NOTHING)
    of, options = program(), MethodOptions(8.0, 0.01)
    plans = [NOTHING if cost == np.inf else point(of, 0.5, 0.0, cost) for cost in costs]
    spare = point(of, 0.45, 0.0, 20.05)
    search = Scripted(of, options, options.deadline(), "all", bound=20.0)
    search.answers = iter([*plans, spare])
    relaxed = point(of, charge, discharge, 20.0)
    found = linear._plan(search, relaxed, broken_modes(of.standard, relaxed.point))
    assert (found.objective, search.asked) == (objective, ["inner"] * len(costs))
