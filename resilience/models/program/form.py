"""A stage in numbers: what `unroll` copies to every node of its tree.

Columns are numbered with the states' present values first, the stage's own behind them. Everything
that data d can change is one affine map,

    numbers(d) = constants + slopes @ d,

which holds, one behind the other, the lower bounds and the upper bounds of the own columns, the
right-hand sides of the rows, and the prices of all columns. In one piece, because one product of a
sparse matrix is what a controller pays for in every slot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Bools, Floats, Ints
from resilience.models.algebra import Affine, stack
from resilience.models.language.stage import Block, Cost, Stage
from resilience.models.structures import Structure

SHARED = frozenset({"now", "design"})
"""Kinds of blocks whose columns belong to the node before."""


@dataclass(frozen=True)
class CostForm:
    """One cost term, $ per node: prices of the columns and an offset, each a constant + data part.

    Attributes:
        name: of the term, as `load.shed`.
        columns: (columns,) constant part of the prices.
        columns_data: (columns, data) what each datum adds to them.
        offset: constant part of what the term costs whatever the columns.
        offset_data: (data,) what each datum adds to it.
    """

    name: str
    columns: Floats
    columns_data: sp.csr_array
    offset: float
    offset_data: Floats

    def spent(self, z: Floats, data: Floats) -> Floats:
        """(n,) $ of the term at points z (columns, n) for data (data, n)."""
        prices = self.columns[:, None] + self.columns_data @ data
        return (prices * z).sum(0) + self.offset + self.offset_data @ data


@dataclass(frozen=True)
class Form:
    """See the module's docstring; made by `stage_form`.

    Attributes:
        stage: what it was made from.
        n_now: number of columns that are states at the start of the step; of a design also at its
            end.
        own_blocks: the variables that every node gets anew, in the order of their columns.
        column_of_id: (ids,) column of each id of the stage's variables.
        n_data: number of data.
        a: (rows, columns) coefficients.
        equality: (rows,) whether a row is an equation or a `<=`.
        row_start: (named constraints + 1,) first row of each of the stage's constraints.
        integer: (own columns,) whether a column is integer.
        constants: (2 own columns + rows + columns,) numbers without data.
        slopes: (as `constants`, data) what each datum adds to them.
        ends: (3,) where lower bounds, upper bounds and right-hand sides end in `constants`.
        offset: $ that a node costs whatever the columns, without data.
        offset_data: (data,) $ that each datum adds to it.
        costs: the cost terms one by one; their sum is in prices and offset.
        penalty: (columns,) weights that close relaxed structures.
        tiebreak: (columns,) weights of |x| by which equally good points are told apart.
        structures: every structure with the coefficient matrix (n, columns) of each argument.
    """

    stage: Stage
    n_now: int
    own_blocks: tuple[Block, ...]
    column_of_id: Ints
    n_data: int
    a: sp.coo_array
    equality: Bools
    row_start: Ints
    integer: Bools
    constants: Floats
    slopes: sp.csr_array
    ends: Ints
    offset: float
    offset_data: Floats
    costs: tuple[CostForm, ...]
    penalty: Floats
    tiebreak: Floats
    structures: tuple[tuple[Structure, tuple[sp.csr_array, ...]], ...]

    @property
    def n_columns(self) -> int:
        """Number of columns, the present states included."""
        return int(self.a.shape[1])

    @property
    def n_own(self) -> int:
        """Number of columns that every node gets anew."""
        return self.n_columns - self.n_now

    @property
    def n_rows(self) -> int:
        """Number of rows."""
        return int(self.a.shape[0])

    def block(self, name: str) -> Block:
        """The block of a variable of its own, or of a design.

        Raises:
            KeyError: an unknown name.
        """
        for block in (*self.own_blocks, *(design.block for design in self.stage.designs)):
            if block.name == name:
                return block
        names = ", ".join(block.name for block in self.own_blocks)
        raise KeyError(f"no variable {name!r}; there are {names}")

    def columns(self, block: Block) -> Ints:
        """(labels,) columns of a block."""
        return self.column_of_id[block.slice]

    def own_columns(self, block: Block) -> range:
        """Where a block lies among the columns that every node gets anew."""
        start = int(self.column_of_id[block.start]) - self.n_now if block.n else 0
        return range(start, start + block.n)

    @cached_property
    def design_numbers(self) -> tuple[Ints, Floats, Floats, Floats, Bools]:
        """Of all designs: (designs,) columns, lower and upper bounds, $ per unit, integer."""
        none, designs = np.empty(0), self.stage.designs
        integer = [self.stage.integer[self.stage.variables.index(d.block)] for d in designs]
        return (
            np.concatenate([none, *(self.columns(d.block) for d in designs)]).astype(np.intp),
            np.concatenate([none, *(d.lower for d in designs)]),
            np.concatenate([none, *(d.upper for d in designs)]),
            np.concatenate([none, *(d.cost for d in designs)]),
            np.repeat(integer, [d.block.n for d in designs]).astype(bool),
        )

    def rows(self, name: str) -> slice:
        """Rows of one of the stage's named constraints.

        Raises:
            KeyError: there is none of that name.
        """
        names = [row.name for row in self.stage.rows]
        if name not in names:
            raise KeyError(f"no constraint {name!r}; there are {', '.join(names)}")
        k = names.index(name)
        return slice(int(self.row_start[k]), int(self.row_start[k + 1]))

    def numbers(self, data: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Lower and upper bounds, right-hand sides and prices, (.., n) for data (data, n)."""
        numbers, (a, b, c) = self.constants[:, None] + self.slopes @ data, self.ends
        return numbers[:a], numbers[a:b], numbers[b:c], numbers[c:]

    def prices(self, data: Floats) -> Floats:
        """(columns, n) prices in $ per unit, for data (data, n)."""
        first = self.ends[-1]
        return self.constants[first:, None] + self.slopes[first:] @ data

    def offsets(self, data: Floats) -> Floats:
        """(n,) $ that a node costs whatever the columns, for data (data, n)."""
        return self.offset + self.offset_data @ data

    @cached_property
    def lower_bounds(self) -> tuple[Floats, sp.csr_array]:
        """Of the own columns: (own columns,) constants and (own columns, data) slopes."""
        return self.constants[: self.ends[0]], self.slopes[: self.ends[0]]

    @cached_property
    def upper_bounds(self) -> tuple[Floats, sp.csr_array]:
        """Of the own columns: (own columns,) constants and (own columns, data) slopes."""
        uppers = slice(self.ends[0], self.ends[1])
        return self.constants[uppers], self.slopes[uppers]

    @cached_property
    def right_sides(self) -> tuple[Floats, sp.csr_array]:
        """Of the rows: (rows,) constants and (rows, data) slopes."""
        sides = slice(self.ends[1], self.ends[2])
        return self.constants[sides], self.slopes[sides]

    def matrix(self, x: Affine) -> sp.csr_array:
        """Coefficients of the columns in expressions x, (x.n, columns)."""
        return _coefficients(x, self.column_of_id, self.n_columns)


