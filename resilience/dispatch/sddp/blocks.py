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
from resilience.models.backends.highs_scale import Scale
from resilience.models.program.standard import Vectors
from resilience.models.program.units import MONEY, Units
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
    """A model in the solver.

    Attributes:
        model: the program; rows of cuts stand behind those of the blocks.
        cut: (rows of cuts,) which cut each is.
        block: (rows of cuts,) which block's future it bounds.
    """

    model: HighsModel
    cut: Ints
    block: Ints


class Blocks:
    """Stage problems side by side.

    Args:
        numbered: programs with the numbers of some blocks each.
        owner: (blocks,) whose cuts a block's future has: its mode.
        cuts: of all owners.
        cut_owner: (cuts,) the owner of each cut.
    """

    def __init__(
        self,
        numbered: Sequence[tuple[StageProgram, Numbers]],
        owner: Ints,
        cuts: Cuts,
        cut_owner: Ints,
    ) -> None:
        self.owner, self.cuts = np.asarray(owner, np.intp), cuts
        self.cut_owner = np.asarray(cut_owner, np.intp)
        programs = [program for program, numbers in numbered for _ in numbers.price]
        self.n = len(programs)
        width = np.array([p.n for p in programs])
        height = np.array([p.a.shape[0] for p in programs])
        self._column, self._row = np.cumsum(width) - width, np.cumsum(height) - height
        self._block_of_column = np.repeat(np.arange(self.n), width)
        self._block_of_row = np.repeat(np.arange(self.n), height)
        self.a = sp.csr_array(sp.block_diag([p.a for p in programs], format="csr"))
        self._transposed = sp.csr_array(self.a.T)
        self.now = np.concatenate([p.now for p in programs])
        self.equality = np.concatenate([p.equality for p in programs])
        self.after = np.array([p.after for p in programs]) + self._column[:, None]
        self.lower, self.upper, self.rhs = (
            np.concatenate([rows for _, n in numbered for rows in getattr(n, key)])
            for key in ("lower", "upper", "rhs")
        )
        self.price = np.concatenate([n.price.ravel() for _, n in numbered])
        self.price_now = np.concatenate([n.price_now for _, n in numbered])
        self.offset = np.concatenate([n.offset for _, n in numbered])
        follows = (self.lower[:, 1:] != 0.0) | (self.upper[:, 1:] != 0.0)
        self._varying = np.flatnonzero(follows.any(axis=1))
        dimension = np.concatenate([p.dimension for p in programs])
        self._units = Units.of_columns(
            dimension, self.price, self.lower.sum(axis=1), self.upper.sum(axis=1)
        )
        self._dimension = np.append(dimension, np.full(self.n, MONEY))
        self._solver: _Solver | None = None

    def add_cuts(self, cuts: Cuts, cut_owner: Ints) -> None:
        """Takes more cuts; the basis is kept."""
        first = self.cuts.n
        self.cuts = Cuts.joined([self.cuts, cuts])
        self.cut_owner = np.append(self.cut_owner, cut_owner)
        solver = self._solver
        if solver is None:
            return
        cut, block = np.nonzero(np.asarray(cut_owner)[:, None] == self.owner)
        solver.cut, solver.block = (
            np.append(solver.cut, cut + first),
            np.append(solver.block, block),
        )
        columns = np.column_stack([self.after[block], len(self.price) + block])
        values = np.column_stack([cuts.beta[cut], -np.ones(len(cut))])
        solver.model.add_rows(columns, values, -np.inf, np.inf)

    def replace_cuts(self, cuts: Cuts, cut_owner: Ints) -> None:
        """Takes other cuts in place of its own; the basis is lost."""
        self.cuts, self.cut_owner = cuts, np.asarray(cut_owner, np.intp)
        self._solver = None

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
        # L = sum_j d_j z_j + mean of the cuts + offset - y'(rhs - now x)  with  d = price + A'y, to
        # which a column that is a state behind the step adds the mean slope of its block's cuts.
        # Its minimum over the box takes each z_j at the side that the sign of d_j asks for. Sides,
        # offset and rhs are affine in (1, levels), so the same sum gives a constant and the slopes
        # gamma at once; the slopes beta in the states x are those of price_now and y'now.
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
                # Blocks that are not chosen stand anywhere that is allowed.
                ones = np.ones(self.n, np.intp)[:, None]
                self._send(solver, np.arange(self.n), state[:1] * ones, levels[:1] * ones)
        self._send(solver, chosen, state, levels)
        if solver.model.run() is not RunStatus.OPTIMAL:
            _solve_from_scratch(solver.model)
        return solver

    def _send(self, solver: _Solver, chosen: Ints, state: Floats, levels: Floats) -> None:
        """Bounds and sides of the blocks chosen."""
        factors = np.ones((self.n, 1 + levels.shape[1]))  # of the constant and of every level
        factors[chosen, 1:] = levels
        states, is_chosen = np.zeros((self.n, state.shape[1])), np.zeros(self.n, bool)
        states[chosen], is_chosen[chosen] = state, True
        columns = self._varying[is_chosen[self._block_of_column[self._varying]]]
        rows = np.flatnonzero(is_chosen[self._block_of_row])
        cuts = np.flatnonzero(is_chosen[solver.block])
        column_factors = factors[self._block_of_column[columns]]
        lower = np.einsum("ij,ij->i", self.lower[columns], column_factors)
        upper = np.einsum("ij,ij->i", self.upper[columns], column_factors)
        block = self._block_of_row[rows]
        rhs = np.einsum("ij,ij->i", self.rhs[rows], factors[block])
        rhs -= np.einsum("ij,ij->i", self.now[rows], states[block])
        cut, cut_levels = solver.cut[cuts], factors[solver.block[cuts], 1:]
        height = self.cuts.alpha[cut] + np.einsum("ij,ij->i", self.cuts.gamma[cut], cut_levels)
        solver.model.change_bounds(columns, lower, upper)
        low = np.full(len(rows) + len(cuts), -np.inf)
        low[: len(rows)] = np.where(self.equality[rows], rhs, -np.inf)
        both = np.append(rows, cuts + len(self.rhs))
        solver.model.change_sides(both, low, np.append(rhs, -height))

    def _built(self) -> _Solver:
        """The model at zero levels, its rows free: `_send` sets what depends on the state."""
        cut, block = np.nonzero(self.cut_owner[:, None] == self.owner)
        n, row = len(cut), np.arange(len(cut))
        state_rows = np.repeat(row, self.after.shape[1])
        slopes = (self.cuts.beta[cut].ravel(), (state_rows, self.after[block].ravel()))
        beta = sp.csr_array(slopes, shape=(n, len(self.price)))
        future = sp.csr_array((-np.ones(n), (row, block)), shape=(n, self.n))
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
        scale = None
        if self._units != Units():
            scale = Scale.of_matrix(a, self._units.sizes(self._dimension), self._units.cost)
        model.load(a, vectors, scale=scale)
        return _Solver(model, cut, block)


def _solve_from_scratch(model: HighsModel) -> None:
    """Solves where a basis was too far gone to start from; the program itself decides."""
    model.forget()
    if model.run() is not RunStatus.OPTIMAL:
        raise SolverError(
            f"a slot ended as {model.status_text.lower()}",
            hint="every state within its bounds must leave a decision that is allowed",
        )
