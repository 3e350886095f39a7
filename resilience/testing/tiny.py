"""Programs small enough to solve on paper, and what the answer is.

Every program says which structures it needs. A backend that holds them all must reach `optimum`;
one that relaxes some of them must prove a bound no higher, and `relaxed` where that is known too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, field
from typing import Any

from resilience.models.language.stage import Stage
from resilience.models.language.tree import Cut, Tree
from resilience.models.program.standard import Standard, Vectors
from resilience.models.program.unroll import unroll
from resilience.models.structures import Structure

Values = Mapping[str, Any]


@dataclass(frozen=True)
class TinyProgram:
    """A program, its data, and its optimum.

    Attributes:
        name: of the program.
        standard: the program in standard form.
        optimum: $, derived on paper.
        needs: structures in it.
        data: (labels, nodes) by name.
        x0: (labels,) states at the start, by name.
        relaxed: $, optimum of the linear or conic relaxation; None where nothing is relaxed or it
            is not known.
        integers: whether it has some.
    """

    name: str
    standard: Standard
    optimum: float
    needs: Set[type[Structure]] = frozenset()
    data: Values = field(default_factory=dict)
    x0: Values = field(default_factory=dict)
    relaxed: float | None = None
    integers: bool = False

    @property
    def vectors(self) -> Vectors:
        """The program's numbers for its data."""
        return self.standard.vectors(self.data, self.x0)

    def __str__(self) -> str:
        return self.name


TINY: dict[str, Callable[..., TinyProgram]] = {}
"""What builds each tiny program, by name; some take other data as keywords."""


def tiny_program(build: Callable[..., TinyProgram]) -> Callable[..., TinyProgram]:
    """Adds a program to `TINY` under the name of its function."""
    TINY[build.__name__] = build
    return build


def one_node(stage: Stage, cuts: Sequence[Cut] = ()) -> Standard:
    """A stage as a program of its own."""
    return unroll([stage], Tree.chain(["now"]), cuts)
