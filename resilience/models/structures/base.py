"""What every structure says of itself, and its arguments copied to the nodes of a tree.

A structure is a fact that no affine row can state. Its class holds everything that a backend, a
method or the referee needs to know and that no solver's library is needed for: how far a point is
from satisfying it, its exact rewrite, its relaxation. A backend keeps one table from these classes
to how it states them, and refuses by name what is in no table of its own.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Generic, TypeVar

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Bools, Floats, Ints
from resilience.models.algebra import Affine, Labels


@dataclass(frozen=True)
class Structure(ABC):
    """A named non-affine fact about expressions, elementwise over its labels.

    Attributes:
        name: as in `ess.mode`.
        labels: the devices, buses or lines that it has an element for.
        args: expressions, one entry per label; what they mean is said by the class.
        limits: constants (labels,), where the class has some.

    Raises:
        ValueError: arguments of different lengths, or with data in them.
    """

    name: str
    labels: Labels
    args: tuple[Affine, ...]
    limits: tuple[Floats, ...] = ()
    title: ClassVar[str]
    """What such a thing is called in messages."""
    complaint: ClassVar[str]
    """What is said of elements that do not hold, behind their number."""
    dimensionless: ClassVar[bool] = False
    """Whether its arguments are the same numbers whatever the unit of power."""

    def __post_init__(self) -> None:
        if any(arg.n != self.args[0].n for arg in self.args):
            raise ValueError(f"structure {self.name!r}: its arguments are of different lengths")
        if any(arg.has_data for arg in self.args):
            raise ValueError(f"structure {self.name!r}: data may not enter a {self.title}")

    @abstractmethod
    def violation(self, args: Sequence[Floats], limits: Sequence[Floats]) -> Floats:
        """(n,) scaled distance from holding, for argument values and limits (n,) each."""

    def bound_arguments(self, moving: Sequence[Bools], args: Sequence[Floats]) -> Bools:
        """(n,) whether an element says anything about the arguments that can move.

        Args:
            moving: per argument, (n,) whether it can move.
            args: per argument, (n,) its value with everything that moves at zero.
        """
        return np.any(moving, axis=0)

    def shortfall(self, violation: Floats, tolerance: float) -> str:
        """How many elements are violated by more than the tolerance, in words; empty if none."""
        count = int((violation > tolerance).sum())
        if not count:
            return ""
        return (
            f"{self.name}: {count} of {len(violation)} {self.complaint}, "
            f"by {violation.max():.2g} at most"
        )


S_co = TypeVar("S_co", bound=Structure, covariant=True)


@dataclass(frozen=True)
class UnrolledStructure(Generic[S_co]):
    """A structure at all nodes of one stage; an element is a label at a node, labels fastest.

    Attributes:
        structure: what is to hold.
        nodes: (nodes,) of the tree.
        matrices: per argument, its coefficients (n, columns of the whole program).
        consts: per argument, its constants (n,).
        limits: those of the structure, (n,) each.
    """

    structure: S_co
    nodes: Ints
    matrices: tuple[sp.csr_array, ...]
    consts: tuple[Floats, ...]
    limits: tuple[Floats, ...]

    @property
    def name(self) -> str:
        """Name of the structure."""
        return self.structure.name

    @property
    def labels(self) -> Labels:
        """Labels of the structure."""
        return self.structure.labels

    @property
    def n(self) -> int:
        """Number of elements."""
        return len(self.labels) * len(self.nodes)

    def values(self, z: Floats) -> list[Floats]:
        """Each argument at z, arrays (n,)."""
        return [m @ z + c for m, c in zip(self.matrices, self.consts, strict=True)]

    def violation(self, z: Floats) -> Floats:
        """(n,) scaled distance of each element from holding at z."""
        return self.structure.violation(self.values(z), self.limits)

    def elements(self, index: Ints) -> UnrolledStructure[S_co]:
        """Some of the elements; `nodes` stays as it is and no longer counts them."""
        return UnrolledStructure(
            self.structure,
            self.nodes,
            tuple(m[index] for m in self.matrices),
            tuple(c[index] for c in self.consts),
            tuple(limit[index] for limit in self.limits),
        )

    @cached_property
    def columns(self) -> Ints:
        """(arguments, n) column of each argument, where every argument is one plain column."""
        plain = [(np.diff(m.indptr) == 1).all() and (m.data == 1.0).all() for m in self.matrices]
        if not all(plain) or any(const.any() for const in self.consts):
            raise ValueError(f"the arguments of {self.name!r} are not plain columns")
        return np.array([m.indices for m in self.matrices], np.intp)


@dataclass(frozen=True)
class BinaryRows:
    """Rows  sum_k values[k] * z[columns[k]] <= right, or == right, element by element.

    Attributes:
        columns: per term, (n,) columns; those behind the program's own are new binaries.
        values: per term, (n,) coefficients, or one number for all elements.
        right: (n,).
        equality: whether the rows are equations.
    """

    columns: Sequence[Ints]
    values: Sequence[Floats | float]
    right: Floats
    equality: bool = False


class Mode(Structure):
    """A structure whose arguments are plain columns >= 0, only some of which may be positive.

    Which of them is the mode. Binaries choose it exactly; without them it is relaxed. A mode that
    is known is held by bounds of zero.
    """

    @abstractmethod
    def binaries(
        self, columns: Ints, limits: Sequence[Floats], width: int
    ) -> tuple[int, list[BinaryRows]]:
        """The exact rewrite of n elements: number of new binaries, and rows over them.

        Args:
            columns: (arguments, n).
            limits: (n,) each.
            width: number of columns so far; the first new binary is the column of that number.
        """

    @abstractmethod
    def idle_columns(self, columns: Ints, values: Floats) -> Ints:
        """Columns to hold at zero so that n elements keep to the mode in which they nearly are.

        Args:
            columns: (arguments, n).
            values: (arguments, n) of the columns.
        """

    @abstractmethod
    def sides(self, columns: Ints, values: Floats) -> tuple[Ints, Ints]:
        """Two sets of columns, one of which is zero in whatever mode one element is, unlike now.

        Args:
            columns: (arguments,) of the element.
            values: (arguments,) of the columns; they are in two modes at once.

        Returns:
            First those whose values are smaller, to branch on first.
        """


class SecondOrder(Structure):
    """A structure that is, or is relaxed to, `|(x1, x2, ...)| <= t` with affine x and t."""

    @abstractmethod
    def second_order(
        self, unrolled: UnrolledStructure[Structure]
    ) -> tuple[list[sp.csr_array], list[Floats]]:
        """t, x1, x2, ... as matrices (n, columns) and constants (n,)."""

    @abstractmethod
    def tangents(
        self, unrolled: UnrolledStructure[Structure], z: Floats
    ) -> tuple[sp.csr_array, Floats]:
        """Rows G z <= h, one per element, that hold wherever it does and touch it nearest to z."""
