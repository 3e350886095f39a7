"""Commitments that outer approximation does not find at once: rounds, cuts and floor of `minlp`."""

from __future__ import annotations

import importlib
import itertools
from typing import Any

import numpy as np
import pytest

from resilience.case import Case
from resilience.models.case_program import horizon
from resilience.models.methods import MethodOptions
from resilience.models.methods.conic import relaxation, with_all_held
from resilience.testing import small_case
from tests.known.solving import solved

method = importlib.import_module("resilience.models.methods.minlp")


def far_and_near() -> Case:
    """A cheap unit behind a long line, a dear one beside the load, and a third between them."""
    unit = {"q_min_mvar": -0.9, "q_max_mvar": 1.1}
    return small_case(
        slots=2,
        buses=4,
        lines=[(1, 2, 0.06, 0.05), (2, 3, 0.09, 0.04), (3, 4, 0.03, 0.02)],
        profiles={"load": [0.7, 1.3]},
        voltage_band_pu=(0.8, 1.15),
        generator=[
            unit | {"bus": "1", "p_min_mw": 0.4, "p_max_mw": 1.9, "cost_per_mwh": 2.1}
            | {"start_cost": 0.23, "no_load_cost_per_h": 0.17},
            unit | {"bus": "3", "p_min_mw": 0.3, "p_max_mw": 1.4, "cost_per_mwh": 2.6}
            | {"start_cost": 0.19, "no_load_cost_per_h": 0.21},
            unit | {"bus": "4", "p_min_mw": 0.2, "p_max_mw": 1.2, "cost_per_mwh": 2.8}
            | {"start_cost": 0.14, "no_load_cost_per_h": 0.13},
        ],
        load=[{"bus": "4", "p_max_mw": 1.6, "profile": "load", "power_factor": 0.93}
              | {"shed_cost_per_mwh": 30.0}],
    )  # fmt: skip


def best_of_all(case: Case) -> tuple[float, int]:
    """Cost of the best schedule with its AC plan, and how many schedules have one."""
    program = horizon(case, "distflow")
    on = program.standard.columns("generator.on")
    costs = []
    for schedule in itertools.product((0.0, 1.0), repeat=on.size):
        vectors = program.vectors.fixed(on.ravel(), np.array(schedule))
        found = relaxation(program, vectors)
        if found.z is not None:
            costs.append(with_all_held(program, found, vectors, lambda: 60.0).objective)
    return min(costs), len(costs)


def test_later_rounds_find_the_best_commitment(monkeypatch: pytest.MonkeyPatch) -> None:
    case = far_and_near()
    rounds: list[int] = []
    tried: list[float] = []
    true_round, true_plan = method._round, method._plan

    def noted_round(search: Any, k: int) -> bool:
        rounds.append(k)
        return bool(true_round(search, k))

    def noted_plan(search: Any, *rest: object) -> None:
        true_plan(search, *rest)
        tried.append(search.best.objective)

    monkeypatch.setattr(method, "_round", noted_round)
    monkeypatch.setattr(method, "_plan", noted_plan)
    best, plans = best_of_all(case)
    found = solved(case, "minlp", gap=1e-6)
    assert plans > 10
    assert len(rounds) >= 2
    assert tried[0] > best * (1 + 1e-4), "the first commitment was the best: choose another case"
    assert found.answer.status == "optimal"
    assert found.objective == pytest.approx(best, rel=1e-6)
    assert found.bound <= best * (1 + 1e-7)


def test_a_commitment_that_is_cut_off_does_not_come_again() -> None:
    """Whatever columns do, the schedule that was tried breaks its row, and only that one."""
    program = horizon(far_and_near(), "distflow")
    standard = program.standard
    search = method.ConicSearch(program, MethodOptions(), MethodOptions().deadline(), bound=3.5)
    integers = np.flatnonzero(standard.integer)
    z = np.zeros(standard.n_columns)
    z[integers[1::2]] = 1.0
    search.exclude(z, 4.25)
    (row, side), n = search.rows[-1], len(integers)
    assert search.floor == 4.25
    assert (row @ z)[0] == pytest.approx(side[0] + 1.0)
    for k in range(n):
        other = z.copy()
        other[integers[k]] = 1.0 - other[integers[k]]
        assert (row @ other)[0] <= side[0]
    search.exclude(z, 3.25)  # proven less than the whole problem is: that bound holds for it too
    assert search.floor == 3.5
    search.learn(9.0)
    assert search.bound == 3.5
