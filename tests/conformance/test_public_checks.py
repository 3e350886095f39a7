"""`check_backend` and `check_dispatcher`: ours pass, and each kind of mistake is caught."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

from resilience.arrays import Floats
from resilience.dispatch.comb import COMB
from resilience.dispatch.registry import DISPATCHERS
from resilience.dispatch.rules import Greedy, Rule
from resilience.models.backends.base import Solution
from resilience.models.backends.casadi import NLP
from resilience.models.backends.conic import Conic
from resilience.models.backends.highs import Highs
from resilience.models.backends.pyomo import Pyomo
from resilience.models.program.standard import Standard, Vectors
from resilience.models.structures import Angle, Cone, Disc, Split
from resilience.simulation.observation import Observation
from resilience.simulation.setting import Setting
from resilience.simulation.world import World
from resilience.testing import TINY, backends, check_backend, check_dispatcher, small_world
from tests.unit.dispatch import blackouts

CURVED = {Disc, Cone, Angle}
BACKENDS: dict[str, tuple[Callable[[Standard], Any], dict[str, Any]]] = {
    "highs": (Highs, {}),
    "pyomo-highs": (Pyomo, {"exact": Pyomo.exact - CURVED}),
    "pyomo-scip": (lambda standard: Pyomo(standard, solver="scip"), {}),
    "conic": (Conic, {"relaxed": Conic.relaxed}),
    "nlp": (NLP, {}),
}


@pytest.mark.parametrize("name", BACKENDS)
def test_our_backends_pass(name: str) -> None:
    make, options = BACKENDS[name]
    names = check_backend(make, **options)
    assert {"affine", "chain", "terminal_fan"} <= set(names)
    assert (len(names) == len(TINY)) == (name in ("pyomo-scip", "conic"))


class Dear(Highs):
    """Reports an objective that is none too good."""

    def solve(self) -> Solution:
        solution = super().solve()
        return replace(solution, objective=solution.objective + 0.01)


class Boastful(Highs):
    """Proves too much."""

    def solve(self) -> Solution:
        solution = super().solve()
        return replace(solution, bound=solution.bound + 0.01)


class Deaf(Highs):
    """Takes the first vectors only."""

    def update(self, vectors: Vectors) -> None:
        if not hasattr(self, "heard"):
            self.heard = super().update(vectors)


class Forgetful(Highs):
    """Has no use for cuts."""

    def add_cuts(self, node: int, alpha: Floats, beta: Floats) -> None:
        pass


class Mispriced(Highs):
    """Gives the price of the state with the wrong sign."""

    def solve(self) -> Solution:
        solution = super().solve()
        price = solution.state_price
        return replace(solution, state_price=None if price is None else -price)


class Hopeful(Highs):
    """Calls everything optimal."""

    def solve(self) -> Solution:
        solution = super().solve()
        return replace(solution, status="optimal")


@pytest.mark.parametrize(
    ("backend", "complaint"),
    [
        (Dear, "island: objective"),
        (Boastful, "island: bound"),
        (Deaf, "after `update`"),
        (Forgetful, "after `add_cuts`"),
        (Mispriced, "state price"),
        (Hopeful, "status optimal; allowed: infeasible"),
    ],
)
def test_a_backend_that_is_wrong_is_caught(backend: type[Highs], complaint: str) -> None:
    with pytest.raises(AssertionError, match=complaint):
        check_backend(backend)


def test_a_relaxation_that_is_called_exact_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    """By what its point violates, and by an optimum that is none."""
    with pytest.raises(AssertionError, match=r"^precharge: a row is violated by 0\.0002"):
        check_backend(Conic, exact=Conic.exact | {Split})
    monkeypatch.setattr(backends, "TINY", {name: TINY[name] for name in ("affine", "split")})
    with pytest.raises(AssertionError, match=r"^split: objective"):
        check_backend(Conic, exact=Conic.exact | {Split})


@pytest.mark.parametrize("name", DISPATCHERS)
def test_our_dispatchers_pass(name: str) -> None:
    check_dispatcher(DISPATCHERS[name], blackouts.world() if name == COMB else None)


def stolen_world() -> World:
    """The world of whoever called: what nobody is given, and a dispatcher of no shame takes."""
    frame = inspect.currentframe()
    while frame is not None and not isinstance(frame.f_locals.get("world"), World):
        frame = frame.f_back
    assert frame is not None
    return cast(World, frame.f_locals["world"])


class Prophet(Rule):
    """Fills up where the world's scenarios are about to take a line down."""

    def act(self, seen: Observation) -> Floats:
        soon = stolen_world().line_up[:, seen.t : seen.t + 2].all()
        return super().act(seen) if soon else np.full_like(seen.energy, 9.0)


class Clairvoyant(Rule):
    """Knows how the sun will be."""

    def act(self, seen: Observation) -> Floats:
        world = stolen_world()
        later = np.array([min(seen.t + 1, world.microgrid.case.slots - 1)])
        return super().act(seen) * world.profile("sun", later)


class Flat(Greedy):
    """One number for all units."""

    def act(self, seen: Observation) -> Floats:
        return super().act(seen)[:1]


class Undecided(Greedy):
    """Divides by zero."""

    def act(self, seen: Observation) -> Floats:
        return super().act(seen) * np.nan


@pytest.mark.parametrize(
    ("dispatcher", "complaint"),
    [
        (Prophet, "acts on what happens after slot 4"),
        (Clairvoyant, "acts on what happens after slot 4"),
        (Flat, r"shape \(1, 1\); allowed: \(2, 1\)"),
        (Undecided, "allowed: finite numbers"),
    ],
)
def test_a_dispatcher_that_breaks_a_rule_is_caught(
    dispatcher: Callable[[Setting], Any], complaint: str
) -> None:
    with pytest.raises(AssertionError, match=complaint):
        check_dispatcher(dispatcher)


def test_the_small_world_tells_dispatchers_apart() -> None:
    world = small_world()
    costs = [
        float(check_dispatcher(DISPATCHERS[name], world).objective(0.2)[0])
        for name in ("idle", "rule", "mpc")
    ]
    assert costs[0] > costs[1] + 1.0 > costs[2] + 2.0
