r"""What products of several numbers have in common: rows that tighten the relaxation of meshes.

The products $W_{ij} = V_i V_j^*$ of complex numbers make a Hermitian matrix that is positive
semidefinite. An angle (`resilience.models.structures.angle`) has one such product and both squares,
all affine; a cone says as much of two numbers at a time. Of three or more it says less, and a loop
keeps a freedom that no solution has. With the eigenvector $u$ of a negative eigenvalue,

$$ u^* W u = \sum_i |u_i|^2 W_{ii} + 2 \sum_{i < j} \operatorname{Re}(u_i^* u_j W_{ij}) \ge 0 $$

is a linear row that every solution satisfies and the point at hand does not.

Numbers that products join make a graph. A matrix with entries along the edges of a chordal graph
can be completed to a positive semidefinite one if its cliques are (Grone et al. 1984), so rows of
cliques are enough. Edges that make a graph chordal, the fill, have products that no structure has:
two free columns each, bounded by the squares, behind the columns of the program.

What holds nothing is left out: an angle with a slack that may move, and a product that cannot move.

Source: Fukuda et al. (2001) for the cliques, Kocuk, Dey and Sun (2016) for rows on them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import combinations

import networkx as nx
import numpy as np
import scipy.sparse as sp
from scipy.optimize import minimize

from resilience.arrays import Complexes, Floats, Ints
from resilience.models.program.standard import Standard, Vectors
from resilience.models.structures import Angle

Rows = tuple[sp.csr_array, Floats]
Shape = tuple[tuple[int, int], ...]
"""Edges of a connected graph on 0, 1, ..."""
LEAST = 3
"""Numbers of which a clique has a row that is no cone's."""
SLACK = 1e-3
"""Of a row, relative to its largest term, from which it is idle."""
IDLE_ROUNDS = 2
"""In a row, after which an idle row is dropped."""


@dataclass(frozen=True)
class Products:
    """Products of two numbers, real and imaginary parts as rows over all columns, fill included.

    Attributes:
        first, second: (products,) the columns of the two squares; the second is conjugated.
        re, im: (products, columns) their coefficients.
        consts: (products,) their constants.
    """

    first: Ints
    second: Ints
    re: sp.csr_array
    im: sp.csr_array
    consts: Complexes

    def values(self, z: Floats) -> Complexes:
        """(products,) at a point."""
        return self.re @ z + 1j * (self.im @ z) + self.consts


