"""A stage in numbers: what `unroll` copies to every node of its tree."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats, Ints
from resilience.models.algebra import Affine, stack
from resilience.models.language.stage import Block, Stage
from resilience.models.structures import Structure


@dataclass(frozen=True)
class CostForm:
    """One cost term: coefficient of every column and an offset, each constant + data part."""

    name: str
    columns: Floats
    columns_data: sp.csr_array
    offset: float
    offset_data: Floats


@dataclass
class Form:
    """Columns are numbered with the states' present values first, the stage's own behind them."""

    stage: Stage
    n_now: int = 0
    position: Ints = field(default_factory=lambda: np.empty(0, np.intp))
    own: list[Block] = field(default_factory=list)

    def __post_init__(self) -> None:
        blocks = self.stage.variables
        width = blocks[-1].start + blocks[-1].n if blocks else 0
        self.position = np.empty(width, np.intp)
        self.own = [b for b in blocks if b.kind != "now"]
        at = 0
        for block in [before for before, _ in self.stage.states] + self.own:
            self.position[block.slice] = np.arange(at, at + block.n)
            at += block.n
        self.n_now = sum(before.n for before, _ in self.stage.states)
        self.n_columns = at
        last = self.stage.datums[-1] if self.stage.datums else None
        self.n_data = last.start + last.n if last else 0
        rows = _joined([row.expression for row in self.stage.rows])
        self._rows(rows)
        self.costs = [self._cost(c.name, c.term, c.price) for c in self.stage.costs]
        self._changes(rows)
        self.penalty = np.zeros(self.n_columns)
        for term in self.stage.penalties:
            self.penalty += self.matrix(term).sum(axis=0)
        self.tiebreak = np.zeros(self.n_columns)
        for x, weight in self.stage.tiebreaks:
            self.tiebreak[self.position[x.ids]] += weight

    @property
    def n_own(self) -> int:
        """Number of columns that every node gets anew."""
        return self.n_columns - self.n_now

    def block(self, name: str) -> Block:
        """The block of a variable of its own. Raises `KeyError` for an unknown name."""
        found = next((b for b in self.own if b.name == name), None)
        if found is None:
            raise KeyError(f"no variable {name!r}; there are {', '.join(b.name for b in self.own)}")
        return found

    def row(self, name: str) -> int:
        """Which of the stage's named constraints is `name`. Raises `KeyError` for none."""
        names = [row.name for row in self.stage.rows]
        if name not in names:
            raise KeyError(f"no constraint {name!r}; there are {', '.join(names)}")
        return names.index(name)

    def span(self, block: Block) -> range:
        """Where a block lies among the columns that every node gets anew."""
        start = int(self.position[block.start]) - self.n_now if block.n else 0
        return range(start, start + block.n)

    def matrix(self, x: Affine) -> sp.csr_array:
        """Coefficients of the columns, (x.n, n_columns)."""
        at = x.ids >= 0
        entries = (x.values[at], (x.rows[at], self.position[x.ids[at]]))
        return sp.csr_array(entries, shape=(x.n, self.n_columns))

    def data_matrix(self, x: Affine) -> sp.csr_array:
        """Coefficients of the data, (x.n, n_data)."""
        at = x.ids < 0
        return sp.csr_array((x.values[at], (x.rows[at], ~x.ids[at])), shape=(x.n, self.n_data))

    def _rows(self, rows: Affine) -> None:
        sizes = [row.expression.n for row in self.stage.rows]
        self.row_start = np.cumsum([0, *sizes])
        self.n_rows = rows.n
        self.a = self.matrix(rows).tocoo()
        self.equality = np.repeat([r.equality for r in self.stage.rows], sizes).astype(bool)

    def _changes(self, rows: Affine) -> None:
        """One matrix for all that data can change: `fixed + moving @ data`, cut at `parts`, are
        the lower and upper bounds of the own columns, the right-hand sides, and all prices;
        `offset + offset_data @ data` is what the node costs whatever the columns.
        """
        blocks = self.stage.variables
        keep = [i for i, b in enumerate(blocks) if b.kind != "now"]
        whole = [self.stage.integer[i] for i in keep]
        self.integer = np.repeat(whole, [blocks[i].n for i in keep]).astype(bool)
        limits = [side[i] for side in (self.stage.lower, self.stage.upper) for i in keep]
        sides = _joined([*limits, rows * -1.0])
        prices = sum((c.columns for c in self.costs), np.zeros(self.n_columns))
        moved = sum((c.columns_data for c in self.costs), self._no_data)
        self.parts = np.cumsum([self.n_own, self.n_own, self.n_rows])
        self.fixed = np.concatenate([sides.const, prices])
        self.moving = sp.vstack([self.data_matrix(sides), moved], format="csr")
        self.lower, self.upper, self.rhs, _ = np.split(self.fixed, self.parts)
        self.offset = sum(c.offset for c in self.costs)
        self.offset_data = sum((c.offset_data for c in self.costs), np.zeros(self.n_data))

    @cached_property
    def lower_data(self) -> sp.csr_array:
        """What data adds to the lower bounds, (own columns, data)."""
        return self.moving[: self.parts[0]]

    @cached_property
    def upper_data(self) -> sp.csr_array:
        """What data adds to the upper bounds, (own columns, data)."""
        return self.moving[self.parts[0] : self.parts[1]]

    @cached_property
    def rhs_data(self) -> sp.csr_array:
        """What data adds to the right-hand sides, (rows, data)."""
        return self.moving[self.parts[1] : self.parts[2]]

    @property
    def _no_data(self) -> sp.csr_array:
        return sp.csr_array((self.n_columns, self.n_data))

    def _cost(self, name: str, term: Affine, price: Affine) -> CostForm:
        """`sum(price * term)`, of which only one of the two may hold data."""
        of_data = term.ids < 0
        weights = term.values * price.const[term.rows]
        at = self.position[term.ids[~of_data]]
        moving = _summed(~term.ids[of_data], weights[of_data], self.n_data)
        worth = price.values * term.const[price.rows]
        both = self.matrix(term).T @ self.data_matrix(price) if price.has_data else self._no_data
        return CostForm(
            name,
            _summed(at, weights[~of_data], self.n_columns),
            both.tocsr(),
            float(term.const @ price.const),
            moving + _summed(~price.ids, worth, self.n_data),
        )

    def structures(self) -> list[tuple[Structure, list[sp.csr_array]]]:
        """Every structure with the coefficient matrix of each of its arguments."""
        return [(s, [self.matrix(arg) for arg in s.args]) for s in self.stage.structures]


def _joined(parts: list[Affine]) -> Affine:
    return stack(parts) if parts else Affine.constant(0.0, 0)


def _summed(at: Ints, weights: Floats, n: int) -> Floats:
    return np.bincount(at, weights, n).astype(np.float64)
