"""A first basis of a long horizon or a wide tree: every node by itself, the states handed on.

The program of one node is small, and its basis is nearly that of the node before. Put together they
are a basis of the whole program, since a node's rows hold columns of its own and of its parent's
end alone: the blocks stand in a triangle. Nothing is known there of what comes later, so storage
stands still; what it would do is what is left to the simplex method. On 975 buses and 96 slots that
are 7,000 pivots in place of 67,000.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats, Ints
from resilience.models.backends.highs_model import (
    AT_LOWER,
    AT_UPPER,
    BASIC,
    LINEAR_OPTIONS,
    WARM_OPTIONS,
    HighsModel,
    RunStatus,
    Statuses,
)
from resilience.models.program.form import Form
from resilience.models.program.standard import StageCopies, Standard, Vectors


class _Node:
    """The program of one node of a stage, the states at its start put in."""

    def __init__(self, copies: StageCopies) -> None:
        self.copies, form = copies, copies.form
        shape = form.n_rows, form.n_columns
        a = sp.csr_array((form.a.data, (form.a.row, form.a.col)), shape=shape)
        self._now, self._own = a[:, : form.n_now], sp.csr_array(a[:, form.n_now :])
        self._ends = _own_ends(form)
        self._model: HighsModel | None = None

    def solve(self, k: int, v: Vectors, start: Floats) -> tuple[Floats, HighsModel]:
        """The states at the end of the k-th copy, and the model that was solved for it."""
        columns, rows = self.copies.own_columns[k], self.copies.rows[k]
        settled = self._now @ start
        node = Vectors(
            v.cost[columns],
            0.0,
            v.lower[columns],
            v.upper[columns],
            v.row_lower[rows] - settled,
            v.row_upper[rows] - settled,
        )
        model = self._sent(node)
        status = model.run()
        ends = columns[self._ends]
        z = model.solution.values[self._ends] if status is RunStatus.OPTIMAL else start
        return np.clip(z, v.lower[ends], v.upper[ends]), model

    def _sent(self, node: Vectors) -> HighsModel:
        if self._model is None:
            self._model = HighsModel(LINEAR_OPTIONS)
            self._model.load(self._own, node)
            return self._model
        model = self._model
        model.set_options(WARM_OPTIONS)
        columns, rows = np.arange(len(node.cost)), np.arange(len(node.row_lower))
        model.change_bounds(columns, node.lower, node.upper)
        model.change_costs(columns, node.cost)
        model.change_sides(rows, node.row_lower, node.row_upper)
        return model


def _own_ends(form: Form) -> Ints:
    """(states,) where the states at its end stand among a form's own columns."""
    none = np.empty(0, np.intp)
    return np.concatenate([none, *(form.columns(after) for _, after in form.stage.states)]) - (
        form.n_now
    )


def node_statuses(standard: Standard, vectors: Vectors) -> tuple[Statuses, Statuses]:
    """(columns,) and (rows,) statuses of a basis of the program, integers and structures left out.

    Args:
        standard: the program; the nodes of its tree stand behind their parents.
        vectors: its numbers.
    """
    columns = np.full(standard.n_columns, AT_LOWER, object)
    rows = np.full(standard.n_rows, BASIC, object)
    state = np.empty((standard.tree.n + 1, standard.n_states))
    state[-1] = vectors.lower[: standard.n_states]
    stages = [_Node(copies) for copies in standard.copies]
    place = {int(node): (stage, k) for stage in stages for k, node in enumerate(stage.copies.nodes)}
    for node in range(standard.tree.n):
        stage, k = place[node]
        start = state[standard.tree.parent[node]]
        state[node], model = stage.solve(k, vectors, start)
        columns[stage.copies.own_columns[k]], rows[stage.copies.rows[k]] = model.statuses
    if standard.n_cut_rows:
        # What comes behind a leaf is what its first cut says.
        leaves = len(standard.tree.leaves)
        columns[standard.future] = BASIC
        first = standard.n_rows - standard.n_cut_rows
        rows[first : first + leaves] = AT_UPPER
    return columns, rows
