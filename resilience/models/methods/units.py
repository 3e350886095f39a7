"""A program in units of its own size: what solvers and tests of facts see.

A method is given the program in the `Units` that suit it, each column in its own. The answer is
scaled back, the bound with it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, wraps

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats
from resilience.models.case_program import CaseProgram
from resilience.models.methods.answer import MethodOptions, MethodResult
from resilience.models.program.standard import Standard, Vectors
from resilience.models.program.units import Units, column_scale
from resilience.models.structures import Structure, UnrolledStructure


@dataclass(frozen=True)
class RescaledStandard(Standard):
    """A program in other units.

    Attributes:
        base_mw: of the penalty on losses, MW.
    """

    base_mw: float = 1.0

    @cached_property
    def penalty(self) -> Floats:
        """(columns,) losses in the base, as the weights of the original are losses in MW."""
        return super().penalty * self.base_mw


@dataclass(frozen=True)
class RescaledProgram(CaseProgram):
    """A case's program in other units.

    Attributes:
        rescaled: its numbers.
        original: the program in MW and $.
        scale: (columns,) what one unit of each column is.
        units: likewise of everything.
    """

    rescaled: Vectors | None = None
    original: CaseProgram | None = None
    scale: Floats | None = None
    units: Units | None = None

    @property
    def in_mw(self) -> CaseProgram:
        """The original."""
        assert self.original is not None
        return self.original

    @property
    def column_unit(self) -> Floats | float:
        """(columns,) what one unit of each column is."""
        assert self.scale is not None
        return self.scale

    @property
    def cost_unit(self) -> float:
        """What one unit of its cost is, $."""
        assert self.units is not None
        return self.units.cost

    @cached_property
    def vectors(self) -> Vectors:
        """Cost, bounds and right-hand sides, in its units."""
        assert self.rescaled is not None
        return self.rescaled


def rescaled(program: CaseProgram, units: Units) -> tuple[CaseProgram, Floats, Floats]:
    """A program in other units, what one unit of its columns is, and what rows are multiplied by.

    Every row is divided by its largest coefficient.

    Returns:
        The program, (columns,), and (rows,).
    """
    standard, v = program.standard, program.vectors
    scale = column_scale(standard, units)
    a = sp.csr_array(standard.a.multiply(scale[None, :]))
    largest = abs(a).max(axis=1).toarray().ravel()
    rows = 1.0 / np.where(largest > 0.0, largest, 1.0)
    fields = {f: getattr(standard, f) for f in Standard.__dataclass_fields__}
    fields["a"] = sp.csr_array(a.multiply(rows[:, None]))
    fields["structures"] = tuple(_structure(s, scale) for s in standard.structures)
    numbers = Vectors(
        v.cost * scale / units.cost,
        v.offset / units.cost,
        v.lower / scale,
        v.upper / scale,
        v.row_lower * rows,
        v.row_upper * rows,
    )
    of_program = {f: getattr(program, f) for f in CaseProgram.__dataclass_fields__}
    of_program["standard"] = RescaledStandard(**fields, base_mw=units.base_mw)
    changed = RescaledProgram(
        **of_program, rescaled=numbers, original=program, scale=scale, units=units
    )
    return changed, scale, rows


def _structure(
    unrolled: UnrolledStructure[Structure], scale: Floats
) -> UnrolledStructure[Structure]:
    """A structure with every argument, and the limit that belongs to it, in its columns' unit."""
    units = [float(scale[m.indices].max(initial=0.0)) or 1.0 for m in unrolled.matrices]
    if unrolled.structure.dimensionless:
        units = [1.0 for _ in units]
    return replace(
        unrolled,
        matrices=tuple(
            sp.csr_array(m.multiply(scale[None, :]) / unit)
            for m, unit in zip(unrolled.matrices, units, strict=True)
        ),
        consts=tuple(c / unit for c, unit in zip(unrolled.consts, units, strict=True)),
        limits=tuple(limit / unit for limit, unit in zip(unrolled.limits, units, strict=False)),
    )


def in_own_units(
    method: Callable[[CaseProgram, MethodOptions], MethodResult],
) -> Callable[[CaseProgram, MethodOptions], MethodResult]:
    """A method that solves a program in its own units and answers in those it was given."""

    @wraps(method)
    def scaled(program: CaseProgram, options: MethodOptions) -> MethodResult:
        units = Units.of_program(program.standard, program.vectors)
        if units == Units():
            return method(program, options)
        inner, scale, _ = rescaled(program, units)
        answer = method(inner, options)
        return replace(
            answer,
            z=np.clip(answer.z * scale, program.vectors.lower, program.vectors.upper),
            objective=answer.objective * units.cost,
            bound=answer.bound * units.cost,
        )

    return scaled