@dataclass
class Cliques:
    """The cliques of a program, and the rows found so far.

    Attributes:
        products: of all edges of the chordal graphs, the fill last.
        groups: by number of members k: columns of squares (cliques, k), and indices of the products
            of its pairs (cliques, k (k - 1) / 2), those of i < j in the order of `combinations`,
            and -1 where the product is that of the other order, 1 elsewhere.
        n_columns: of the program, without the fill.
        fill_max: (fill columns,) bound of either sign.
        rows: G z <= h.
        idle: (rows,) in how many points one after the other a row was idle.
    """

    products: Products
    groups: list[tuple[Ints, Ints, Floats]]
    n_columns: int
    fill_max: Floats
    rows: Rows
    idle: Ints = field(default_factory=lambda: np.empty(0, np.intp))

    @classmethod
    def of_program(cls, standard: Standard, vectors: Vectors) -> Cliques | None:
        """Those of a program with these numbers; None where nothing makes a clique of three."""
        of_lines = _products(standard, vectors)
        if not len(of_lines.first):
            return None
        members, pairs = [], []
        number: dict[tuple[int, int], int] = {}
        for k, ends in enumerate(
            zip(of_lines.first.tolist(), of_lines.second.tolist(), strict=True)
        ):
            number.setdefault((min(ends), max(ends)), k)
        fill: list[tuple[int, int]] = []
        for clique in _all_cliques(number):
            for pair in combinations(clique, 2):
                if pair not in number:
                    number[pair] = len(of_lines.first) + len(fill)
                    fill.append(pair)
            members.append(clique)
            pairs.append([number[pair] for pair in combinations(clique, 2)])
        if not members:
            return None
        products, fill_max = _with_fill(of_lines, np.array(fill, np.intp).reshape(-1, 2), vectors)
        groups = []
        for size in sorted({len(clique) for clique in members}):
            chosen = [k for k, clique in enumerate(members) if len(clique) == size]
            squares = np.array([members[k] for k in chosen], np.intp)
            edges = np.array([pairs[k] for k in chosen], np.intp)
            turned = products.first[edges] != squares[:, _pairs(size)[0]]
            groups.append((squares, edges, np.where(turned, -1.0, 1.0)))
        n = standard.n_columns
        return cls(products, groups, n, fill_max, _no_rows(n + len(fill_max)))

    @property
    def fill(self) -> Ints:
        """Columns behind those of the program."""
        return self.n_columns + np.arange(len(self.fill_max))

    def widened(self, standard: Standard, vectors: Vectors) -> tuple[Standard, Vectors]:
        """The program with the fill behind its columns."""
        extra = len(self.fill_max)
        wide = {
            "a": _wide(standard.a, extra),
            "integer": np.append(standard.integer, np.zeros(extra, bool)),
            "structures": tuple(
                replace(s, matrices=tuple(_wide(m, extra) for m in s.matrices))
                for s in standard.structures
            ),
        }
        fields = {f: getattr(standard, f) for f in type(standard).__dataclass_fields__}
        return type(standard)(**(fields | wide)), replace(
            vectors,
            cost=np.append(vectors.cost, np.zeros(extra)),
            lower=np.append(vectors.lower, -self.fill_max),
            upper=np.append(vectors.upper, self.fill_max),
        )

    def completed(self, z: Floats) -> Floats:
        """The same point with fill that makes the matrices as nearly semidefinite as can be.

        The sum of squares of all negative eigenvalues is least. There it has no slope along the
        fill: so rows of all eigenvectors together part the point from every solution, whatever its
        fill, where rows at any fill would be satisfied by another.
        """
        if not len(self.fill_max):
            return z
        z, n = z.copy(), self.n_columns
        start = z[n:].copy()

        def lack(fill: Floats) -> tuple[float, Floats]:
            z[n:] = fill
            values = self.products.values(z)
            total, slope = 0.0, np.zeros(len(values), np.complex128)
            for squares, edges, sign in self.groups:
                w = _matrices(z[squares], values[edges], sign)
                lowest, u = np.linalg.eigh(w)
                lowest = np.minimum(lowest, 0.0)
                total += 0.5 * float((lowest**2).sum())
                negative = (u * lowest[:, None, :]) @ u.conj().transpose(0, 2, 1)
                first, second = _pairs(squares.shape[1])
                above = 2.0 * negative[:, first, second]
                np.add.at(slope, edges, above.real + 1j * sign * above.imag)
            chords = slope[len(slope) - len(fill) // 2 :]
            return total, np.append(chords.real, chords.imag)

        optimum = minimize(lack, start, jac=True, method="L-BFGS-B", options={"maxiter": 200})
        z[n:] = optimum.x
        return z

    def separate(self, z: Floats, tolerance: float) -> float:
        """Drops rows that have been idle for long, and adds those that z breaks.

        Args:
            z: (columns, fill included).
            tolerance: negative share of the largest square from which an eigenvalue counts.

        Returns:
            The worst such share.
        """
        self._drop_idle(z)
        z = self.completed(z)
        worst, values = 0.0, self.products.values(z)
        g, h = [self.rows[0]], [self.rows[1]]
        for squares, edges, sign in self.groups:
            w = _matrices(z[squares], values[edges], sign)
            lowest, vectors = np.linalg.eigh(w)
            share = lowest / np.maximum(z[squares].max(axis=1), 1e-3)[:, None]
            worst = max(worst, -float(share.min(initial=0.0)))
            clique, which = np.nonzero(share < -tolerance)
            rows, right = self._rows_of(
                squares[clique], edges[clique], sign[clique], vectors[clique, :, which]
            )
            g.append(rows)
            h.append(right)
        self.rows = sp.vstack(g, format="csr"), np.concatenate(h)
        self.idle = np.append(self.idle, np.zeros(len(self.rows[1]) - len(self.idle), np.intp))
        return worst

    def _drop_idle(self, z: Floats) -> None:
        g, h = self.rows
        if not len(h):
            return
        largest = abs(g).max(axis=1).toarray().ravel()
        idle = h - g @ z > SLACK * largest
        self.idle = np.where(idle, self.idle + 1, 0)
        keep = np.flatnonzero(self.idle < IDLE_ROUNDS)
        self.rows, self.idle = (g[keep], h[keep]), self.idle[keep]

    def _rows_of(self, squares: Ints, edges: Ints, sign: Floats, u: Complexes) -> Rows:
        """-u* W u <= 0, row by row, for eigenvectors (rows, members)."""
        n, size = u.shape
        first, second = _pairs(size)
        factor = 2.0 * u[:, first].conj() * u[:, second]  # of W_ij: its real part counts
        row = np.arange(n)
        places = np.repeat(row, edges.shape[1]), edges.ravel()
        by_re, by_im = (
            sp.csr_array((weight.ravel(), places), (n, len(self.products.first)))
            for weight in (factor.real, -factor.imag * sign)
        )
        diagonal = sp.csr_array(
            ((np.abs(u) ** 2).ravel(), (np.repeat(row, size), squares.ravel())),
            (n, self.products.re.shape[1]),
        )
        products = self.products
        g = -(diagonal + by_re @ products.re + by_im @ products.im)
        return sp.csr_array(g), by_re @ products.consts.real + by_im @ products.consts.imag


def _no_rows(n: int) -> Rows:
    return sp.csr_array((0, n)), np.empty(0)


def _wide(matrix: sp.csr_array, extra: int) -> sp.csr_array:
    shape = matrix.shape[0], matrix.shape[1] + extra
    return sp.csr_array((matrix.data, matrix.indices, matrix.indptr), shape)


def _pairs(size: int) -> Ints:
    """(2, pairs) i and j of all i < j, in the order of `combinations`."""
    return np.array(np.triu_indices(size, 1), np.intp)


def _matrices(squares: Floats, pairs: Complexes, sign: Floats) -> Complexes:
    """(cliques, k, k) Hermitian matrices of squares (cliques, k) and products of pairs."""
    n, size = squares.shape
    w = np.zeros((n, size, size), np.complex128)
    first, second = _pairs(size)
    above = pairs.real + 1j * sign * pairs.imag
    w[:, first, second], w[:, second, first] = above, above.conj()
    w[:, range(size), range(size)] = squares
    return w


def _products(standard: Standard, vectors: Vectors) -> Products:
    """The products of all angles that hold whatever is decided, one per pair of numbers.

    Numbers are taken as the roots of plain columns: V behind a ratio is V over it.
    """
    live = (vectors.lower < vectors.upper).astype(float)
    first, second, re, im, consts = [], [], [], [], []
    for unrolled in standard.structures_of(Angle).values():
        theta, real, imaginary, from_sq, to_sq = unrolled.matrices
        plain = (np.diff(from_sq.indptr) == 1) & (np.diff(to_sq.indptr) == 1)
        # Both numbers have an angle; a third column is a slack, which opens what it stands in.
        moves = (abs(imaginary) @ live > 0.0) & (_count(theta) @ live <= 2.0)
        keep = np.flatnonzero(plain & moves)
        a, b = (m[keep] for m in (from_sq, to_sq))
        scale = np.exp(-1j * unrolled.consts[0][keep]) / np.sqrt(a.data * b.data)
        parts = real[keep], imaginary[keep]
        first.append(a.indices)
        second.append(b.indices)
        re.append(_times(parts, scale.real, -scale.imag))
        im.append(_times(parts, scale.imag, scale.real))
        consts.append(scale * (unrolled.consts[1][keep] + 1j * unrolled.consts[2][keep]))
    none = sp.csr_array((0, standard.n_columns))
    return Products(
        np.concatenate([np.empty(0, np.intp), *first]),
        np.concatenate([np.empty(0, np.intp), *second]),
        sp.vstack([none, *re], format="csr"),
        sp.vstack([none, *im], format="csr"),
        np.concatenate([np.empty(0, np.complex128), *consts]),
    )


def _count(matrix: sp.csr_array) -> sp.csr_array:
    return sp.csr_array((np.ones(len(matrix.data)), matrix.indices, matrix.indptr), matrix.shape)


def _times(parts: tuple[sp.csr_array, sp.csr_array], by_re: Floats, by_im: Floats) -> sp.csr_array:
    re, im = parts
    return sp.csr_array(re.multiply(by_re[:, None]) + im.multiply(by_im[:, None]))


def _with_fill(of_lines: Products, fill: Ints, vectors: Vectors) -> tuple[Products, Floats]:
    """Products with those of the fill (pairs, 2) behind them, and the bounds of its columns."""
    n, width = len(fill), of_lines.re.shape[1]
    root = np.sqrt(np.maximum(vectors.upper, 0.0))
    bound = root[fill[:, 0]] * root[fill[:, 1]]
    wide = [_wide(m, 2 * n) for m in (of_lines.re, of_lines.im)]
    shape, ones = (n, width + 2 * n), np.ones(n)
    re = sp.csr_array((ones, (np.arange(n), width + np.arange(n))), shape)
    im = sp.csr_array((ones, (np.arange(n), width + n + np.arange(n))), shape)
    products = Products(
        np.append(of_lines.first, fill[:, 0]),
        np.append(of_lines.second, fill[:, 1]),
        sp.vstack([wide[0], re], format="csr"),
        sp.vstack([wide[1], im], format="csr"),
        np.append(of_lines.consts, np.zeros(n)),
    )
    return products, np.tile(bound, 2)


def _all_cliques(edges: dict[tuple[int, int], int]) -> Iterator[tuple[int, ...]]:
    """Cliques of three or more numbers of a chordal graph around the edges, sorted.

    Slots repeat the same graph: each shape is filled once.
    """
    graph = nx.Graph(list(edges))
    by_shape: dict[Shape, list[tuple[int, ...]]] = {}
    for component in nx.connected_components(graph):
        nodes = sorted(component)
        place = {node: k for k, node in enumerate(nodes)}
        shape = tuple(
            sorted(
                (min(place[i], place[j]), max(place[i], place[j]))
                for i, j in graph.subgraph(component).edges
            )
        )
        if shape not in by_shape:
            by_shape[shape] = _cliques(shape)
        for clique in by_shape[shape]:
            yield tuple(nodes[k] for k in clique)


def _cliques(shape: Shape) -> list[tuple[int, ...]]:
    graph = nx.Graph(list(shape))
    _, bags = nx.approximation.treewidth_min_fill_in(graph)
    sets = sorted({frozenset(bag) for bag in bags}, key=lambda bag: (len(bag), sorted(bag)))
    maximal = [
        bag for k, bag in enumerate(sets) if not any(bag < larger for larger in sets[k + 1 :])
    ]
    return [tuple(sorted(bag)) for bag in maximal if len(bag) >= LEAST]
