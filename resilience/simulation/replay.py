"""A plan done again: its decisions are fixed, its states and costs worked out anew.

Decisions are everything that a plan sets in a slot: powers, flows, losses, commitment. They pass
through the stage slot by slot, from the states that the replay itself has reached:

- a state that an equality row ties to its past (stored energy, running) follows from that row;
- a state that is a maximum (hours still to wait) is that maximum;
- a state that only a decision sets (a switched line) is as decided.

What was spent is priced with the stage's own terms at the point so reached, and every row, bound
and structure is audited there, so that a decision that does not fit the others is found.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, cast

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Bools, Floats, Ints
from resilience.case import Case
from resilience.errors import UsageError
from resilience.models.algebra import Labels
from resilience.models.case_program import CaseProgram, horizon
from resilience.models.microgrid import Physics
from resilience.models.program.form import Form
from resilience.models.program.referee import Audit, audit
from resilience.models.program.unroll import unroll
from resilience.models.structures import Largest


class Labelled(Protocol):
    """Values (labels, slots) of one quantity."""

    @property
    def labels(self) -> Labels:
        """Names of the rows."""

    @property
    def values(self) -> Floats:
        """One row per label, one column per slot."""


class Decided(Protocol):
    """What a replay needs of a plan: the case, the physics, and the table `variables`."""

    @property
    def case(self) -> Case | None:
        """The case that was planned for."""

    @property
    def physics(self) -> str:
        """The physics of the plan."""

    @property
    def tables(self) -> Mapping[str, Labelled]:
        """Its tables by name."""


@dataclass(frozen=True)
class Replayed:
    """What a plan's decisions lead to.

    Attributes:
        operating_cost: $.
        costs: $ per term.
        states: (labels, slots) by name, at the end of every slot, as `ess.energy` in MWh.
        audit: worst scaled violation per row, bound and structure at the point reached.
    """

    operating_cost: float
    costs: dict[str, float]
    states: dict[str, Floats]
    audit: Audit


def replay(plan: Decided) -> Replayed:
    """Does a plan again at its own physics (law 5 of the design).

    A plan of `solve` has its own operating cost and states again, to the solver's tolerance.

    Args:
        plan: from `solve`, or loaded.

    Raises:
        UsageError: the plan does not carry its case or its variables.
    """
    if plan.case is None or "variables" not in plan.tables:
        raise UsageError(
            "a plan is replayed from its case and its table `variables`; it lacks one of them",
            hint="solve the case again",
        )
    program = horizon(plan.case, cast(Physics, plan.physics))
    table = plan.tables["variables"]
    if table.labels != program.slot_variables:
        raise UsageError(
            "the plan's variables are not those of its case at its physics",
            hint="it was saved by another version; solve the case again",
        )
    return redo(program, table.values)


def redo(program: CaseProgram, decisions: Floats) -> Replayed:
    """Fixes the decisions (variables, slots) of a horizon and works out what follows."""
    free = unroll([program.standard.form.stage], program.standard.tree)  # no terminal value
    (stage,) = free.copies
    form, table = stage.form, stage.columns
    _, _, rhs, _ = form.numbers(free.stacked_data(program.data, stage))
    with_states = _StateUpdate(form)
    z = np.zeros(free.n_columns)
    for name, columns in free.initial.items():
        z[columns] = program.x0[name]
    for t in range(free.tree.n):
        z[table[t, form.n_now :]] = decisions[:, t]
        z[table[t]] = with_states(z[table[t]], rhs[:, t])
    terms = free.cost_terms(z, program.data)
    costs = {name: float(spent.sum()) for name, spent in terms.items()}
    states = {b.name: z[free.columns(b.name)] for _, b in form.stage.states}
    checked = audit(free, z, free.vectors(program.data, program.x0))
    return Replayed(sum(costs.values()), costs, states, checked)


class _StateUpdate:
    """The states at the end of one slot, as its rows and maxima make them of its other values.

    Attributes:
        states: (states,) columns of the form at which states at the end of the slot stand.
        tied: (n,) those of them that an equality row determines.
        rows: (n,) these rows.
        a: (n, columns) the rows' coefficients.
        pivot: (n,) coefficient of the state in its row.
        maxima: what is a maximum, as a matrix that picks its columns or their negatives, and the
            affine expressions (matrix, constant) that it is the maximum of.
    """

    def __init__(self, form: Form) -> None:
        blocks = [after for _, after in form.stage.states]
        none = np.empty(0, np.intp)
        self.states: Ints = np.concatenate([none, *(form.columns(b) for b in blocks)])
        a = form.a.tocsr()
        rows = np.array([self._row(a, form.equality, k) for k in range(len(self.states))], np.intp)
        tied = np.flatnonzero(rows >= 0)
        self.tied, self.rows = self.states[tied], rows[tied]
        self.a = a[self.rows]
        self.pivot = np.array([self.a[i, j] for i, j in enumerate(self.tied)], float)
        self.maxima = [
            (form.matrix(s.args[0]), [(form.matrix(x), x.const) for x in s.args[1:]])
            for s in form.stage.structures
            if isinstance(s, Largest)
        ]

    def _row(self, a: sp.csr_array, equality: Bools, k: int) -> int:
        """The equality row that ties state k to its past, or sets it alone; -1 if there is none."""
        rows = np.flatnonzero(equality & (a[:, [self.states[k]]].toarray().ravel() != 0.0))
        coefficients = a[rows].tocsc()
        is_alone = np.diff(coefficients[:, self.states].tocsr().indptr) == 1
        # States at the start of the slot are the first columns, in the same order.
        has_past = coefficients[:, [k]].toarray().ravel() != 0.0
        for candidates in (rows[is_alone & has_past], rows[is_alone]):
            if len(candidates) == 1:
                return int(candidates[0])
        return -1

    def __call__(self, z: Floats, rhs: Floats) -> Floats:
        """(columns,) of a slot, its states made to follow; rhs (rows,)."""
        z = z.copy()
        z[self.tied] += (rhs[self.rows] - self.a @ z) / self.pivot
        for y, expressions in self.maxima:
            largest = np.max([matrix @ z + const for matrix, const in expressions], axis=0)
            z[y.indices] = largest / y.data + 0.0  # no -0
        return z
