"""The whole problem in numbers: minimise cost over a tree of stages.

    min c'z + c0   s.t.  row_lower <= A z <= row_upper,  lower <= z <= upper,  structures, integers

Columns lie in the order: states at the start | one future cost per leaf | node 0 | node 1 | ...
The matrix A and the structures are fixed; `vectors` makes everything that data can change.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeVar, cast

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats, Ints
from resilience.models.algebra import Labels
from resilience.models.language.tree import Cut, Tree
from resilience.models.program.form import CostForm, Form
from resilience.models.structures import Structure, UnrolledStructure

Values = Mapping[str, Any]
S = TypeVar("S", bound=Structure)


@dataclass
class Vectors:
    """Every number that data can change."""

    cost: Floats
    offset: float
    lower: Floats
    upper: Floats
    row_lower: Floats
    row_upper: Floats

    def fixed(self, columns: Ints, values: Floats) -> Vectors:
        """The same vectors with some columns fixed."""
        lower, upper = self.lower.copy(), self.upper.copy()
        lower[columns] = upper[columns] = values
        return Vectors(self.cost, self.offset, lower, upper, self.row_lower, self.row_upper)


@dataclass
class Standard:
    """See the module's docstring; made by `resilience.models.program.unroll.unroll`."""

    forms: tuple[Form, ...]
    tree: Tree
    tables: tuple[Ints, ...]
    members: tuple[Ints, ...]
    row_tables: tuple[Ints, ...]
    a: sp.csr_array
    structures: tuple[UnrolledStructure[Structure], ...]
    cuts: tuple[Cut, ...]
    n_states: int
    integer: Any = field(repr=False)
    equality: Any = field(repr=False)

    @property
    def n_columns(self) -> int:
        """Number of columns."""
        return int(self.a.shape[1])

    @property
    def n_rows(self) -> int:
        """Number of rows, cuts included (they come last)."""
        return int(self.a.shape[0])

    @property
    def n_cut_rows(self) -> int:
        """Number of rows that are cuts: one per cut and leaf."""
        return len(self.cuts) * len(self.tree.leaves)

    @cached_property
    def future(self) -> Ints:
        """Columns of the cost to go, one per leaf of the tree."""
        return self.n_states + np.arange(len(self.tree.leaves))

    @cached_property
    def penalty(self) -> Floats:
        """Weights that close relaxed structures; not part of the objective."""
        total = np.zeros(self.n_columns)
        for form, table, nodes in zip(self.forms, self.tables, self.members, strict=True):
            np.add.at(total, table, self.tree.probability[nodes, None] * form.penalty)
        return total

    @cached_property
    def tiebreak(self) -> Floats:
        """(columns,) weights of |z| by which equally good points are told apart."""
        total = np.zeros(self.n_columns)
        for form, table in zip(self.forms, self.tables, strict=True):
            np.add.at(total, table, np.broadcast_to(form.tiebreak, table.shape))
        return total

    def columns(self, name: str) -> Ints:
        """(labels, nodes) columns of a variable.

        Raises:
            KeyError: there is none of that name.
        """
        parts = []
        for form, table in zip(self.forms, self.tables, strict=True):
            parts.append(table[:, form.position[form.block(name).slice]].T)
        return self._in_node_order(parts)

    def rows(self, name: str) -> Ints:
        """(labels, nodes) rows of a named constraint.

        Raises:
            KeyError: there is none of that name.
        """
        parts = []
        for form, table in zip(self.forms, self.row_tables, strict=True):
            k = form.row(name)
            parts.append(table[:, form.row_start[k] : form.row_start[k + 1]].T)
        return self._in_node_order(parts)

    def _in_node_order(self, parts: list[Ints]) -> Ints:
        joined = np.concatenate(parts, axis=1)
        return joined[:, np.argsort(np.concatenate(self.members), kind="stable")]

    def structures_of(self, kind: type[S]) -> dict[int, UnrolledStructure[S]]:
        """The structures of a class, by their places in `structures`."""
        numbered = enumerate(self.structures)
        return {
            k: cast(UnrolledStructure[S], s) for k, s in numbered if isinstance(s.structure, kind)
        }

    def has(self, name: str) -> bool:
        """Whether a variable of that name exists."""
        return any(b.name == name for b in self.forms[0].own)

    @property
    def names(self) -> list[str]:
        """Names of all variables."""
        return [b.name for b in self.forms[0].own]

    def labels(self, name: str) -> Labels:
        """Labels of a variable: the devices, buses or lines it has a column for."""
        return self.forms[0].block(name).labels

    def state_columns(self, node: int) -> Ints:
        """(states,) columns of all states at the end of a node, in the order of x0."""
        names = [block.name for _, block in self.forms[0].stage.states]
        parts = [self.columns(name)[:, node] for name in names]
        return np.concatenate(parts) if parts else np.empty(0, np.intp)

    @cached_property
    def initial(self) -> dict[str, Ints]:
        """Columns of the states at the start, by name."""
        found, at = {}, 0
        for _, after in self.forms[0].stage.states:
            found[after.name] = np.arange(at, at + after.n)
            at += after.n
        return found

    def data_matrix(self, data: Values, form: Form, nodes: Ints) -> Floats:
        """(n_data, nodes) the data of one stage's nodes."""
        stacked = np.empty((form.n_data, len(nodes)))
        for block in form.stage.datums:
            if block.name not in data:
                raise KeyError(f"no data {block.name!r}; the problem needs it")
            value = np.asarray(data[block.name], float)
            if value.ndim == 1:
                value = value[:, None]
            if value.shape != (block.n, self.tree.n):
                value = np.broadcast_to(value, (block.n, self.tree.n))
            stacked[block.slice] = value if len(nodes) == self.tree.n else value[:, nodes]
        if np.isnan(stacked).any():
            names = [b.name for b in form.stage.datums if np.isnan(stacked[b.slice]).any()]
            raise ValueError(f"data {', '.join(names)}: a value is no number")
        return stacked

    def vectors(self, data: Values, x0: Values) -> Vectors:
        """Cost, bounds and right-hand sides for data arrays (labels, nodes) and states (labels,).

        Raises:
            KeyError: data or a state that the problem needs is missing.
            ValueError: a datum is no number.
        """
        n = self.n_columns
        cost, lower, upper = np.zeros(n), np.zeros(n), np.zeros(n)
        rhs = np.zeros(self.n_rows)
        offset = 0.0
        for name, at in self.initial.items():
            lower[at] = upper[at] = x0[name]
        for form, table, rows, nodes in zip(
            self.forms, self.tables, self.row_tables, self.members, strict=True
        ):
            d = self.data_matrix(data, form, nodes)
            own = table[:, form.n_now :]
            changed = form.fixed[:, None] + form.moving @ d
            a, b, c = form.parts
            lower[own], upper[own], rhs[rows] = changed[:a].T, changed[a:b].T, changed[b:c].T
            weight = self.tree.probability[nodes]
            # A state's column stands in two nodes, at the end of one and the start of the next.
            cost += np.bincount(table.ravel(), (changed[c:] * weight).T.ravel(), n)
            offset += float(weight @ (form.offset + form.offset_data @ d))
        self._value_cuts(cost, lower, upper, rhs)
        row_lower = np.where(self.equality, rhs, -np.inf)
        return Vectors(cost, offset, lower, upper, row_lower, rhs)

    def _value_cuts(self, cost: Floats, lower: Floats, upper: Floats, rhs: Floats) -> None:
        at, alpha, beta, share = self._cut_terms
        cost[self.future] = share
        if not self.cuts:
            return
        low, high = reach(beta[:, None], lower[at], upper[at])
        lower[self.future] = (alpha[:, None] + low).max(0)
        upper[self.future] = (alpha[:, None] + high).max(0)
        rhs[self.n_rows - self.n_cut_rows :] = -np.repeat(alpha, len(share))

    @cached_property
    def _cut_terms(self) -> tuple[Ints, Floats, Floats, Floats]:
        """State columns (leaves, states), alpha and beta of all cuts, probability of the leaves."""
        leaves = self.tree.leaves
        beta = np.zeros((len(self.cuts), self.n_states))
        for row, cut in zip(beta, self.cuts, strict=True):
            for name, slope in cut.beta.items():
                row[self.initial[name]] = slope
        at = np.array([self.state_columns(leaf) for leaf in leaves])
        return at, np.array([cut.alpha for cut in self.cuts]), beta, self.tree.probability[leaves]

    def cost_terms(self, z: Floats, data: Values) -> dict[str, Floats]:
        """$ per node of every cost term, not weighted by probability, arrays (nodes,)."""
        found: dict[str, Floats] = {}
        for form, table, nodes in zip(self.forms, self.tables, self.members, strict=True):
            d = self.data_matrix(data, form, nodes)
            for term in form.costs:
                spent = found.setdefault(term.name, np.zeros(self.tree.n))
                spent[nodes] += _spent(term, z[table].T, d)
        return found

    def column_name(self, j: int) -> str:
        """`ess.charge[ess2, 14:30]`."""
        if j < self.n_states:
            name, at = next((n, a) for n, a in self.initial.items() if j in a)
            block = next(b for _, b in self.forms[0].stage.states if b.name == name)
            return f"{name}[{block.labels[j - at[0]]}, start]"
        if j < self.n_states + len(self.tree.leaves):
            return f"future[{self.tree.labels[self.tree.leaves[j - self.n_states]]}]"
        for form, table, nodes in zip(self.forms, self.tables, self.members, strict=True):
            own = table[:, form.n_now :]
            k = np.searchsorted(own[:, 0], j, side="right") - 1 if own.size else -1
            if k >= 0 and own[k, 0] <= j < own[k, 0] + form.n_own:
                at = j - own[k, 0]
                block = next(b for b in form.own if at in form.span(b))
                label = block.labels[at - form.span(block).start]
                return f"{block.name}[{label}, {self.tree.labels[nodes[k]]}]"
        raise IndexError(j)

    def row_name(self, i: int) -> str:
        """`ess.dynamics[ess2, 14:30]`, or `cut[1, 14:30]` for the first cut at that leaf."""
        for form, table, nodes in zip(self.forms, self.row_tables, self.members, strict=True):
            if not table.size:
                continue
            k = np.searchsorted(table[:, 0], i, side="right") - 1
            if k >= 0 and i < table[k, 0] + form.n_rows:
                at = i - table[k, 0]
                r = int(np.searchsorted(form.row_start, at, side="right") - 1)
                row = form.stage.rows[r]
                label = row.labels[at - form.row_start[r]]
                return f"{row.name}[{label}, {self.tree.labels[nodes[k]]}]"
        leaves = self.tree.leaves
        cut, leaf = divmod(i - self.n_rows + self.n_cut_rows, len(leaves))
        if 0 <= cut < len(self.cuts):
            return f"cut[{cut + 1}, {self.tree.labels[leaves[leaf]]}]"
        raise IndexError(i)


def reach(beta: Floats, lower: Floats, upper: Floats) -> tuple[Floats, Floats]:
    """Least and most of beta @ x over the box, (...,) for beta and bounds (..., n)."""
    # A bound that beta does not touch counts as zero, because it may be infinite.
    least = np.where(beta > 0.0, lower, np.where(beta < 0.0, upper, 0.0))
    most = np.where(beta > 0.0, upper, np.where(beta < 0.0, lower, 0.0))
    return (beta * least).sum(axis=-1), (beta * most).sum(axis=-1)


def _spent(term: CostForm, z: Floats, d: Floats) -> Floats:
    prices = term.columns[:, None] + term.columns_data @ d
    return (prices * z).sum(0) + term.offset + term.offset_data @ d
