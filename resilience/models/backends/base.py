"""What every solver is to us: something that takes vectors and gives values and a proven bound."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import wraps
from types import FrameType
from typing import Literal, Protocol, TypeVar

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.errors import ResilienceError, SolverError, UsageError
from resilience.models.program.standard import Standard, Vectors, reach
from resilience.models.structures import Structure
from resilience.tolerances import CROSSED_BOUNDS_TOLERANCE

Status = Literal["optimal", "feasible", "infeasible", "none"]


class OutOfTimeError(SolverError):
    """A solver had no time, or too little, for an answer that others wait for."""


@dataclass(frozen=True)
class Duals:
    """Multipliers in the Lagrangian  c'z + rows'(A z - b) - sum_k cones[k] . structure_k(z).

    Attributes:
        rows: (rows,) non-negative on `<=` rows.
        cones: by the index of a structure, (1 + x, n) of its `second_order` form.
    """

    rows: Floats
    cones: dict[int, Floats] = field(default_factory=dict)


@dataclass(frozen=True)
class Solution:
    """What a backend answers.

    Attributes:
        status: optimal (within tolerance), feasible (stopped early), infeasible, or none.
        z: (columns,) values, None where there are none.
        objective: $ at z, or inf.
        bound: proven lower bound in $ for the program as the backend holds it, or -inf.
        duals: its multipliers, where the backend gives them.
        state_price: (states,) $ per unit of each state at the start.
    """

    status: Status
    z: Floats | None
    objective: float
    bound: float
    duals: Duals | None = None
    state_price: Floats | None = None

    @property
    def point(self) -> Floats:
        """The values, where there are some.

        Raises:
            ValueError: there are none.
        """
        if self.z is None:
            raise ValueError("this solution has no point")
        return self.z


NOTHING = Solution("none", None, np.inf, -np.inf)
INFEASIBLE = Solution("infeasible", None, np.inf, np.inf)


class Backend(Protocol):
    """A solver that is built once and re-solved by changing vectors."""

    exact: frozenset[type[Structure]]
    """The structures that it holds exactly; what else it knows, it relaxes."""
    integers: bool
    """Whether it holds integers."""

    def update(self, vectors: Vectors) -> None:
        """Takes new bounds, right-hand sides and costs."""

    def add_cuts(self, node: int, alpha: Floats, beta: Floats) -> None:
        """future cost of leaf `node` >= alpha + beta @ state, for alpha (k,), beta (k, states).

        To be called after the first `update`; cuts outlast every later one.
        """

    def solve(self) -> Solution:
        """Solves the program with the latest vectors."""


B = TypeVar("B")
HINT = "report it with the case; another --method may do meanwhile"


@contextmanager
def failures_of(solver: str) -> Iterator[None]:
    """Whatever a solver's own library raises inside is an error that names the solver.

    Around a block, or as the decorator of what calls the library. Errors of this package pass, and
    so does what ends the program, as Ctrl-C does.

    Args:
        solver: what users know it as.

    Raises:
        SolverError: it failed.
    """
    try:
        with _interrupts_kept():
            yield
    except ResilienceError:
        raise
    except Exception as error:
        raise SolverError(f"{solver} failed: {type(error).__name__}: {error}", hint=HINT) from error


@contextmanager
def _interrupts_kept() -> Iterator[None]:
    """Ctrl-C inside ends the program, also where a library takes it for its own, as CasADi does."""
    before = signal.getsignal(signal.SIGINT)
    if not callable(before) or threading.current_thread() is not threading.main_thread():
        yield
        return
    noted = False

    def note(number: int, frame: FrameType | None) -> None:
        nonlocal noted
        noted = True
        before(number, frame)

    signal.signal(signal.SIGINT, note)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        if noted:
            raise KeyboardInterrupt


def of_solver(solver: str) -> Callable[[Callable[[B], Solution]], Callable[[B], Solution]]:
    """Decorates every backend's `solve`: an answer whose numbers are none is a `SolverError`, too.

    Args:
        solver: what users know it as.
    """

    def decorated(solve: Callable[[B], Solution]) -> Callable[[B], Solution]:
        @wraps(solve)
        def checked(backend: B) -> Solution:
            with failures_of(solver):
                solution = solve(backend)
            z, value, bound = solution.z, solution.objective, solution.bound
            sound = z is None or (np.isfinite(z).all() and np.isfinite(value))
            if np.isnan(bound) or not sound:
                raise no_numbers(solver)
            return solution

        return checked

    return decorated


def no_numbers(solver: str) -> SolverError:
    """What to raise where a solver's values are no numbers."""
    return SolverError(f"{solver} answered with values that are no numbers", hint=HINT)


