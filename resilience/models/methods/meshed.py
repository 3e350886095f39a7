"""A program with rows on the cliques of its loops: what conic methods see of a mesh."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, wraps

from resilience.models.case_program import CaseProgram
from resilience.models.methods.answer import MethodOptions, MethodResult
from resilience.models.program.cliques import Cliques
from resilience.models.program.standard import Vectors


@dataclass(frozen=True)
class MeshedProgram(CaseProgram):
    """A case's program with the fill of its cliques behind its columns.

    Attributes:
        numbers: its cost, bounds and sides.
        rows_on_loops: its cliques, and the rows found so far.
    """

    numbers: Vectors | None = None
    rows_on_loops: Cliques | None = None

    @cached_property
    def vectors(self) -> Vectors:
        """Cost, bounds and right-hand sides, fill included."""
        assert self.numbers is not None
        return self.numbers

    @property
    def cliques(self) -> Cliques | None:
        """See the attributes."""
        return self.rows_on_loops


def with_cliques(
    method: Callable[[CaseProgram, MethodOptions], MethodResult],
) -> Callable[[CaseProgram, MethodOptions], MethodResult]:
    """A method that sees the cliques of a mesh, and answers without their fill."""

    @wraps(method)
    def widened(program: CaseProgram, options: MethodOptions) -> MethodResult:
        cliques = Cliques.of_program(program.standard, program.vectors)
        if cliques is None:
            return method(program, options)
        standard, vectors = cliques.widened(program.standard, program.vectors)
        fields = {f: getattr(program, f) for f in CaseProgram.__dataclass_fields__}
        fields["standard"] = standard
        answer = method(MeshedProgram(**fields, numbers=vectors, rows_on_loops=cliques), options)
        return replace(answer, z=answer.z[: cliques.n_columns])

    return widened
