"""One slot in numbers: what the linear programs of one stage share.

The program is `unroll` of a one-node tree, its present states moved to the right-hand side, its
parallel columns (one matrix column, one price: loads at a bus that are shed at one price) merged.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats, Ints
from resilience.dispatch.sddp.model import NoiseOutcomes
from resilience.models.language.stage import Stage
from resilience.models.language.tree import Tree
from resilience.models.program.units import dimensions
from resilience.models.program.unroll import unroll


@dataclass(frozen=True)
class Numbers:
    """What data decides, for n blocks.

    The last axis of all but the prices holds the constant, then what one unit of each level adds.

    Attributes:
        lower: (n, columns, 1 + levels).
        upper: (n, columns, 1 + levels).
        rhs: (n, rows, 1 + levels).
        price: (n, columns) $ per unit.
        price_now: (n, states) $ per unit of the states at the start of the slot.
        offset: (n, 1 + levels) $ whatever the columns.
    """

    lower: Floats
    upper: Floats
    rhs: Floats
    price: Floats
    price_now: Floats
    offset: Floats


class StageProgram:
    """The matrix of a stage, and how data becomes numbers.

    Attributes:
        dimension: (columns,) what they are measured in, see `dimensions`.

    Raises:
        ValueError: the stage has integers, whose future cost is not convex.
    """

    def __init__(self, stage: Stage) -> None:
        self.standard = unroll([stage], Tree.chain(["now"]))
        if self.standard.integer.any():
            raise ValueError("a stage with integers has no cuts; relax it first")
        self.form = self.standard.form
        self.n_now, matrix = self.standard.n_states, self.standard.a.toarray()
        # Behind the present states stands the future cost of the one leaf, which `Blocks` has too.
        self._own = np.arange(self.n_now + 1, self.standard.n_columns)
        self.now = matrix[:, : self.n_now]
        after = self.standard.state_columns(0) - self._own[0]
        self.group, self._first = self._parallel(matrix[:, self._own], after)
        self.a = sp.csr_array(matrix[:, self._own[self._first]])
        self.after: Ints = self.group[after]
        self.equality = self.standard.equality
        self.n = len(self._first)
        self.dimension = dimensions(self.standard)[self._own[self._first]]

    def _parallel(self, matrix: Floats, after: Ints) -> tuple[Ints, Ints]:
        """(own columns,) group of every column, and the first column of every group."""
        form = self.form
        prices = slice(int(form.ends[-1]) + form.n_now, None)
        alone = np.zeros(matrix.shape[1])
        alone[after] = 1.0 + np.arange(len(after))
        facts = np.column_stack(
            [matrix.T, form.constants[prices], form.slopes[prices].toarray(), alone]
        )
        _, first, group = np.unique(facts, axis=0, return_index=True, return_inverse=True)
        return group.ravel().astype(np.intp), first.astype(np.intp)

    def columns(self, name: str) -> Ints:
        """(labels,) columns of a variable; several labels share one where they are merged."""
        return self.group[self.standard.columns(name)[:, 0] - self._own[0]]

    def numbers(self, outcomes: NoiseOutcomes, levels: int) -> Numbers:
        """Those of every outcome.

        Raises:
            KeyError: data that the stage needs is missing.
            ValueError: a price depends on a level.
        """
        form, shape = self.form, (len(outcomes.probability), 1 + levels)
        stacked = np.empty((form.n_data, *shape))
        for block in form.stage.datums:
            stacked[block.slice] = outcomes.data[block.name]
        moved = form.slopes @ stacked.reshape(form.n_data, shape[0] * shape[1])
        values = np.moveaxis(moved.reshape(-1, *shape), 0, 1)
        values[:, :, 0] += form.constants
        lower, upper, rhs, price = np.split(values, form.ends, axis=1)
        if price[:, :, 1:].any():
            raise ValueError("prices depend on a level; cuts would not be bounds")
        offset = np.tensordot(form.offset_data, stacked, 1)
        offset[:, 0] += form.offset
        now, later = price[:, : self.n_now, 0], price[:, self.n_now :, 0]
        return Numbers(
            self._merged(lower), self._merged(upper), rhs, later[:, self._first], now, offset
        )

    def _merged(self, values: Floats) -> Floats:
        """(n, columns, 1 + levels) sums over the columns of every group."""
        totals = np.zeros((self.n, len(values), values.shape[2]))
        np.add.at(totals, self.group, values.swapaxes(0, 1))
        return totals.swapaxes(0, 1)
