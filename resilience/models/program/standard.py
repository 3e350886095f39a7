"""The whole program in numbers: minimise cost over a tree of stages.

    min c'z + c0   s.t.  row_lower <= A z <= row_upper,  lower <= z <= upper,  structures, integers

Columns lie in the order: states at the start | one future cost per leaf | node 0 | node 1 | ...
The matrix A and the structures are fixed; `vectors` makes everything that data can change.

An example: one storage unit over two slots, a chain of the nodes 0 and 1. Its stage has the state
`energy` and the variables `charge` and `discharge`, so the form's columns are 0: energy now,
1: energy at the end, 2: charge, 3: discharge. The first `n_now = 1` of them belong to the node
before, the others are the node's own. One row ties the two energies. Both nodes are copies of the
one stage, so `copies` has one entry; its `columns` say where the form's columns stand in z:

    z   0        1        2        3        4          5        6        7
        energy   future   energy   charge   discharge  energy   charge   discharge
        start    node 1   node 0   node 0   node 0     node 1   node 1   node 1

    copies[0].nodes    [0, 1]
    copies[0].columns  [[0, 2, 3, 4],    node 0: energy now is that at the start, z0
                        [2, 5, 6, 7]]    node 1: energy now is what node 0 ends with, z2
    copies[0].rows     [[0],             row 0:  z2 = z0 + z3 - z4
                        [1]]             row 1:  z5 = z2 + z6 - z7

A tree whose slots have two durations has two stages, and two entries in `copies`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeVar, cast

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Bools, Floats, Ints
from resilience.models.algebra import Labels
from resilience.models.language.tree import Cut, Tree
from resilience.models.program.form import Form
from resilience.models.structures import Structure, UnrolledStructure

Values = Mapping[str, Any]
S = TypeVar("S", bound=Structure)


@dataclass
class Vectors:
    """Every number that data can change.

    Attributes:
        cost: (columns,) $ per unit.
        offset: $ that the program costs whatever the columns.
        lower: (columns,).
        upper: (columns,).
        row_lower: (rows,) -inf where a row is no equation.
        row_upper: (rows,).
    """

    cost: Floats
    offset: float
    lower: Floats
    upper: Floats
    row_lower: Floats
    row_upper: Floats

    def fixed(self, columns: Ints, values: Floats) -> Vectors:
        """The same vectors with some columns fixed; these themselves where there are none."""
        if not len(columns):
            return self
        lower, upper = self.lower.copy(), self.upper.copy()
        lower[columns] = upper[columns] = values
        return replace(self, lower=lower, upper=upper)


@dataclass(frozen=True)
class StageCopies:
    """Where the copies of one stage stand in a program.

    Attributes:
        form: the stage in numbers.
        nodes: (copies,) nodes of the tree that are instances of it.
        columns: (copies, columns of the form) columns of the program.
        rows: (copies, rows of the form) rows of the program.
    """

    form: Form
    nodes: Ints
    columns: Ints
    rows: Ints

    @property
    def own_columns(self) -> Ints:
        """(copies, own columns) without the states at the start of each node."""
        return self.columns[:, self.form.n_now :]


@dataclass(frozen=True)
class Standard:
    """A program in standard form; made by `resilience.models.program.unroll.unroll`.

    Attributes:
        tree: the nodes.
        copies: by stage, where its copies stand; see the module's docstring.
        a: (rows, columns) coefficients, cuts last.
        structures: each over all nodes of its stage.
        cuts: lower bounds on the future cost behind every leaf.
        n_states: number of states, each label counted.
        integer: (columns,) which columns are integer.
        equality: (rows,) which rows are equations; the others are `<=`.
    """

    tree: Tree
    copies: tuple[StageCopies, ...]
    a: sp.csr_array
    structures: tuple[UnrolledStructure[Structure], ...]
    cuts: tuple[Cut, ...]
    n_states: int
    integer: Bools = field(repr=False)
    equality: Bools = field(repr=False)

    @property
    def form(self) -> Form:
        """The first stage in numbers; those of a tree differ in the length of their step alone."""
        return self.copies[0].form

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
        """(leaves,) columns of the cost to go."""
        return self.n_states + np.arange(len(self.tree.leaves))

    @cached_property
    def penalty(self) -> Floats:
        """(columns,) weights that close relaxed structures; not part of the objective."""
        total = np.zeros(self.n_columns)
        for stage in self.copies:
            weights = self.tree.probability[stage.nodes, None] * stage.form.penalty
            np.add.at(total, stage.columns, weights)
        return total

    @cached_property
    def tiebreak(self) -> Floats:
        """(columns,) weights of |z| by which equally good points are told apart."""
        total = np.zeros(self.n_columns)
        for stage in self.copies:
            weights = np.broadcast_to(stage.form.tiebreak, stage.columns.shape)
            np.add.at(total, stage.columns, weights)
        return total

    def columns(self, name: str) -> Ints:
        """(labels, nodes) columns of a variable.

        Raises:
            KeyError: there is none of that name.
        """
        return self._in_node_order(
            [s.columns[:, s.form.columns(s.form.block(name))].T for s in self.copies]
        )

    def rows(self, name: str) -> Ints:
        """(labels, nodes) rows of a named constraint.

        Raises:
            KeyError: there is none of that name.
        """
        return self._in_node_order([s.rows[:, s.form.rows(name)].T for s in self.copies])

    def _in_node_order(self, by_stage: Sequence[Ints]) -> Ints:
        nodes = np.concatenate([stage.nodes for stage in self.copies])
        return np.concatenate(by_stage, axis=1)[:, np.argsort(nodes, kind="stable")]

    def structures_of(self, kind: type[S]) -> dict[int, UnrolledStructure[S]]:
        """The structures of a class, by their places in `structures`."""
        numbered = enumerate(self.structures)
        return {
            k: cast(UnrolledStructure[S], s) for k, s in numbered if isinstance(s.structure, kind)
        }

    def has(self, name: str) -> bool:
        """Whether a variable of that name exists."""
        return any(block.name == name for block in self.form.own_blocks)

    @property
    def names(self) -> list[str]:
        """Names of all variables."""
        return [block.name for block in self.form.own_blocks]

    def labels(self, name: str) -> Labels:
        """Labels of a variable: the devices, buses or lines it has a column for."""
        return self.form.block(name).labels

    def state_columns(self, node: int) -> Ints:
        """(states,) columns of all states at the end of a node, in the order of x0."""
        columns = [self.columns(after.name)[:, node] for _, after in self.form.stage.states]
        return np.concatenate([np.empty(0, np.intp), *columns])

    @cached_property
    def initial(self) -> dict[str, Ints]:
        """By name, (labels,) columns of the states at the start."""
        columns, first = {}, 0
        for _, after in self.form.stage.states:
            columns[after.name] = np.arange(first, first + after.n)
            first += after.n
        return columns

    def stacked_data(self, data: Values, stage: StageCopies) -> Floats:
        """(data, copies) the data of one stage's nodes, from arrays (labels, nodes) by name.

        Raises:
            KeyError: data that the program needs is missing.
            ValueError: a datum is no number.
        """
        form, nodes = stage.form, stage.nodes
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
        built, lowest, highest, price, _ = self.form.design_numbers
        designs = {design.block.name for design in self.form.stage.designs}
        for name, columns in self.initial.items():
            if name not in designs:
                lower[columns] = upper[columns] = x0[name]
        lower[built], upper[built] = lowest, highest
        for stage in self.copies:
            d, columns = self.stacked_data(data, stage), stage.own_columns
            low, high, sides, prices = stage.form.numbers(d)
            lower[columns], upper[columns], rhs[stage.rows] = low.T, high.T, sides.T
            weight = self.tree.probability[stage.nodes]
            # A state's column stands in two nodes, at the end of one and the start of the next.
            cost += np.bincount(stage.columns.ravel(), (prices * weight).T.ravel(), n)
            offset += float(weight @ stage.form.offsets(d))
        cost[built] += price
        self._value_cuts(cost, lower, upper, rhs)
        row_lower = np.where(self.equality, rhs, -np.inf)
        return Vectors(cost, offset, lower, upper, row_lower, rhs)

    def _value_cuts(self, cost: Floats, lower: Floats, upper: Floats, rhs: Floats) -> None:
        states, alpha, beta, probability = self._cut_terms
        cost[self.future] = probability
        if not self.cuts:
            return
        low, high = reach(beta[:, None], lower[states], upper[states])
        lower[self.future] = (alpha[:, None] + low).max(0)
        upper[self.future] = (alpha[:, None] + high).max(0)
        rhs[self.n_rows - self.n_cut_rows :] = -np.repeat(alpha, len(probability))

    @cached_property
    def _cut_terms(self) -> tuple[Ints, Floats, Floats, Floats]:
        """State columns (leaves, states), alpha and beta of all cuts, probability of the leaves."""
        leaves = self.tree.leaves
        beta = np.zeros((len(self.cuts), self.n_states))
        for row, cut in zip(beta, self.cuts, strict=True):
            for name, slope in cut.beta.items():
                row[self.initial[name]] = slope
        states = np.array([self.state_columns(leaf) for leaf in leaves])
        alpha = np.array([cut.alpha for cut in self.cuts])
        return states, alpha, beta, self.tree.probability[leaves]

    def cost_terms(self, z: Floats, data: Values) -> dict[str, Floats]:
        """$ per node of every cost term, not weighted by probability, arrays (nodes,).

        What is built is paid for in the first node.
        """
        terms: dict[str, Floats] = {}
        for design in self.form.stage.designs:
            paid = terms.setdefault(design.block.name, np.zeros(self.tree.n))
            paid[0] = design.cost @ z[self.initial[design.block.name]]
        for stage in self.copies:
            d = self.stacked_data(data, stage)
            for term in stage.form.costs:
                spent = terms.setdefault(term.name, np.zeros(self.tree.n))
                spent[stage.nodes] += term.spent(z[stage.columns].T, d)
        return terms

    def column_name(self, j: int) -> str:
        """`ess.charge[ess2, 14:30]`."""
        if j < self.n_states:
            name, columns = next((n, c) for n, c in self.initial.items() if j in c)
            return f"{name}[{self.labels(name)[j - columns[0]]}, start]"
        if j < self.n_states + len(self.tree.leaves):
            return f"future[{self.tree.labels[self.tree.leaves[j - self.n_states]]}]"
        for stage in self.copies:
            form, columns = stage.form, stage.own_columns
            k = np.searchsorted(columns[:, 0], j, side="right") - 1 if columns.size else -1
            if k >= 0 and columns[k, 0] <= j < columns[k, 0] + form.n_own:
                place = j - columns[k, 0]
                block = next(b for b in form.own_blocks if place in form.own_columns(b))
                label = block.labels[place - form.own_columns(block).start]
                return f"{block.name}[{label}, {self.tree.labels[stage.nodes[k]]}]"
        raise IndexError(j)

    def row_name(self, i: int) -> str:
        """`ess.dynamics[ess2, 14:30]`, or `cut[1, 14:30]` for the first cut at that leaf."""
        for stage in self.copies:
            form, rows = stage.form, stage.rows
            k = np.searchsorted(rows[:, 0], i, side="right") - 1 if rows.size else -1
            if k >= 0 and i < rows[k, 0] + form.n_rows:
                place = i - rows[k, 0]
                r = int(np.searchsorted(form.row_start, place, side="right") - 1)
                row = form.stage.rows[r]
                label = row.labels[place - form.row_start[r]]
                return f"{row.name}[{label}, {self.tree.labels[stage.nodes[k]]}]"
        leaves = self.tree.leaves
        cut, leaf = divmod(i - self.n_rows + self.n_cut_rows, len(leaves))
        if 0 <= cut < len(self.cuts):
            return f"cut[{cut + 1}, {self.tree.labels[leaves[leaf]]}]"
        raise IndexError(i)


def reach(beta: Floats, lower: Floats, upper: Floats) -> tuple[Floats, Floats]:
    """Minimum and maximum of beta @ x over the box, (...,) for beta and bounds (..., n)."""
    # A bound that beta does not touch counts as zero, because it may be infinite.
    cheapest = np.where(beta > 0.0, lower, np.where(beta < 0.0, upper, 0.0))
    dearest = np.where(beta > 0.0, upper, np.where(beta < 0.0, lower, 0.0))
    return (beta * cheapest).sum(axis=-1), (beta * dearest).sum(axis=-1)
