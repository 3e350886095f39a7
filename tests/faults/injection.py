"""Solvers that go wrong on purpose, beneath the common wrapper of all backends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from resilience.arrays import Floats
from resilience.models.backends import base
from resilience.models.backends.base import Solution
from resilience.models.backends.casadi import NLP
from resilience.models.backends.conic import Conic
from resilience.models.backends.highs import Highs
from resilience.models.backends.plain import Plain
from resilience.models.backends.pyomo import Pyomo

EXCESS = 1000.0  # $ by which a faulty bound is too high


def zeros(solution: Solution, cost: Floats) -> Solution:
    """All columns at zero, at no cost, and the status of the true answer."""
    if solution.z is None:
        return solution
    return replace(solution, z=np.zeros_like(solution.z), objective=0.0)


def shifted(solution: Solution, cost: Floats) -> Solution:
    """All that costs nothing is 0.1 more: an answer that is wrong in its rows alone."""
    if solution.z is None:
        return solution
    return replace(solution, z=solution.z + 0.1 * (cost[: len(solution.z)] == 0.0))


def no_numbers(solution: Solution, cost: Floats) -> Solution:
    """NaN in place of values and cost."""
    if solution.z is None:
        return solution
    return replace(solution, z=np.full_like(solution.z, np.nan), objective=np.nan)


def high_bound(solution: Solution, cost: Floats) -> Solution:
    """A bound that is 1000 $ too high, also where none was proven."""
    if solution.status == "infeasible":
        return solution
    bound = solution.bound if np.isfinite(solution.bound) else solution.objective
    return replace(solution, bound=bound + EXCESS)


def raising(solution: Solution, cost: Floats) -> Solution:
    """An exception of a foreign library."""
    raise RuntimeError("the factorisation went out of bounds")


FAULTS: dict[str, Callable[[Solution, Floats], Solution]] = {
    "zeros": zeros,
    "shifted": shifted,
    "no numbers": no_numbers,
    "high bound": high_bound,
    "raising": raising,
}
WHEN: dict[str, Callable[[int], bool]] = {
    "first": lambda k: k == 1,
    "second": lambda k: k == 2,
    "every": lambda k: True,
}
BACKENDS: dict[str, type] = {"HiGHS": Highs, "Clarabel": Conic, "Ipopt": NLP, "SCIP": Pyomo}


@dataclass
class Counter:
    """How often a solver was called and went wrong.

    Attributes:
        calls: of `solve`.
        faults: calls that were made to go wrong.
    """

    calls: int = 0
    faults: int = 0


def inject(monkeypatch: pytest.MonkeyPatch, solver: str, fault: str, when: str) -> Counter:
    """Makes a backend's solver go wrong; returns what counts it."""
    backend, counter = BACKENDS[solver], Counter()
    true: Any = backend.solve.__wrapped__  # type: ignore[attr-defined]

    def faulty(self: Any) -> Solution:
        solution = true(self)
        counter.calls += 1
        if not WHEN[when](counter.calls):
            return solution
        counter.faults += 1
        sent = getattr(self, "_sent", None) or self.vectors
        return FAULTS[fault](solution, sent.cost)

    monkeypatch.setattr(backend, "solve", base.of_solver(solver)(faulty))
    return counter


def inject_master(monkeypatch: pytest.MonkeyPatch, fault: str, when: str) -> Counter:
    """The same for the masters of decomposition, whose bounds come from their multipliers."""
    counter, true, true_bound = Counter(), Plain._solved, Plain.bound

    def faulty(self: Any) -> Any:
        answer = true(self)
        counter.calls += 1
        if answer is None or not WHEN[when](counter.calls):
            return answer
        counter.faults += 1
        values, multipliers = answer
        if fault == "raising":
            raise RuntimeError("the factorisation went out of bounds")
        if fault == "zeros":
            return np.zeros_like(values), multipliers
        if fault == "shifted":
            return values + 0.1 * (self.vectors.cost == 0.0), multipliers
        return (np.full_like(values, np.nan), multipliers) if fault == "no numbers" else answer

    def faulty_bound(self: Any, *args: Any) -> float:
        return true_bound(self, *args) + EXCESS * (fault == "high bound")

    monkeypatch.setattr(Plain, "_solved", faulty)
    monkeypatch.setattr(Plain, "bound", faulty_bound)
    return counter
