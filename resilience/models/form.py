"""A stage in numbers: what `unroll` copies to every node of its tree."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp

from resilience.models.algebra import Affine, Floats, Ints
from resilience.models.stage import Block, Stage, Structure


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
        self._rows()
        self._bounds()
        self.costs = [self._cost(c.name, c.term, c.price) for c in self.stage.costs]
        self.penalty = np.zeros(self.n_columns)
        for term in self.stage.penalties:
            self.penalty += self.matrix(term).sum(axis=0)

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

    def _rows(self) -> None:
        rows = self.stage.rows
        sizes = [row.expression.n for row in rows]
        self.row_start = np.cumsum([0, *sizes])
        self.n_rows = int(self.row_start[-1])
        width = [(0, self.n_columns), (0, self.n_data)]
        empty = [sp.csr_array(shape) for shape in width]
        if rows:
            self.a = sp.vstack([self.matrix(r.expression) for r in rows], format="coo")
            self.rhs_data = -sp.vstack([self.data_matrix(r.expression) for r in rows], format="csr")
        else:
            self.a, self.rhs_data = empty[0].tocoo(), empty[1]
        self.rhs = -np.concatenate([r.expression.const for r in rows] or [np.empty(0)])
        self.equality = np.repeat([r.equality for r in rows], sizes).astype(bool)

    def _bounds(self) -> None:
        blocks = self.stage.variables
        keep = [i for i, b in enumerate(blocks) if b.kind != "now"]
        self.integer = np.repeat(
            [self.stage.integer[i] for i in keep], [blocks[i].n for i in keep]
        ).astype(bool)
        for side in ("lower", "upper"):
            limits: list[Affine] = [getattr(self.stage, side)[i] for i in keep]
            const = np.concatenate([x.const for x in limits] or [np.empty(0)])
            data = [self.data_matrix(x) for x in limits] or [sp.csr_array((0, self.n_data))]
            setattr(self, side, const)
            setattr(self, side + "_data", sp.vstack(data, format="csr"))

    lower: Floats = field(init=False)
    upper: Floats = field(init=False)
    lower_data: sp.csr_array = field(init=False)
    upper_data: sp.csr_array = field(init=False)

    def _cost(self, name: str, term: Affine, price: Affine) -> CostForm:
        columns, worth = self.matrix(term), self.data_matrix(price)
        return CostForm(
            name,
            columns.T @ price.const,
            (columns.T @ worth).tocsr(),
            float(term.const @ price.const),
            worth.T @ term.const + self.data_matrix(term).T @ price.const,
        )

    def structures(self) -> list[tuple[Structure, list[sp.csr_array]]]:
        """Every structure with the coefficient matrix of each of its arguments."""
        return [(s, [self.matrix(arg) for arg in s.args]) for s in self.stage.structures]