def stage_form(stage: Stage) -> Form:
    """A stage in numbers."""
    numbering = _Numbering.of_stage(stage)
    matrix, n_columns = numbering.matrix, numbering.n_columns
    numbers = [i for i, block in enumerate(stage.variables) if block.kind not in SHARED]
    own_blocks = tuple(stage.variables[i] for i in numbers)
    sizes = [row.expression.n for row in stage.rows]
    rows = _joined([row.expression for row in stage.rows])
    bounds = [limits[i] for limits in (stage.lower, stage.upper) for i in numbers]
    sides = _joined([*bounds, rows * -1.0])
    costs = tuple(numbering.cost(cost) for cost in stage.costs)
    prices = sum((cost.columns for cost in costs), np.zeros(n_columns))
    prices_data = sum((cost.columns_data for cost in costs), numbering.no_data)
    penalty, tiebreak = np.zeros(n_columns), np.zeros(n_columns)
    for term in stage.penalties:
        penalty += matrix(term).sum(axis=0)
    for x, weight in stage.tiebreaks:
        tiebreak[numbering.column_of_id[x.ids]] += weight
    n_own = n_columns - numbering.n_now
    return Form(
        stage=stage,
        n_now=numbering.n_now,
        own_blocks=own_blocks,
        column_of_id=numbering.column_of_id,
        n_data=numbering.n_data,
        a=matrix(rows).tocoo(),
        equality=np.repeat([row.equality for row in stage.rows], sizes).astype(bool),
        row_start=np.cumsum([0, *sizes]),
        integer=np.repeat([stage.integer[i] for i in numbers], [b.n for b in own_blocks]).astype(
            bool
        ),
        constants=np.concatenate([sides.const, prices]),
        slopes=sp.vstack([numbering.data_matrix(sides), prices_data], format="csr"),
        ends=np.cumsum([n_own, n_own, rows.n]),
        offset=sum(cost.offset for cost in costs),
        offset_data=sum((cost.offset_data for cost in costs), np.zeros(numbering.n_data)),
        costs=costs,
        penalty=penalty,
        tiebreak=tiebreak,
        structures=tuple((s, tuple(matrix(arg) for arg in s.args)) for s in stage.structures),
    )


