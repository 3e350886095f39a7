"""Checks any answer, whoever produced it: solver, rule or network.

Every violation is scaled: that of a row by 1 + its largest term, of a bound by 1 + the bound, of a
structure by what it is about. 1e-6 is a good answer; 1e-3 is not an answer.

Bounds that are there for solvers alone (`Stage.auxiliary`) cut nothing off as long as no answer
comes near them: from `NEAR_LIMIT` of such a bound on, `auxiliary line.p` grows from 0 to 1 at the
bound. That is asked of answers to the whole model; a relaxation may go to any limit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.models.program.standard import Standard, Vectors
from resilience.models.structures import (
    Angle,
    Largest,
    SecondOrder,
    Structure,
    UnrolledStructure,
)
from resilience.tolerances import INTEGRALITY_TOLERANCE, RELAXATION_TOLERANCE

NEAR_LIMIT = 0.99
"""Share of an auxiliary limit that no answer should reach: limits are 1.1 times what is proven."""


@dataclass(frozen=True)
class Audit:
    """Worst scaled violations.

    Attributes:
        worst: per named row, structure, `bounds`, `integrality` and `cut`, the worst violation, and
            per variable with auxiliary bounds, as `auxiliary line.p`, how near it came to them.
        where: likewise, which element that is, as `ess.dynamics[ess2, 14:30]`.
    """

    worst: dict[str, float]
    where: dict[str, str]

    @property
    def maximum(self) -> float:
        """The worst of all."""
        return max(self.worst.values(), default=0.0)

    @property
    def name(self) -> str:
        """Where the worst of all is, as `ess.dynamics[ess2, 14:30]`."""
        if not self.worst:
            return ""
        return self.where[max(self.worst, key=lambda k: self.worst[k])]


def audit(standard: Standard, z: Floats, vectors: Vectors) -> Audit:
    """Worst violations of z (columns,) for the data in `vectors`, by name."""
    worst: dict[str, float] = {}
    where: dict[str, str] = {}

    def note(name: str, violation: Floats, element_name: Callable[[int], str]) -> None:
        if not len(violation):
            return
        violation = np.where(np.isnan(violation), np.inf, violation)  # no number holds nothing
        k = int(np.argmax(violation))
        if violation[k] >= worst.get(name, -1.0):
            worst[name], where[name] = float(violation[k]), element_name(k)

    def note_rows(name: str, rows: Ints) -> None:
        note(name, violations[rows], lambda k: standard.row_name(int(rows[k])))

    violations = row_violations(standard, z, vectors)
    for stage in standard.copies:
        starts = stage.form.row_start
        for i, row in enumerate(stage.form.stage.rows):
            note_rows(row.name, stage.rows[:, starts[i] : starts[i + 1]].ravel())
    note_rows("cut", np.arange(standard.n_rows - standard.n_cut_rows, standard.n_rows))
    note("bounds", _bound_violations(z, vectors), standard.column_name)
    integers = np.flatnonzero(standard.integer)
    off = np.abs(z[integers] - np.round(z[integers]))
    note("integrality", off, lambda k: standard.column_name(int(integers[k])))
    for structure in standard.structures:
        note(structure.name, structure.violation(z), partial(_element_name, standard, structure))
    if off.max(initial=0.0) <= RELAXATION_TOLERANCE and not _is_relaxed(standard, z):
        for name, columns in auxiliary_columns(standard):
            near = _nearness(z[columns], vectors.lower[columns], vectors.upper[columns])
            note(f"auxiliary {name}", near, partial(_column_name, standard, columns))
    return Audit(worst, where)


def _is_relaxed(standard: Standard, z: Floats) -> bool:
    """Whether a cone or an angle is open, or a rating exceeded."""
    kinds: tuple[type[Structure], ...] = (SecondOrder, Angle)
    flows = [u for kind in kinds for u in standard.structures_of(kind).values()]
    return any(u.violation(z).max(initial=0.0) > RELAXATION_TOLERANCE for u in flows)


def auxiliary_columns(standard: Standard) -> Iterator[tuple[str, Ints]]:
    """Variables with auxiliary bounds, and the columns whose bounds are, stage by stage."""
    for stage in standard.copies:
        for name, chosen in stage.form.stage.auxiliary.items():
            columns = stage.form.columns(stage.form.block(name))[chosen]
            yield name, stage.columns[:, columns].ravel()


def _nearness(z: Floats, lower: Floats, upper: Floats) -> Floats:
    """(n,) 0 up to `NEAR_LIMIT` of a bound and 1 at it; a bound of 0 holds what cannot act."""
    limit = np.maximum(np.where(z < 0.0, -lower, upper), 0.0)
    excess = np.abs(z) - NEAR_LIMIT * limit - RELAXATION_TOLERANCE
    acts = (limit > 0.0) & np.isfinite(limit) & (excess > 0.0)
    return np.where(acts, excess / np.where(acts, (1.0 - NEAR_LIMIT) * limit, 1.0), 0.0)


def _column_name(standard: Standard, columns: Ints, k: int) -> str:
    return standard.column_name(int(columns[k]))


def _element_name(standard: Standard, structure: UnrolledStructure[Structure], k: int) -> str:
    node, label = divmod(k, len(structure.labels))
    slot = standard.tree.labels[structure.nodes[node]]
    return f"{structure.name}[{structure.labels[label]}, {slot}]"


def row_violations(standard: Standard, z: Floats, v: Vectors) -> Floats:
    """(rows,) scaled violation of every row."""
    activity = standard.a @ z
    terms = abs(standard.a).multiply(np.abs(z)[None, :]).tocsr()
    scale = 1.0 + terms.max(axis=1).toarray().ravel()
    return np.maximum(np.maximum(activity - v.row_upper, v.row_lower - activity) / scale, 0.0)


def _bound_violations(z: Floats, v: Vectors) -> Floats:
    def beyond(limit: Floats, excess: Floats) -> Floats:
        finite = np.isfinite(limit)
        return np.where(finite, excess / (1.0 + np.abs(np.where(finite, limit, 0.0))), 0.0)

    return np.maximum(beyond(v.upper, z - v.upper), np.maximum(beyond(v.lower, v.lower - z), 0.0))


def settle(standard: Standard, z: Floats, vectors: Vectors) -> Floats:
    """Rounds off solver dust and makes every `Largest` tight, node by node.

    Integers within tolerance are rounded; y becomes the maximum it was only held above. A node
    comes after its parent, whichever stages the two are of, since y may be a state.
    """
    z = np.clip(z, vectors.lower, vectors.upper)
    nearly_whole = np.abs(z - np.round(z)) < INTEGRALITY_TOLERANCE
    integers = np.flatnonzero(standard.integer & nearly_whole)
    z[integers] = np.round(z[integers])
    return tightened(standard, z)


def tightened(standard: Standard, z: Floats) -> Floats:
    """The point with every `Largest` tight, which nothing else may press down: see `settle`."""
    z = z.copy()
    maxima = list(standard.structures_of(Largest).values())
    if not _build_on_each_other(standard, maxima):
        for largest in maxima:
            _tighten(largest, z, slice(None))
        return z
    order = sorted((node, k, i) for k, s in enumerate(maxima) for i, node in enumerate(s.nodes))
    for _, k, i in order:
        width = len(maxima[k].labels)
        _tighten(maxima[k], z, slice(i * width, (i + 1) * width))
    return z


def _build_on_each_other(standard: Standard, maxima: Sequence[UnrolledStructure[Largest]]) -> bool:
    """Whether a maximum is of another one, as of a state of the node before."""
    is_maximum = np.zeros(standard.n_columns)
    for largest in maxima:
        is_maximum[largest.matrices[0].indices] = 1.0
    arguments = [m for largest in maxima for m in largest.matrices[1:]]
    return any((abs(m) @ is_maximum).any() for m in arguments)


def _tighten(largest: UnrolledStructure[Largest], z: Floats, elements: slice) -> None:
    """Makes some elements tight, in place."""
    xs = [
        m[elements] @ z + c[elements]
        for m, c in zip(largest.matrices[1:], largest.consts[1:], strict=True)
    ]
    # One column per element, y or its negative.
    y = largest.matrices[0]
    z[y.indices[elements]] = largest.structure.maximum(xs) / y.data[elements] + 0.0
