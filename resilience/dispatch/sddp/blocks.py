"""Many stage problems that know nothing of each other as one linear program, kept warm.

A small program costs a solver more to begin than to solve: 48 blocks in one program are solved
anew in a seventh of the time of 48 programs. Blocks are the modes and outcomes of a slot in
training, and the scenarios of a slot in dispatch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats, Ints
from resilience.dispatch.sddp.model import Cuts
from resilience.dispatch.sddp.program import Numbers, StageProgram
from resilience.errors import SolverError
from resilience.models.backends.highs_model import (
    LINEAR_OPTIONS,
    WARM_OPTIONS,
    HighsModel,
    Option,
    RunStatus,
)
from resilience.models.program.standard import Vectors
from resilience.tolerances import REDUCED_COST_TOLERANCE

OPTIONS: dict[str, Option] = {
    **LINEAR_OPTIONS,
    **WARM_OPTIONS,
    "presolve": "off",
    "solver": "simplex",
    "threads": 1,
}


@dataclass
class _Solver:
    """A model in the solver, and for every row of a cut which cut and which block it is of."""

    model: HighsModel
    cut: Ints
    block: Ints


class Blocks:
    """Stage problems side by side.

    Args:
        parts: programs with the numbers of some blocks each.
        owner: (blocks,) whose cuts a block's future has: its mode.
        cuts: of all owners.
        of: (cuts,) the owner of each cut.
    """

    def __init__(
        self, parts: Sequence[tuple[StageProgram, Numbers]], owner: Ints, cuts: Cuts, of: Ints
    ) -> None:
        self.owner, self.cuts, self.of = np.asarray(owner, np.intp), cuts, np.asarray(of, np.intp)
        each = [program for program, numbers in parts for _ in numbers.price]
        self.n = len(each)
        width = np.array([p.n for p in each])
        height = np.array([p.a.shape[0] for p in each])
        self._column, self._row = np.cumsum(width) - width, np.cumsum(height) - height
        self._block_of_column = np.repeat(np.arange(self.n), width)
        self._block_of_row = np.repeat(np.arange(self.n), height)
        self.a = sp.csr_array(sp.block_diag([p.a for p in each], format="csr"))
        self._transposed = sp.csr_array(self.a.T)
        self.now = np.concatenate([p.now for p in each])
        self.equality = np.concatenate([p.equality for p in each])
        self.after = np.array([p.after for p in each]) + self._column[:, None]
        self.lower, self.upper, self.rhs = (
            np.concatenate([rows for _, n in parts for rows in getattr(n, key)])
            for key in ("lower", "upper", "rhs")
        )
        self.price = np.concatenate([n.price.ravel() for _, n in parts])
        self.price_now = np.concatenate([n.price_now for _, n in parts])
        self.offset = np.concatenate([n.offset for _, n in parts])
        follows = (self.lower[:, 1:] != 0.0) | (self.upper[:, 1:] != 0.0)
        self._varying = np.flatnonzero(follows.any(axis=1))
        self._solver: _Solver | None = None

    def add(self, cuts: Cuts, of: Ints) -> None:
        """Takes more cuts; the basis is kept."""
        first = self.cuts.n
        self.cuts, self.of = Cuts.joined([self.cuts, cuts]), np.append(self.of, of)
        solver = self._solver
        if solver is None:
            return
        cut, block = np.nonzero(np.asarray(of)[:, None] == self.owner)
        solver.cut, solver.block = (
            np.append(solver.cut, cut + first),
            np.append(solver.block, block),
        )
        columns = np.column_stack([self.after[block], len(self.price) + block])
        values = np.column_stack([cuts.beta[cut], -np.ones(len(cut))])
        solver.model.add_rows(columns, values, -np.inf, np.inf)

    def replace(self, cuts: Cuts, of: Ints) -> None:
        """Takes other cuts in place of its own; the basis is lost."""
        self.cuts, self.of, self._solver = cuts, np.asarray(of, np.intp), None

    def decide(self, state: Floats, levels: Floats) -> list[Floats]:
        """(columns,) what every block does at (blocks, states) and (blocks, levels).

        Raises:
            SolverError: there is no optimum.
        """
        solver = self._solved(np.arange(self.n), state, levels)
        return np.split(self._point(solver), self._column[1:])

    def step(self, chosen: Ints, state: Floats, levels: Floats) -> tuple[Floats, Floats]:
        """Some blocks, at (chosen, states) and (chosen, levels): states behind, own cost in $.

        Raises:
            SolverError: there is no optimum.
        """
        z = self._point(self._solved(chosen, state, levels))
        spent: Floats = np.add.reduceat(self.price * z, self._column)[chosen]
        spent += np.einsum("ij,ij->i", self.price_now[chosen], state)
        spent += self.offset[chosen, 0] + np.einsum("ij,ij->i", self.offset[chosen, 1:], levels)
        return z[self.after[chosen]], spent

    def bounds(self, state: Floats, levels: Floats) -> Cuts:
        """A cut per block, tight at (blocks, states) and (blocks, levels), valid everywhere.

        The minimum of the Lagrangian over the box of the columns is affine in states and levels,
        whatever the multipliers are: errors of the solver cost sharpness, never validity.

        Raises:
            SolverError: there is no optimum.
        """
        solver = self._solved(np.arange(self.n), state, levels)
        return self._lagrangian(solver.model.solution.multipliers, solver)

    def _lagrangian(self, multipliers: Floats, solver: _Solver) -> Cuts:
        """The bounds of `bounds`, from multipliers (rows and rows of cuts,) of any origin."""
        y, mu = multipliers[: len(self.rhs)], np.maximum(multipliers[len(self.rhs) :], 0.0)
        y = np.where(self.equality, y, np.maximum(y, 0.0))
        future = self._mean(mu, solver)
        d = self.price + self._transposed @ y
        d[self.after] += future.beta
        side = np.where((d > 0.0)[:, None], self.lower, self.upper)
        side[np.isinf(side[:, 0]) & (np.abs(d) < REDUCED_COST_TOLERANCE)] = 0.0
        worth = np.add.reduceat(d[:, None] * side, self._column) + self.offset
        worth -= np.add.reduceat(y[:, None] * self.rhs, self._row)
        return Cuts(
            worth[:, 0] + future.alpha,
            self.price_now + np.add.reduceat(y[:, None] * self.now, self._row),
            worth[:, 1:] + future.gamma,
        )

    def _mean(self, mu: Floats, solver: _Solver) -> Cuts:
        """Per block the mean of its cuts, weighted by the multipliers of their rows."""
        weight = mu / np.bincount(solver.block, mu, self.n)[solver.block]

        def mean(values: Floats) -> Floats:
            flat = values.reshape(len(values), -1)[solver.cut] * weight[:, None]
            columns = [np.bincount(solver.block, column, self.n) for column in flat.T]
            return np.array(columns, float).reshape(-1, self.n).T

        alpha, beta, gamma = (mean(x) for x in (self.cuts.alpha, self.cuts.beta, self.cuts.gamma))
        return Cuts(alpha[:, 0], beta, gamma)

    def _point(self, solver: _Solver) -> Floats:
        return solver.model.solution.values[: len(self.price)]

    def _solved(self, chosen: Ints, state: Floats, levels: Floats) -> _Solver:
        """Sends what changes at the blocks chosen, and solves."""
        solver = self._solver
        if solver is None:
            solver = self._solver = self._built()
            if len(chosen) < self.n:
                # Blocks that nobody asks for stand anywhere that is allowed.
                rest = np.ones(self.n, np.intp)[:, None]
                self._send(solver, np.arange(self.n), state[:1] * rest, levels[:1] * rest)
        self._send(solver, chosen, state, levels)
        if solver.model.run() is not RunStatus.OPTIMAL:
            _solve_from_scratch(solver.model)
        return solver

    def _send(self, solver: _Solver, chosen: Ints, state: Floats, levels: Floats) -> None:
        """Bounds and sides of the blocks chosen."""
        one = np.ones((self.n, 1 + levels.shape[1]))
        one[chosen, 1:] = levels
        states, here = np.zeros((self.n, state.shape[1])), np.zeros(self.n, bool)
        states[chosen], here[chosen] = state, True
        columns = self._varying[here[self._block_of_column[self._varying]]]
        rows, cuts = (np.flatnonzero(here[of]) for of in (self._block_of_row, solver.block))
        at = one[self._block_of_column[columns]]
        lower = np.einsum("ij,ij->i", self.lower[columns], at)
        upper = np.einsum("ij,ij->i", self.upper[columns], at)
        of = self._block_of_row[rows]
        rhs = np.einsum("ij,ij->i", self.rhs[rows], one[of])
        rhs -= np.einsum("ij,ij->i", self.now[rows], states[of])
        cut, of = solver.cut[cuts], solver.block[cuts]
        height = self.cuts.alpha[cut] + np.einsum("ij,ij->i", self.cuts.gamma[cut], one[of, 1:])
        solver.model.change_bounds(columns, lower, upper)
        low = np.full(len(rows) + len(cuts), -np.inf)
        low[: len(rows)] = np.where(self.equality[rows], rhs, -np.inf)
        both = np.append(rows, cuts + len(self.rhs))
        solver.model.change_sides(both, low, np.append(rhs, -height))

    def _built(self) -> _Solver:
        """The model at zero levels, its rows free: `_send` sets what depends on the state."""
        cut, block = np.nonzero(self.of[:, None] == self.owner)
        n, each = len(cut), np.arange(len(cut))
        at = np.repeat(each, self.after.shape[1])
        slopes = (self.cuts.beta[cut].ravel(), (at, self.after[block].ravel()))
        beta = sp.csr_array(slopes, shape=(n, len(self.price)))
        future = sp.csr_array((-np.ones(n), (each, block)), shape=(n, self.n))
        a = sp.csr_array(sp.block_array([[self.a, None], [beta, future]], format="csr"))
        free, side = np.full(self.n, np.inf), np.full(a.shape[0], np.inf)
        vectors = Vectors(
            cost=np.append(self.price, np.ones(self.n)),
            offset=0.0,
            lower=np.append(self.lower[:, 0], -free),
            upper=np.append(self.upper[:, 0], free),
            row_lower=-side,
            row_upper=side,
        )
        model = HighsModel(OPTIONS)
        model.load(a, vectors)
        return _Solver(model, cut, block)


def _solve_from_scratch(model: HighsModel) -> None:
    """Solves where a basis was too far gone to start from; the program itself decides."""
    model.forget()
    if model.run() is not RunStatus.OPTIMAL:
        raise SolverError(
            f"a slot ended as {model.status_text.lower()}",
            hint="every state within its bounds must leave a decision that is allowed",
        )