@dataclass(frozen=True)
class _Numbering:
    """Which column each id of a stage's variables is; see `Form` for the fields."""

    column_of_id: Ints
    n_now: int
    n_columns: int
    n_data: int

    @classmethod
    def of_stage(cls, stage: Stage) -> _Numbering:
        """The states' present values first, the other variables behind them."""
        before = [block for block, _ in stage.states]
        own_blocks = [block for block in stage.variables if block.kind not in SHARED]
        column_of_id = np.empty(stage.variables[-1].slice.stop if stage.variables else 0, np.intp)
        column = 0
        for block in [*before, *own_blocks]:
            column_of_id[block.slice] = np.arange(column, column + block.n)
            column += block.n
        n_data = stage.datums[-1].slice.stop if stage.datums else 0
        return cls(column_of_id, sum(block.n for block in before), column, n_data)

    def matrix(self, x: Affine) -> sp.csr_array:
        """Coefficients of the columns, (x.n, columns)."""
        return _coefficients(x, self.column_of_id, self.n_columns)

    def data_matrix(self, x: Affine) -> sp.csr_array:
        """Coefficients of the data, (x.n, data)."""
        datum = x.ids < 0
        entries = (x.values[datum], (x.rows[datum], ~x.ids[datum]))
        return sp.csr_array(entries, shape=(x.n, self.n_data))

    @property
    def no_data(self) -> sp.csr_array:
        """(columns, data) zeros."""
        return sp.csr_array((self.n_columns, self.n_data))

    def cost(self, cost: Cost) -> CostForm:
        """`sum(price * term)`, of which only one of the two may hold data."""
        term, price = cost.term, cost.price
        datum = term.ids < 0
        weights = term.values * price.const[term.rows]
        columns = self.column_of_id[term.ids[~datum]]
        from_term = _summed(~term.ids[datum], weights[datum], self.n_data)
        from_price = _summed(~price.ids, price.values * term.const[price.rows], self.n_data)
        both = self.matrix(term).T @ self.data_matrix(price) if price.has_data else self.no_data
        return CostForm(
            cost.name,
            _summed(columns, weights[~datum], self.n_columns),
            both.tocsr(),
            float(term.const @ price.const),
            from_term + from_price,
        )


def _coefficients(x: Affine, column_of_id: Ints, n_columns: int) -> sp.csr_array:
    variable = x.ids >= 0
    entries = (x.values[variable], (x.rows[variable], column_of_id[x.ids[variable]]))
    return sp.csr_array(entries, shape=(x.n, n_columns))


def _joined(parts: Sequence[Affine]) -> Affine:
    return stack(parts) if parts else Affine.constant(0.0, 0)


def _summed(places: Ints, weights: Floats, n: int) -> Floats:
    return np.bincount(places, weights, n).astype(np.float64)
