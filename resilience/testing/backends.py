"""What every backend must be able to do, whoever wrote it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from typing import Any

import numpy as np

from resilience.models.backends.base import Backend, Solution
from resilience.models.program.referee import audit, settle
from resilience.models.program.standard import Standard, Vectors
from resilience.models.structures import Structure
from resilience.testing.tiny import TINY, TinyProgram
from resilience.testing.tiny_linear import CUTS
from resilience.tolerances import RELAXATION_TOLERANCE

BackendFactory = Callable[[Standard], Backend]
SLOPE_TOLERANCE = 1e-4

CHANGED_DATA: dict[str, dict[str, float]] = {
    "data": {"cap": 1.5, "demand": 2.0, "price": 4.0},
    "fan": {"shortage": 5.0},
    "chain": {"energy": 0.25},
}
"""Tiny programs with other data, and with it another optimum."""


def check_backend(
    make_backend: BackendFactory,
    *,
    exact: Collection[type[Structure]] | None = None,
    relaxed: Collection[type[Structure]] = (),
    tolerance: float = 2e-6,
) -> tuple[str, ...]:
    """Holds a backend against every tiny program that it can take.

    Where it holds everything, it must reach the optimum with a bound that is none too high, and its
    point must pass the audit. Where it relaxes, its bound must not exceed the optimum. New data
    must give what a fresh backend gives, cuts added later must count, the price of a state must be
    the slope of the optimum, and what cannot be must be called infeasible.

    Args:
        make_backend: builds the backend for a program.
        exact: structures that it holds, where that depends on its options; `Backend.exact` if
            omitted.
        relaxed: structures that it relaxes, as it then does integers that it does not hold, so that
            it proves a bound.
        tolerance: of objectives, $.

    Returns:
        Names of the programs that it was held against.

    Raises:
        AssertionError: the first thing that is wrong, with program, value and what is allowed.
    """
    probe = make_backend(TINY["affine"]().standard)
    exact_kinds = frozenset(exact or probe.exact)
    names = []
    for name, build in TINY.items():
        tiny = build()
        holds_integers = probe.integers or not tiny.integers
        if tiny.needs <= exact_kinds and holds_integers:
            _check_optimum(tiny, make_backend, tolerance)
        elif tiny.needs <= exact_kinds | set(relaxed) and (holds_integers or relaxed):
            _check_bound(tiny, make_backend, tolerance)
        else:
            continue
        names.append(name)
    for name, data in CHANGED_DATA.items():
        _check_new_data(TINY[name](), TINY[name](**data), make_backend, tolerance)
    _check_later_cuts(make_backend, tolerance)
    _check_state_price(make_backend)
    for name, standard, vectors in impossible_programs():
        _check_infeasible(name, _solution(make_backend(standard), vectors))
    return tuple(names)


def impossible_programs() -> Iterator[tuple[str, Standard, Vectors]]:
    """Programs that no point satisfies: by their rows, and by bounds that cross."""
    tiny = TINY["chain"]()
    idle = np.concatenate([tiny.standard.columns(name)[0] for name in ("buy", "sell")])
    end = tiny.standard.columns("energy")[0, -1]
    values = np.append(np.zeros(len(idle)), 1.5)
    yield (
        "more at the end than at the start",
        tiny.standard,
        tiny.vectors.fixed(np.append(idle, end), values),
    )
    crossed = TINY["data"](cap=-1.0)
    yield "bounds that cross", crossed.standard, crossed.vectors


def _solution(backend: Backend, vectors: Vectors) -> Solution:
    backend.update(vectors)
    return backend.solve()


def _check_optimum(tiny: TinyProgram, make_backend: BackendFactory, tolerance: float) -> None:
    solution = _solution(make_backend(tiny.standard), tiny.vectors)
    assert solution.status == "optimal", f"{tiny}: status {solution.status}; allowed: optimal"
    _expect(f"{tiny}: objective", solution.objective, tiny.optimum, tolerance)
    _check_bound_of(tiny, solution, tolerance)
    z = settle(tiny.standard, solution.point, tiny.vectors)
    worst = audit(tiny.standard, z, tiny.vectors).maximum
    assert worst <= RELAXATION_TOLERANCE, f"{tiny}: a row is violated by {worst:g}"
    cost = float(tiny.vectors.cost @ z + tiny.vectors.offset)
    _expect(f"{tiny}: cost of the point", cost, tiny.optimum, tolerance)


def _check_bound(tiny: TinyProgram, make_backend: BackendFactory, tolerance: float) -> None:
    solution = _solution(make_backend(tiny.standard), tiny.vectors)
    assert solution.status not in ("infeasible", "none"), f"{tiny}: status {solution.status}"
    _check_bound_of(tiny, solution, tolerance)


def _check_bound_of(tiny: TinyProgram, solution: Solution, tolerance: float) -> None:
    assert solution.bound <= tiny.optimum + tolerance, (
        f"{tiny}: bound {solution.bound:.9g}; allowed: at most the optimum {tiny.optimum:.9g}"
    )


def _check_new_data(
    first: TinyProgram, second: TinyProgram, make_backend: BackendFactory, tolerance: float
) -> None:
    """Back and forth between two sets of data, without building anew."""
    backend = make_backend(first.standard)
    for tiny in (first, second, first):
        solution = _solution(backend, first.standard.vectors(tiny.data, tiny.x0))
        _expect(f"{tiny} after `update`: objective", solution.objective, tiny.optimum, tolerance)


def _check_later_cuts(make_backend: BackendFactory, tolerance: float) -> None:
    for name in ("terminal", "terminal_fan"):
        tiny, bare = TINY[name](), TINY[name](cuts=())
        backend = make_backend(bare.standard)
        backend.update(bare.vectors)
        alpha = np.array([cut.alpha for cut in CUTS])
        beta = np.array([cut.beta["store"] for cut in CUTS])
        for leaf in bare.standard.tree.leaves:
            backend.add_cuts(int(leaf), alpha, beta)
        for _ in range(2):
            objective = backend.solve().objective
            _expect(f"{tiny} after `add_cuts`: objective", objective, tiny.optimum, tolerance)
            backend.update(bare.vectors)


def _check_state_price(make_backend: BackendFactory) -> None:
    """The price of a state, where the backend gives one, is the slope of the optimum."""
    for name in ("chain", "fan", "terminal", "durations"):
        tiny = TINY[name]()
        ((state, levels),) = tiny.x0.items()
        start, step = levels[0] + 0.1, 0.01  # away from the kinks
        backend = make_backend(tiny.standard)
        low, middle, high = (
            _solution(backend, tiny.standard.vectors(tiny.data, {state: [x]}))
            for x in (start - step, start, start + step)
        )
        if middle.state_price is not None:
            slope = (high.objective - low.objective) / (2 * step)
            _expect(f"{tiny}: state price", middle.state_price[0], slope, SLOPE_TOLERANCE)


def _check_infeasible(name: str, solution: Solution) -> None:
    assert solution.z is None, f"{name}: a point; allowed: none"
    assert solution.status in ("infeasible", "none"), (
        f"{name}: status {solution.status}; allowed: infeasible, none"
    )


def _expect(subject: str, value: Any, allowed: float, tolerance: float) -> None:
    assert abs(value - allowed) <= tolerance, (
        f"{subject} {value:.9g}; allowed: {allowed:.9g} within {tolerance:g}"
    )
