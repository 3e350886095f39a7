"""The conic relaxation of a case as a cvxpy problem, for whoever wants to add to it in code."""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from resilience.models.case_program import horizon
from resilience.models.program.standard import Standard, Vectors
from resilience.models.structures import Cone, Disc

if TYPE_CHECKING:
    from resilience.case import Case
    from resilience.models.microgrid import Physics


@dataclass(frozen=True)
class CvxpyModel:
    """A case's horizon in cvxpy: rows and discs as they are, cones as u v >= sum(x^2).

    Integers, modes of storage and angles around loops are left out, so its optimum is a bound of
    `solve` with the same physics, and the bound of `--method socp` but for the rows that it adds on
    loops.

    Attributes:
        problem: the `cvxpy.Problem`; its value is in $, terminal credit taken off.
        z: its variable, (columns,).
        standard: which column is what.
    """

    problem: Any
    z: Any
    standard: Standard

    def __getitem__(self, name: str) -> Any:
        """A quantity as a cvxpy expression (labels, slots), as `model["ess.charge"]`.

        Raises:
            KeyError: there is none of that name; `standard.names()` has them.
        """
        columns = self.standard.columns(name)
        return importlib.import_module("cvxpy").reshape(
            self.z[columns.ravel()], columns.shape, order="C"
        )


def cvxpy_model(case: Case, physics: Physics = "distflow") -> CvxpyModel:
    """The horizon of a case, its outages known, as a cvxpy problem that is solved or extended.

    Args:
        case: the case.
        physics: copperplate, lindistflow or distflow.
    """
    program = horizon(case, physics)
    return stated(program.standard, program.vectors)


def stated(standard: Standard, v: Vectors) -> CvxpyModel:
    """A program in cvxpy, unscaled and with nothing substituted."""
    cp: Any = importlib.import_module("cvxpy")
    z = cp.Variable(standard.n_columns)
    equal = np.isfinite(v.row_lower)
    low, high = np.isfinite(v.lower), np.isfinite(v.upper)
    rows = [
        standard.a[equal] @ z == v.row_upper[equal],
        standard.a[~equal] @ z <= v.row_upper[~equal],
        z[low] >= v.lower[low],
        z[high] <= v.upper[high],
    ]
    for disc in standard.structures_of(Disc).values():
        xs = [m @ z + c for m, c in zip(disc.matrices, disc.consts, strict=True)]
        rows.append(cp.SOC(cp.Constant(disc.limits[0]), cp.vstack(xs), axis=0))
    for cone in standard.structures_of(Cone).values():
        u, w, *xs = [m @ z + c for m, c in zip(cone.matrices, cone.consts, strict=True)]
        rows.append(cp.SOC(u + w, cp.vstack([*(2.0 * x for x in xs), u - w]), axis=0))
    return CvxpyModel(cp.Problem(cp.Minimize(v.cost @ z + v.offset), rows), z, standard)
