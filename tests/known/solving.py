"""Solves a case and keeps everything a test may want to ask about the plan."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from resilience.arrays import Floats
from resilience.case import Case
from resilience.models.case_program import CaseProgram, horizon
from resilience.models.methods import METHODS, MethodOptions, MethodResult, answer
from resilience.models.microgrid import Physics
from resilience.models.program.referee import audit, settle

CLOSE = 1e-6


@dataclass(frozen=True)
class Solved:
    """An answer with its problem; `solved[name]` are the values of a variable, (labels, slots)."""

    problem: CaseProgram
    answer: MethodResult
    z: Floats

    def __getitem__(self, name: str) -> Floats:
        return self.z[self.problem.standard.columns(name)]

    def of(self, name: str, label: str) -> Floats:
        """Values of one device, bus or line, (slots,)."""
        return self[name][self.problem.standard.labels(name).index(label)]

    @property
    def objective(self) -> float:
        return self.answer.objective

    @property
    def bound(self) -> float:
        return self.answer.bound

    @property
    def near_limits(self) -> dict[str, float]:
        """How near it came to auxiliary limits, by variable, as the referee says."""
        worst = audit(self.problem.standard, self.z, self.problem.vectors).worst
        word = "auxiliary "
        return {name.removeprefix(word): x for name, x in worst.items() if name.startswith(word)}

    @property
    def violation(self) -> float:
        """Worst scaled violation of anything in the model."""
        return audit(self.problem.standard, self.z, self.problem.vectors).maximum


def solved(
    case: Case,
    method: str,
    physics: Physics | None = None,
    *,
    time_limit: float = 60.0,
    gap: float = 1e-6,
    clock: Callable[[], float] = time.perf_counter,
) -> Solved:
    """The answer of a method at its own or another physics, settled.

    Whatever claims to be a plan (nothing relaxed) must satisfy the whole model, and its bound may
    not lie above its objective.
    """
    method_of, own = METHODS[method]
    problem = horizon(case, physics or own)
    answer = method_of(problem, MethodOptions(time_limit, gap, clock))
    found = Solved(problem, answer, settle(problem.standard, answer.z, problem.vectors))
    slack = CLOSE * (1.0 + abs(answer.objective))
    assert answer.bound <= answer.objective + slack
    if not answer.relaxed:
        assert found.violation < CLOSE
    return found


def power(found: Solved) -> tuple[Floats, Floats]:
    """What devices feed into every bus, MW and Mvar, (buses, slots)."""
    problem, case = found.problem, found.problem.case
    shape = len(problem.microgrid.network.bus_names), case.slots
    p, q = np.zeros(shape), np.zeros(shape)
    has = problem.standard.has

    def add(total: Floats, devices: tuple, values: Floats) -> None:
        np.add.at(total, problem.microgrid.bus_index(devices), values)

    if case.load:
        served = found["load.shed"] - problem.data["load.demand"]
        factor = np.array([t.power_factor for t in case.load])[:, None]
        add(p, case.load, served)
        add(q, case.load, served * np.tan(np.arccos(factor)))
    for devices, plus, minus in (
        (case.pv, "pv.p", None),
        (case.generator, "generator.p", None),
        (case.ess, "ess.discharge", "ess.charge"),
        (case.grid, "grid.import", "grid.export"),
    ):
        if devices:
            add(p, devices, found[plus] - (found[minus] if minus else 0.0))
    for kind in ("pv", "ess", "generator", "grid"):
        if has(f"{kind}.q"):
            labels = found.problem.standard.labels(f"{kind}.q")
            rated = tuple(t for t in getattr(case, kind) if t.name in labels)
            add(q, rated, found[f"{kind}.q"])
    return p, q


def watch_that_is_late(monkeypatch: pytest.MonkeyPatch) -> Callable[[], float]:
    """A clock by which every time limit of up to 0.25 s is over as soon as it begins.

    It stands still afterwards and the grace is long, so no machine is too slow for what a method
    may still do, and none is fast enough to do more.
    """
    monkeypatch.setattr(answer, "GRACE_S", 600.0)
    readings = itertools.chain([17.0], itertools.repeat(17.3))
    return lambda: next(readings)
