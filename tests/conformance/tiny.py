"""Problems small enough to solve on paper, and what the answer is.

Every problem says which structures it needs. A backend that holds them all must find `optimum`;
one that relaxes some of them must find a bound no higher, and `relaxed` where that is known too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from resilience.models.language.stage import Stage
from resilience.models.language.tree import Tree
from resilience.models.program.standard import Standard
from resilience.models.program.unroll import unroll

Values = Mapping[str, Any]


@dataclass(frozen=True)
class Tiny:
    """A problem, its data, and its optimum in $."""

    name: str
    problem: Standard
    optimum: float
    needs: frozenset[str] = frozenset({"affine"})
    data: Values = field(default_factory=dict)
    x0: Values = field(default_factory=dict)
    relaxed: float | None = None  # optimum of the linear or conic relaxation, where another

    def __str__(self) -> str:
        return self.name


TINY: dict[str, Callable[[], Tiny]] = {}


def tiny(build: Callable[..., Tiny]) -> Callable[..., Tiny]:
    """Adds a problem to the list under the name of its function."""
    TINY[build.__name__] = build
    return build


def one_node(stage: Stage, **more: Any) -> Standard:
    return unroll([stage], Tree.chain(["now"]), **more)
