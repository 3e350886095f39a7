"""A few hours ahead as they may come, and the cuts behind them.

The cuts know neither since when a line is down, nor that it has failed today already, nor what
the forecast says of the next hours. A fan of sampled outage paths knows all three: its first slot
is common to all paths, and behind each path stands the future cost of the mode in which it ends.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Bools, Floats, Ints
from resilience.dispatch.distinct_paths import distinct_paths
from resilience.dispatch.merged_grid import merged_grid
from resilience.dispatch.sddp.book import Book, CutSet
from resilience.dispatch.window_program import WindowProgram, WindowRequest, WindowSteps
from resilience.fragility.beliefs.bell_belief import BellBelief
from resilience.fragility.beliefs.history import LineHistory
from resilience.models.backends.highs import Highs
from resilience.simulation.observation import Forecast

LOOKAHEAD_STEPS = WindowSteps(slots=4, blocks=3, block_slots=4)


@dataclass(frozen=True)
class LookaheadRequest:
    """What is known of one scenario.

    Attributes:
        t: slot of the horizon.
        history: what is known of the lines that can fail.
        up: (lines of the case,) line status now.
        energy: (merged units,) MWh.
        levels: (levels,) of the day.
        forecast: of profiles, (len(slots),) each.
    """

    t: int
    history: LineHistory
    up: Bools
    energy: Floats
    levels: Floats
    forecast: Forecast


@dataclass(frozen=True)
class Futures:
    """Different paths of line status.

    Attributes:
        up: (lines of the case, steps, paths).
        probability: (paths,); 0 for one that only fills up the number.
        down_at_end: (lines that can fail, paths) which are down in the last slot.
    """

    up: Bools
    probability: Floats
    down_at_end: Bools


class Lookahead:
    """The fan of a book's case.

    Args:
        book: cut sets.
        paths: sampled futures; those that are alike become one.
        steps: of every path; a path that would pass midnight ends there, slot by slot.
        seed: of the sampled futures; they have nothing to do with the storms that come.
    """

    def __init__(
        self, book: Book, paths: int, steps: WindowSteps = LOOKAHEAD_STEPS, seed: int = 0
    ) -> None:
        self.book, self.paths, self.steps = book, paths, steps
        self.merged = merged_grid(book.fleet.microgrid.case)
        case = book.case
        self.lines = [case.network.line(name) for name in book.lines]
        self._programs: dict[tuple[int, int, int], WindowProgram] = {}
        self._ends: dict[tuple[int, int, int], Ints] = {}
        self.belief = BellBelief(book.bell, book.per_day, len(self.lines), seed)

    def decide(self, request: LookaheadRequest, cuts: CutSet) -> Floats:
        """(merged units,) charging power now, MW; negative is discharging."""
        remaining = cuts.multistage.slots - request.history.t
        fits = remaining >= self.steps.horizon
        steps = self.steps if fits else WindowSteps(remaining, 0, self.steps.block_slots)
        paths = self._sampled(request, steps)
        key = (steps.slots, steps.blocks, len(paths.probability))
        program = self._program(key, steps)
        vectors = program.vectors(
            WindowRequest(
                request.t,
                request.energy,
                paths.up,
                paths.probability,
                request.forecast,
                np.zeros(self.book.fleet.n),
            )
        )
        standard, counted = program.standard, paths.probability > 0.0
        vectors.cost[standard.future] = paths.probability
        vectors.lower[standard.future] = np.where(counted, -np.inf, 0.0)
        vectors.upper[standard.future] = np.where(counted, np.inf, 0.0)
        rows = self._rows(key, request, cuts, paths, request.history.t + steps.horizon - 1)
        solver = Highs(program.solver.lowered, rows=rows, duals=False, threads=1)
        # Solved once and from scratch: half the time that presolve needs.
        solver.tune({"presolve": "off"})
        solver.update(vectors)
        z = solver.solve().point
        charge, discharge = (
            standard.columns(f"ess.{way}")[:, 0] for way in ("charge", "discharge")
        )
        return z[charge] - z[discharge]

    def _sampled(self, request: LookaheadRequest, steps: WindowSteps) -> Futures:
        """Different paths, as many as a program is kept for: the last may stand there twice."""
        after, up = steps.horizon - 1, np.repeat(request.up[:, None, None], steps.n, axis=1)
        down = request.history.is_down
        if not after or not self.lines:
            return Futures(up, np.ones(1), down[:, None])
        later = self.belief.paths(request.history, after, self.paths)
        blocks = np.logical_or.reduceat(later, steps.starts[1:] - 1, axis=1)
        facts = np.concatenate([blocks.reshape(-1, self.paths), later[:, -1]])
        distinct = distinct_paths(facts)
        up = np.repeat(up, len(distinct.index), axis=2)
        up[self.lines, 1:] = ~blocks[:, :, distinct.index]
        return Futures(up, distinct.probability, later[:, -1, distinct.index])

    def _program(self, key: tuple[int, int, int], steps: WindowSteps) -> WindowProgram:
        if key not in self._programs:
            program = WindowProgram(self.merged, steps, key[2])
            standard = program.standard
            states = [standard.state_columns(int(leaf)) for leaf in standard.tree.leaves]
            self._programs[key] = program
            self._ends[key] = np.column_stack([np.array(states), standard.future])
        return self._programs[key]

    def _rows(
        self,
        key: tuple[int, int, int],
        request: LookaheadRequest,
        cut_set: CutSet,
        paths: Futures,
        last: int,
    ) -> tuple[sp.csr_array, Floats]:
        """Rows beta @ state - future <= -alpha of every path that counts, at slot `last`."""
        standard, ends = self._programs[key].standard, self._ends[key]
        values, columns, sides = [], [], []
        for path in np.flatnonzero(paths.probability > 0.0):
            cuts = cut_set.cuts(last, paths.down_at_end[:, path])
            values.append(np.column_stack([cuts.beta, -np.ones(cuts.n)]))
            columns.append(np.repeat(ends[[path]], cuts.n, axis=0))
            sides.append(-cuts.constants(request.levels))
        value, column = np.concatenate(values), np.concatenate(columns)
        starts = np.arange(len(value) + 1) * value.shape[1]
        shape = (len(value), standard.n_columns)
        rows = sp.csr_array((value.ravel(), column.ravel(), starts), shape=shape)
        return rows, np.concatenate(sides)
