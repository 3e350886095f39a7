r"""The first stage of a decomposed program: the trunk, and what its scenarios cost behind it.

Columns are those of the trunk, then $\theta_s$ per branch, held up by the cuts, and with a `Risk`
what was spent up to every node of the trunk, $\eta$, and the excess $u_s$ of every scenario. A
scenario that never leaves the trunk costs what the trunk costs, and comes last.

What is built is whole where it comes in units; a tree search holds that, and its bound takes the
place of that from multipliers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats, Ints
from resilience.errors import InfeasibleError
from resilience.models.backends.highs_scale import Scale
from resilience.models.backends.lower import lower
from resilience.models.backends.plain import Plain
from resilience.models.program.risk import node_prices
from resilience.models.program.standard import Vectors, reach
from resilience.models.program.units import MONEY, Units, dimensions
from resilience.models.structures import Discs
from resilience.planning.two_stage.recourse import SecondStage
from resilience.planning.two_stage.two_stage import TwoStage
from resilience.tolerances import INTEGRALITY_TOLERANCE

CUT_TOLERANCE = 1e-9  # of what a branch costs: below, a cut says nothing new


@dataclass(frozen=True)
class Trial:
    """A point of the first stage.

    Attributes:
        z: (columns,) values of the trunk's columns.
        states: (branches, states) with which every branch begins.
        spent: (scenarios,) $ spent on the trunk; that of the one that stays is its whole cost.
        bound: what the master proves, $; -inf where it had no cuts.
        theta: (branches,) $ that the cuts say of each branch.
        is_whole: whether what is built in units is.
    """

    z: Floats
    states: Floats
    spent: Floats
    bound: float
    theta: Floats
    is_whole: bool = True


class Master:
    """The first stage.

    Args:
        two_stage: the program.
        idle: columns of the trunk to hold at zero (modes to keep to).
        discs: polygons within the discs or around them.
        seconds: says how many are left for one solve.
    """

    def __init__(
        self,
        two_stage: TwoStage,
        *,
        idle: Ints | None = None,
        discs: Discs = "outer",
        seconds: Callable[[], float] = lambda: np.inf,
    ) -> None:
        self.seconds = seconds
        self.two_stage, first, trunk = two_stage, two_stage.first, two_stage.trunk
        branches = two_stage.branches
        self.probability = np.append([b.probability for b in branches], two_stage.staying)
        self.trunk_nodes = np.array([b.trunk_node for b in branches], np.intp)
        ends = np.array([first.state_columns(node) for node in range(trunk)], np.intp)
        # The last row is the start, so that a branch of the trunk node -1 begins there.
        ends = np.vstack([ends.reshape(trunk, -1), np.arange(first.n_states)])
        self.ends = ends
        self.links = ends[self.trunk_nodes].reshape(len(branches), first.n_states)
        prices, self._offset = node_prices(first, two_stage.first_data)
        self._future = int(first.future[0])
        prices = prices.tolil()
        prices[:, [self._future]] = 0.0
        self._prices = sp.csr_array(prices)
        lowered = lower(first, integer="none", modes={}, discs=discs)
        v = first.vectors(two_stage.first_data, two_stage.x0)
        if idle is not None:
            v = v.fixed(idle, np.zeros(len(idle)))
        self._n, n_branches = lowered.a.shape[1], len(branches)
        self._theta = self._n + np.arange(n_branches)
        self._after = self._n + n_branches
        a, numbers = self._arrays(lowered.a, lowered.vectors(v))
        self.program = Plain(a, numbers, self._scale(a, v))
        self._theta_box = (np.full(n_branches, -np.inf), np.full(n_branches, -np.inf))
        self._floor = np.full(n_branches, -np.inf)
        built, *_, in_units = first.form.design_numbers
        self.built, self.units = built, built[in_units]
        self._lowered, self._first_rows = lowered, np.arange(lowered.a.shape[0])

    @property
    def has_floors(self) -> bool:
        """Whether `hold_up` has been called."""
        return bool(np.isfinite(self._floor).all())

    def hold_up(self, floors: Floats) -> None:
        """Takes what each branch (branches,) costs at least, whatever is decided, $."""
        self._floor, self._theta_box = floors, (floors.copy(), floors.copy())
        self.program.set_bounds(self._theta, floors, np.full(len(floors), np.inf))

    def change_data(self, data: dict[str, Floats]) -> None:
        """Takes other data of the trunk; all cuts hold as before, as they are of the branches."""
        v = self._lowered.vectors(self.two_stage.first.vectors(data, self.two_stage.x0))
        self.program.set_sides(self._first_rows, v.row_lower, v.row_upper)

    def _scale(self, a: sp.csr_array, v: Vectors) -> Scale | None:
        """Its own units: those of the trunk, and of money for all that `_arrays` adds."""
        first = self.two_stage.first
        units = Units.of_program(first, v)
        if units == Units():
            return None
        dimension = np.zeros(a.shape[1], np.intp)
        dimension[self._n :] = MONEY
        dimension[: first.n_columns] = dimensions(first)
        return Scale.of_matrix(a, units.sizes(dimension), units.cost)

    def _arrays(self, a: sp.csr_array, v: Vectors) -> tuple[sp.csr_array, Vectors]:
        """The trunk's rows and numbers with those of theta and of risk behind them."""
        risk, trunk = self.two_stage.risk, self.two_stage.trunk
        n_branches = len(self.two_stage.branches)
        mean = (1.0 - risk.weight) * np.append(self.two_stage.share, self.two_stage.staying)
        cost = np.zeros(self._n)
        cost[: self._prices.shape[1]] = mean[:trunk] @ self._prices
        cost[self._future] = mean[trunk]
        extra = trunk + 1 + n_branches + 1 if risk.averse else 0
        rows = [sp.hstack([a, sp.csr_array((a.shape[0], n_branches + extra))])]
        low, high = [v.row_lower], [v.row_upper]
        costs = [cost, (1.0 - risk.weight) * self.probability[:n_branches]]
        lower_, upper = [v.lower, np.zeros(n_branches)], [v.upper, np.zeros(n_branches)]
        if risk.averse:
            blocks, sides = self._risk_rows()
            rows += blocks
            low += sides[0]
            high += sides[1]
            tail = risk.weight * self.probability / (1.0 - risk.alpha)
            costs += [np.zeros(trunk), np.array([risk.weight]), tail]
            lower_ += [np.full(trunk + 1, -np.inf), np.zeros(n_branches + 1)]
            upper += [np.full(trunk + 1 + n_branches + 1, np.inf)]
        offset = float(mean[:trunk] @ self._offset)
        cost, *bounds_and_sides = map(np.concatenate, (costs, lower_, upper, low, high))
        vectors = Vectors(cost, offset, *bounds_and_sides)
        return sp.csr_array(sp.vstack(rows, format="csr")), vectors

    def _risk_rows(self) -> tuple[list[sp.csr_array], tuple[list[Floats], list[Floats]]]:
        """spent_t = spent_(t-1) + prices z + offset;  spent + theta - eta - u <= 0."""
        trunk, n_branches = self.two_stage.trunk, len(self.two_stage.branches)
        width = self._after + trunk + 1 + n_branches + 1
        step = sp.eye_array(trunk) - sp.eye_array(trunk, k=-1)
        gap = sp.csr_array((trunk, self._after - self._prices.shape[1]))
        tail = sp.csr_array((trunk, 1 + n_branches + 1))
        spending = sp.hstack([-self._prices, gap, step, tail])
        late = np.flatnonzero(self.trunk_nodes >= 0)  # those that begin behind some node
        scenario, eta = np.arange(n_branches + 1), self._after + trunk
        entries = [
            (scenario[:-1], self._theta, 1.0),
            (scenario[-1:], np.array([self._future]), 1.0),
            (late, self._after + self.trunk_nodes[late], 1.0),
            (scenario[-1:], np.array([eta - 1]), 1.0),
            (scenario, np.full(n_branches + 1, eta), -1.0),
            (scenario, eta + 1 + scenario, -1.0),
        ]
        row = np.concatenate([r for r, _, _ in entries])
        column = np.concatenate([c for _, c, _ in entries])
        value = np.concatenate([np.full(len(r), x) for r, _, x in entries])
        excess = sp.csr_array((value, (row, column)), shape=(n_branches + 1, width))
        none, zero = np.full(n_branches + 1, -np.inf), np.zeros(n_branches + 1)
        if not self.two_stage.staying:
            zero[-1] = np.inf
        return [spending, excess], ([self._offset, none], [self._offset, zero])

    def trunk_through(self, states: Floats) -> Trial | None:
        """The cheapest trunk that passes through states (trunk nodes, states); None: there is none.

        Only of use before the first cuts.

        Raises:
            OutOfTimeError: too few seconds are left.
        """
        columns = self.ends[: self.two_stage.trunk].ravel()
        v = self.program.vectors
        low, high = v.lower[columns].copy(), v.upper[columns].copy()
        inside = np.clip(states.ravel(), low, high)
        self.program.set_bounds(columns, inside, inside)
        try:
            solution = self.program.solve(self.seconds())
        finally:
            self.program.set_bounds(columns, low, high)
        return None if solution is None else self._trial(solution[0], -np.inf)

    def trial_of(self, z: Floats) -> Trial:
        """A point (columns,) of the trunk as a trial of which no cut says anything yet."""
        wide = np.zeros(len(self.program.vectors.cost))
        wide[: len(z)], wide[self._theta] = z, self._floor
        return self._trial(wide, -np.inf)

    def solve_whole(self, start: Floats | None, gap: float) -> Trial:
        """The best trunk by the cuts so far, what is built in units whole.

        Args:
            start: (columns,) a trunk to begin from.
            gap: relative, at which the search stops.

        Raises:
            InfeasibleError: the trunk has no point.
            OutOfTimeError: too few seconds are left.
        """
        begin = None if start is None else start[self.units]
        solution = self.program.search_tree(self.units, begin, gap, self.seconds())
        if solution is None:
            raise InfeasibleError(
                "nothing can be built within the limits",
                hint="raise the budget",
            )
        return self._trial(*solution)

    def solve(self) -> Trial:
        """The best trunk by the cuts so far.

        Raises:
            InfeasibleError: the trunk has no point.
            OutOfTimeError: too few seconds are left.
        """
        solution = self.program.solve(self.seconds())
        if solution is None:
            raise InfeasibleError(
                "nothing satisfies the model in the slots common to all scenarios",
                hint="`--method lp` with the outages common to all names what conflicts",
            )
        z, multipliers = solution
        has_cuts = np.isfinite(self._theta_box[1]).all()
        return self._trial(z, self._bound(multipliers) if has_cuts else -np.inf)

    def add(self, second: SecondStage, branches: Ints | None = None) -> None:
        """Adds the cuts of all branches, or of some."""
        chosen = np.arange(len(self._theta)) if branches is None else branches
        count = len(chosen)
        if not count:
            return
        v, n = self.program.vectors, len(self.program.vectors.cost)
        links, alpha, beta = self.links[chosen], second.alpha[chosen], second.beta[chosen]
        columns = np.hstack([links, self._theta[chosen, None]])
        values = np.hstack([beta, -np.ones((count, 1))])
        starts = np.arange(count + 1) * (links.shape[1] + 1)
        block = sp.csr_array((values.ravel(), columns.ravel(), starts), shape=(count, n))
        self.program.add_rows(block, np.full(count, -np.inf), -alpha)
        low, high = reach(beta, v.lower[links], v.upper[links])
        lower, upper = self._theta_box
        lower[chosen] = np.maximum(lower[chosen], alpha + low)
        upper[chosen] = np.maximum(upper[chosen], alpha + high)
        self.program.set_bounds(self._theta, self._floor, np.full(len(self._theta), np.inf))

    def add_falling(self, trial: Trial, second: SecondStage, branches: Ints) -> None:
        r"""Adds sharper cuts of some branches at whole designs of zeros and ones.

        Of a branch whose cost falls with what is built, nobody who builds less saves anything; and
        whoever builds any of the rest saves no more than what it costs above its floor:

        $$ \theta_s \ge Q_s(\hat x) - \sum_{j: \hat x_j = 0}
           \min\{-\beta_j, Q_s(\hat x) - \underline{\theta}_s\}\, x_j $$
        """
        falls = self.two_stage.falls
        if falls is None or not len(chosen := branches[falls[branches]]):
            return
        x, (built, lowest, highest, *_) = trial.states, self.two_stage.first.form.design_numbers
        if (lowest != 0.0).any() or (highest != 1.0).any():
            return
        value = second.alpha + (second.beta * x).sum(axis=1)
        above = np.maximum(value - self._floor, 0.0)[:, None]
        beta = np.zeros_like(second.beta)
        beta[:, built] = np.where(
            x[:, built] < 0.5, np.maximum(np.minimum(second.beta[:, built], 0.0), -above), 0.0
        )
        self.add(SecondStage(second.cost, value, beta, []), chosen)

    def violated(self, trial: Trial, second: SecondStage) -> Ints:
        """Branches that cost more at a trial than the cuts so far say."""
        room = CUT_TOLERANCE * np.maximum(np.abs(second.cost), self.two_stage.cost_scale)
        return np.flatnonzero(second.cost > trial.theta + room)

    def _trial(self, z: Floats, bound: float) -> Trial:
        first = z[: self._prices.shape[1]]
        spent = np.cumsum(self._prices @ first + self._offset)
        up_to = np.append(spent, 0.0)[self.trunk_nodes]
        stays = spent[-1] + first[self._future]
        units = z[self.units]
        is_whole = bool((np.abs(units - np.round(units)) <= INTEGRALITY_TOLERANCE).all())
        spent = np.append(up_to, stays)
        return Trial(first, z[self.links], spent, bound, z[self._theta], is_whole)

    def _bound(self, multipliers: Floats) -> float:
        """A bound over a box that holds an optimum: theta within its cuts' reach, and so on."""
        v = self.program.vectors
        low, high = v.lower.copy(), v.upper.copy()
        low[self._theta], high[self._theta] = self._theta_box
        if self.two_stage.risk.averse:
            self._risk_box(low, high)
        return self.program.bound(multipliers, low, high)

    def _risk_box(self, low: Floats, high: Floats) -> None:
        trunk, n_branches = self.two_stage.trunk, len(self.two_stage.branches)
        n = self._prices.shape[1]
        dear, cheap = self._prices.maximum(0.0), self._prices.minimum(0.0)
        cheapest = np.cumsum(dear @ low[:n] + cheap @ high[:n] + self._offset)
        dearest = np.cumsum(dear @ high[:n] + cheap @ low[:n] + self._offset)
        spent = slice(self._after, self._after + trunk)
        low[spent], high[spent] = cheapest, dearest
        # As in `ends`, the last entry is the start, where nothing has been spent.
        before = [np.append(spending, 0.0)[self.trunk_nodes] for spending in (cheapest, dearest)]
        bottom = np.append(before[0] + low[self._theta], cheapest[-1] + low[self._future])
        top = np.append(before[1] + high[self._theta], dearest[-1] + high[self._future])
        eta = self._after + trunk
        low[eta], high[eta] = bottom.min(), top.max()
        high[eta + 1 : eta + 2 + n_branches] = top.max() - bottom.min()
