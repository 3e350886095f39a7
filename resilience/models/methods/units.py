"""A program in units of its own size: what solvers and tests of facts see.

Solvers hold rows, discs and cones to absolute tolerances, 1e-8 to 1e-6. In MW these are nothing to
a town and everything to a farm; in $ they hide a tariff of 1e-6 $/kWh. So a method is given the
program with powers and energies in a base of its own, a power of ten near the largest power in the
case, and with its objective divided by the largest cost of a column. The answer is scaled back, the
bound with it. Where both are of the order of one already, as in a feeder in MW and $, the program
stays as it is.
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
from resilience.models.structures import Structure, UnrolledStructure

POWERS_OF_BASE = {"MW": 1, "Mvar": 1, "MWh": 1, "pu": 2}
"""By unit of a variable, with which power of the base it grows; `pu` is a squared current."""
COST_UNITS = ("$", "$/h")
USUAL_MW = 0.1, 1000.0
"""Largest powers between which MW are the right unit."""
USUAL_COST = 0.1, 1e5
"""Largest costs of a column, $, between which $ are the right unit."""


@dataclass(frozen=True)
class Units:
    """What one unit of a program is.

    Attributes:
        base_mw: of power, MW; of energy, MWh.
        cost: of the objective, $.
    """

    base_mw: float = 1.0
    cost: float = 1.0

    @classmethod
    def of_program(cls, program: CaseProgram) -> Units:
        """Those that suit a program: powers of ten, 1 where that is near enough."""
        standard, v = program.standard, program.vectors
        ends = np.maximum(*(np.where(np.isfinite(x), np.abs(x), 0.0) for x in (v.lower, v.upper)))
        powers = [
            standard.columns(block.name).ravel()
            for block in standard.form.own_blocks
            if POWERS_OF_BASE.get(block.unit) == 1
        ]
        largest_mw = float(ends[np.concatenate(powers)].max(initial=0.0)) if powers else 0.0
        base = _power_of_ten(largest_mw, USUAL_MW)
        scale = column_scale(standard, cls(base))
        inside = np.ones(standard.n_columns, bool)
        inside[standard.future] = False
        largest_cost = float(np.abs(v.cost * scale)[inside].max(initial=0.0))
        return cls(base, _power_of_ten(largest_cost, USUAL_COST))


def _power_of_ten(size: float, usual: tuple[float, float]) -> float:
    """The greatest up to `size`; 1 where that is nothing, or as usual."""
    if size == 0.0 or usual[0] <= size <= usual[1]:
        return 1.0
    return float(10.0 ** np.floor(np.log10(size)))


def column_scale(standard: Standard, units: Units) -> Floats:
    """(columns,) what one unit of a column is, in MW, MWh, $ and so on."""
    scale = np.ones(standard.n_columns)
    scale[standard.future] = units.cost
    for block in standard.form.own_blocks:
        of_block = units.base_mw ** POWERS_OF_BASE.get(block.unit, 0)
        scale[standard.columns(block.name)] = units.cost if block.unit in COST_UNITS else of_block
    for name, columns in standard.initial.items():
        scale[columns] = units.base_mw ** POWERS_OF_BASE.get(standard.form.block(name).unit, 0)
    return scale


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
    """

    rescaled: Vectors | None = None

    @cached_property
    def vectors(self) -> Vectors:
        """Cost, bounds and right-hand sides, in its units."""
        assert self.rescaled is not None
        return self.rescaled


def rescaled(program: CaseProgram, units: Units) -> tuple[CaseProgram, Floats]:
    """A program in other units, and what one unit of each of its columns (columns,) is.

    Every row is divided by its largest coefficient.
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
    return RescaledProgram(**of_program, rescaled=numbers), scale


def _structure(
    unrolled: UnrolledStructure[Structure], scale: Floats
) -> UnrolledStructure[Structure]:
    """A structure with every argument, and the limit that belongs to it, in its columns' unit."""
    units = [float(scale[m.indices].max(initial=0.0)) or 1.0 for m in unrolled.matrices]
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
        units = Units.of_program(program)
        if units == Units():
            return method(program, options)
        inner, scale = rescaled(program, units)
        answer = method(inner, options)
        return replace(
            answer,
            z=np.clip(answer.z * scale, program.vectors.lower, program.vectors.upper),
            objective=answer.objective * units.cost,
            bound=answer.bound * units.cost,
        )

    return scaled