def refuse_unknown(standard: Standard, subject: str, allowed: Collection[type[Structure]]) -> None:
    """Raises where a program has a structure that something does not know how to state.

    Args:
        standard: the program.
        subject: who would have to state it, as in "a linear program".
        allowed: what that can state or relax.

    Raises:
        UsageError: there is such a structure; it is named.
    """
    for unrolled in standard.structures:
        if type(unrolled.structure) not in allowed:
            raise UsageError(
                f"{subject} cannot hold the {unrolled.structure.title} {unrolled.name!r}; "
                f"allowed: {', '.join(sorted(kind.title for kind in allowed))}",
                hint="state it in the backend's table of structures, or use another backend",
            )


def leaf_rows(states: Ints, future: int, beta: Floats) -> tuple[Ints, Floats]:
    """Columns and coefficients (k, states + 1) of the rows  beta @ state - future <= -alpha."""
    columns = np.append(states, future)
    return columns, np.hstack([beta, -np.ones((len(beta), 1))])


@dataclass
class LeafCuts:
    """Cuts that came after the program was built.

    Attributes:
        standard: the program.
        cuts: per call of `add`: column of the future cost, columns of the states (states,), alpha
            (k,) and beta (k, states).
    """

    standard: Standard
    cuts: list[tuple[int, Ints, Floats, Floats]] = field(default_factory=list)

    def add(self, node: int, alpha: Floats, beta: Floats) -> tuple[Ints, Floats]:
        """Notes cuts as `Backend.add_cuts` takes them; returns their `leaf_rows`.

        Raises:
            ValueError: a node with children, or cuts that are not of the node's states.
        """
        standard, leaves = self.standard, self.standard.tree.leaves
        if node not in leaves:
            raise ValueError(f"node {node} has children; cuts belong to leaves: {leaves.tolist()}")
        future = int(standard.future[np.searchsorted(leaves, node)])
        states = standard.state_columns(node)
        alpha, beta = np.asarray(alpha, float), np.asarray(beta, float)
        if beta.shape != (len(alpha), len(states)):
            raise ValueError(
                f"slopes of shape {beta.shape}; allowed: {(len(alpha), len(states))}, a row per "
                "cut and a column per state"
            )
        self.cuts.append((future, states, alpha, beta))
        return leaf_rows(states, future, beta)

    def with_futures_open(self, vectors: Vectors) -> Vectors:
        """The vectors, every future cost with a cut free to move as far as its cuts can reach.

        Without cuts a future cost is held at zero. Its range is finite where the states' are, so
        that a bound evaluated over the box stays finite too.
        """
        if not self.cuts:
            return vectors
        lower, upper = vectors.lower.copy(), vectors.upper.copy()
        if not self.standard.cuts:
            futures = [future for future, *_ in self.cuts]
            lower[futures] = upper[futures] = -np.inf
        for future, states, alpha, beta in self.cuts:
            low, high = reach(beta, vectors.lower[states], vectors.upper[states])
            lower[future] = max(lower[future], float((alpha + low).max()))
            upper[future] = max(upper[future], float((alpha + high).max()))
        return replace(vectors, lower=lower, upper=upper)


def crossed(vectors: Vectors) -> bool:
    """Whether some lower bound lies above its upper bound by more than rounding."""
    excess = vectors.lower - vectors.upper
    return bool((excess > CROSSED_BOUNDS_TOLERANCE * (1.0 + np.abs(vectors.lower))).any())
