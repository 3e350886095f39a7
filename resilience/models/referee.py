"""Checks any answer, whoever produced it: solver, rule or network.

Every violation is scaled: that of a row by 1 + its largest term, of a bound by 1 + the bound, of a
structure by what it is about. 1e-6 is a good answer; 1e-3 is not an answer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from resilience.models.algebra import Floats
from resilience.models.standard import Standard, Unrolled, Vectors

TOLERANCE = 1e-5


@dataclass(frozen=True)
class Audit:
    """Worst scaled violation per named row, bound and structure, and where the worst one is."""

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


def audit(problem: Standard, z: Floats, vectors: Vectors) -> Audit:
    """Worst violations of z (columns,) for the data in `vectors`, by name."""
    worst: dict[str, float] = {}
    where: dict[str, str] = {}

    def note(name: str, violation: Floats, label: str) -> None:
        value = float(violation.max(initial=0.0))
        if value >= worst.get(name, -1.0):
            worst[name], where[name] = value, label

    rows = row_violations(problem, z, vectors)
    for form, table in zip(problem.forms, problem.row_tables, strict=True):
        for k, row in enumerate(form.stage.rows):
            at = table[:, form.row_start[k] : form.row_start[k + 1]].ravel()
            found = rows[at]
            note(row.name, found, problem.row_name(int(at[np.argmax(found)])))
    bounds = _bound_violations(z, vectors)
    note("bounds", bounds, problem.column_name(int(np.argmax(bounds))))
    if problem.integer.any():
        at = np.flatnonzero(problem.integer)
        found = np.abs(z[at] - np.round(z[at]))
        note("integrality", found, problem.column_name(int(at[np.argmax(found)])))
    for structure in problem.structures:
        found = structure_violations(structure, z)
        k = int(np.argmax(found))
        slot = problem.tree.labels[structure.nodes[k // len(structure.labels)]]
        label = structure.labels[k % len(structure.labels)]
        note(structure.name, found, f"{structure.name}[{label}, {slot}]")
    return Audit(worst, where)


def row_violations(problem: Standard, z: Floats, v: Vectors) -> Floats:
    """(rows,) scaled violation of every row."""
    activity = problem.a @ z
    terms = abs(problem.a).multiply(np.abs(z)[None, :]).tocsr()
    scale = 1.0 + terms.max(axis=1).toarray().ravel()
    found: Floats = np.maximum(activity - v.row_upper, v.row_lower - activity) / scale
    return np.maximum(found, 0.0)


def _bound_violations(z: Floats, v: Vectors) -> Floats:
    def beyond(limit: Floats, excess: Floats) -> Floats:
        finite = np.isfinite(limit)
        return np.where(finite, excess / (1.0 + np.abs(np.where(finite, limit, 0.0))), 0.0)

    return np.maximum(beyond(v.upper, z - v.upper), np.maximum(beyond(v.lower, v.lower - z), 0.0))


def structure_violations(structure: Unrolled, z: Floats) -> Floats:
    """(elements,) how far each element is from holding."""
    measure: Callable[[Unrolled, list[Floats]], Floats] = _MEASURES[structure.kind]
    return measure(structure, structure.values(z))


def _split(s: Unrolled, args: list[Floats]) -> Floats:
    scale = 1.0 + np.minimum(*s.limits)
    return np.maximum(np.minimum(*args), 0.0) / scale


def _cone(s: Unrolled, args: list[Floats]) -> Floats:
    u, v, *xs = args
    square = sum((x**2 for x in xs), np.zeros(s.n))
    return np.abs(u * v - square) / (1.0 + square)


def _disc(s: Unrolled, args: list[Floats]) -> Floats:
    length = np.sqrt(sum((x**2 for x in args), np.zeros(s.n)))
    return np.maximum(length - s.limits[0], 0.0) / (1.0 + s.limits[0])


def _largest(s: Unrolled, args: list[Floats]) -> Floats:
    return np.abs(args[0] - np.max(args[1:], axis=0))


def _adjacent(s: Unrolled, args: list[Floats]) -> Floats:
    weights = np.array(args)
    pairs = np.array([weights[k : k + 2].sum(0) for k in range(max(len(weights) - 1, 1))])
    found: Floats = np.maximum(weights.sum(0) - pairs.max(0), 0.0)
    return found


_MEASURES = {
    "split": _split,
    "cone": _cone,
    "disc": _disc,
    "largest": _largest,
    "adjacent": _adjacent,
}


def settle(problem: Standard, z: Floats, vectors: Vectors) -> Floats:
    """Rounds off solver dust and makes every `largest` tight, node by node.

    Integers within tolerance are rounded; y becomes the maximum it was only held above.
    """
    z = np.clip(z, vectors.lower, vectors.upper)
    whole = np.flatnonzero(problem.integer & (np.abs(z - np.round(z)) < TOLERANCE))
    z[whole] = np.round(z[whole])
    for structure in problem.structures:
        if structure.kind != "largest":
            continue
        y = structure.matrices[0].indices
        width = len(structure.labels)
        for k in range(len(structure.nodes)):
            at = slice(k * width, (k + 1) * width)
            args = [
                m[at] @ z + c[at]
                for m, c in zip(structure.matrices[1:], structure.consts[1:], strict=True)
            ]
            z[y[at]] = np.max(args, axis=0)
    return z
