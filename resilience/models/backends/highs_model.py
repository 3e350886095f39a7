"""The model object of HiGHS: all that the package knows of highspy stands here.

Arrays go in as they are, solutions come out as arrays, multipliers with the sign of our Lagrangian
c'z + y'(A z - b). Nothing is remembered beside the model itself: a call costs what highspy takes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import Any, NewType

import highspy
import numpy as np
import numpy.typing as npt
import scipy.sparse as sp

from resilience.arrays import Bools, Floats, Ints
from resilience.models.backends.highs_scale import Scale
from resilience.models.program.standard import Vectors

Option = bool | int | float | str
Basis = NewType("Basis", object)
"""Which columns and rows are basic; only for `HighsModel.set_basis`."""

# Measured by `python -m bench`: coefficients in pu and MW need no scaling, few pivots no steepest
# edges.
LINEAR_OPTIONS: dict[str, Option] = {
    "simplex_scale_strategy": 0,
    "simplex_dual_edge_weight_strategy": 1,
}
# From a basis, perturbed costs and a stale factorisation cost more pivots than they save; from
# scratch the perturbation is what keeps a large program from stalling.
WARM_OPTIONS: dict[str, Option] = {
    "dual_simplex_cost_perturbation_multiplier": 0.0,
    "no_unnecessary_rebuild_refactor": False,
}
# An integer off by 1e-6 opens a row of coefficient 1e3 by 1e-3, and presolve then cuts optima off:
# HiGHS 1.15 proves 505.23 where 503.80 is right (`tests/property/test_formed_islands.py`, 96).
TREE_OPTIONS: dict[str, Option] = {"mip_feasibility_tolerance": 1e-9}
_ROWWISE = int(highspy.MatrixFormat.kRowwise)
_MINIMIZE = int(highspy.ObjSense.kMinimize)
_HAS_POINT = 2  # of `primal_solution_status`
AT_LOWER: object = highspy.HighsBasisStatus.kLower
BASIC: object = highspy.HighsBasisStatus.kBasic
AT_UPPER: object = highspy.HighsBasisStatus.kUpper
Statuses = npt.NDArray[np.object_]
"""Of columns or rows in a basis: one of the three above, or what HiGHS has beside them."""


class RunStatus(Enum):
    """How a run of HiGHS ended."""

    OPTIMAL = auto()
    INFEASIBLE = auto()
    UNBOUNDED = auto()
    AMBIGUOUS = auto()
    """Infeasible or unbounded; presolve cannot tell which."""
    STOPPED = auto()
    """By a limit, or by trouble; `HighsModel.status_text` says which."""


_STATUS = {
    highspy.HighsModelStatus.kOptimal: RunStatus.OPTIMAL,
    highspy.HighsModelStatus.kInfeasible: RunStatus.INFEASIBLE,
    highspy.HighsModelStatus.kUnbounded: RunStatus.UNBOUNDED,
    highspy.HighsModelStatus.kUnboundedOrInfeasible: RunStatus.AMBIGUOUS,
}


@dataclass(frozen=True)
class RunInfo:
    """What the last run says of itself.

    Attributes:
        has_point: whether there is a feasible point.
        objective: at that point.
        mip_bound: dual bound of a tree search.
    """

    has_point: bool
    objective: float
    mip_bound: float


class RunSolution:
    """The point of the last run, each array copied when it is asked for."""

    def __init__(self, solution: Any, scale: Scale | None) -> None:
        self._solution, self._scale = solution, scale

    @property
    def values(self) -> Floats:
        """(columns,) the point."""
        values, scale = _array(self._solution.col_value), self._scale
        return values if scale is None else values * scale.columns

    @property
    def reduced_costs(self) -> Floats:
        """(columns,) what one more unit of each column costs."""
        prices, scale = _array(self._solution.col_dual), self._scale
        return prices if scale is None else prices * (scale.cost / scale.columns)

    @property
    def multipliers(self) -> Floats:
        """(rows,) of the Lagrangian c'z + y'(A z - b)."""
        duals, scale = -_array(self._solution.row_dual), self._scale
        return duals if scale is None else duals * (scale.cost / scale.rows)


class HighsModel:
    """One linear or mixed-integer program within HiGHS, silent.

    HiGHS may hold it in other units; all that goes in and comes out is in those of the caller.

    Args:
        options: of HiGHS, by their names.
    """

    def __init__(self, options: Mapping[str, Option]) -> None:
        self._scale: Scale | None = None
        self._highs: Any = highspy.Highs()  # type: ignore[no-untyped-call]
        self._highs.silent()
        self.set_options(options)

    def set_options(self, options: Mapping[str, Option]) -> None:
        """Sets options of HiGHS by their names."""
        for name, value in options.items():
            self._highs.setOptionValue(name, value)

    def option(self, name: str) -> Option:
        """An option of HiGHS."""
        _, value = self._highs.getOptionValue(name)
        return value

    def limit_time(self, seconds: float) -> None:
        """Gives the next run so many seconds; HiGHS counts those of all runs together."""
        self._highs.setOptionValue("time_limit", self._highs.getRunTime() + seconds)

    def load(
        self,
        a: sp.csr_array,
        v: Vectors,
        integer: Bools | None = None,
        scale: Scale | None = None,
    ) -> None:
        """Takes a program in place of whatever there was.

        Args:
            a: (rows, columns).
            v: cost, bounds and sides of its columns and rows.
            integer: (columns,) which are integer; none if omitted.
            scale: the units to hold it in; those of the arrays if omitted.
        """
        self._scale = scale
        if scale is not None:
            a, v = scale.matrix(a), scale.vectors(v)
        integrality = np.zeros(a.shape[1], np.int32) if integer is None else _ints(integer)
        self._highs.passModel(
            a.shape[1],
            a.shape[0],
            a.nnz,
            _ROWWISE,
            _MINIMIZE,
            v.offset,
            v.cost,
            v.lower,
            v.upper,
            v.row_lower,
            v.row_upper,
            _ints(a.indptr),
            _ints(a.indices),
            a.data,
            integrality,
        )

    def add_columns(self, cost: Floats, lower: Floats, upper: Floats) -> None:
        """Adds columns in $ that stand in no row yet."""
        none = np.empty(0, np.int32)
        if self._scale is not None:
            self._scale = self._scale.with_money_columns(len(cost))
            lower, upper = lower / self._scale.cost, upper / self._scale.cost
        self._highs.addCols(len(cost), cost, lower, upper, 0, none, none, np.empty(0))

    def add_rows(
        self, columns: Ints, values: Floats, lower: Floats | float, upper: Floats | float
    ) -> None:
        """Adds rows of k entries each; the basis is kept.

        Args:
            columns: (rows, k).
            values: (rows, k) coefficients.
            lower: (rows,), or one for all.
            upper: (rows,), or one for all.
        """
        n, k = columns.shape
        entries = (values.ravel(), columns.ravel(), k * np.arange(n + 1))
        block = sp.csr_array(entries, shape=(n, self._highs.getNumCol()))
        self.add_matrix(block, np.full(n, lower, float), np.full(n, upper, float))

    def add_matrix(self, block: sp.csr_array, lower: Floats, upper: Floats) -> None:
        """Adds rows  lower <= block z <= upper; the basis is kept."""
        if self._scale is not None:
            more = self._scale.with_rows(block)
            units = more.rows[len(self._scale.rows) :]
            block = replace(more, rows=units).matrix(block)
            self._scale, lower, upper = more, lower / units, upper / units
        starts, columns = _ints(block.indptr[:-1]), _ints(block.indices)
        self._highs.addRows(block.shape[0], lower, upper, block.nnz, starts, columns, block.data)

    def change_bounds(self, columns: Ints, lower: Floats, upper: Floats) -> None:
        """Changes the bounds of some columns."""
        if self._scale is not None:
            units = self._scale.columns[columns]
            lower, upper = lower / units, upper / units
        self._highs.changeColsBounds(len(columns), _ints(columns), lower, upper)

    def change_sides(self, rows: Ints, lower: Floats, upper: Floats) -> None:
        """Changes the sides of some rows."""
        if self._scale is not None:
            units = self._scale.rows[rows]
            lower, upper = lower / units, upper / units
        self._highs.changeRowsBounds(len(rows), _ints(rows), lower, upper)

    def change_costs(self, columns: Ints, cost: Floats) -> None:
        """Changes the costs of some columns."""
        if self._scale is not None:
            cost = cost * self._scale.columns[columns] / self._scale.cost
        self._highs.changeColsCost(len(columns), _ints(columns), cost)

    def change_offset(self, offset: float) -> None:
        """Changes the constant of the objective."""
        self._highs.changeObjectiveOffset(offset / self._cost)

    def change_coefficient(self, row: int, column: int, value: float) -> None:
        """Changes one coefficient of the matrix."""
        if self._scale is not None:
            value *= self._scale.columns[column] / self._scale.rows[row]
        self._highs.changeCoeff(row, column, value)

    def run(self) -> RunStatus:
        """Solves, from the basis there is."""
        self._highs.run()
        return _STATUS.get(self._highs.getModelStatus(), RunStatus.STOPPED)

    @property
    def status_text(self) -> str:
        """How the last run ended, in the words of HiGHS."""
        return str(self._highs.modelStatusToString(self._highs.getModelStatus()))

    @property
    def is_out_of_time(self) -> bool:
        """Whether the last run was ended by its time limit."""
        return bool(self._highs.getModelStatus() == highspy.HighsModelStatus.kTimeLimit)

    @property
    def info(self) -> RunInfo:
        """What the last run says of itself."""
        info = self._highs.getInfo()
        return RunInfo(
            info.primal_solution_status == _HAS_POINT,
            info.objective_function_value * self._cost,
            info.mip_dual_bound * self._cost,
        )

    @property
    def solution(self) -> RunSolution:
        """The point of the last run."""
        return RunSolution(self._highs.getSolution(), self._scale)

    @property
    def _cost(self) -> float:
        """What one unit of the objective is, $."""
        return 1.0 if self._scale is None else self._scale.cost

    @property
    def basis(self) -> Basis:
        """The basis of the last run."""
        return Basis(self._highs.getBasis())

    def set_basis(self, basis: Basis) -> None:
        """Lets the next run start from a basis."""
        self._highs.setBasis(basis)

    @property
    def statuses(self) -> tuple[list[object], list[object]]:
        """Of the last run's basis, column by column and row by row."""
        basis = self._highs.getBasis()
        return basis.col_status, basis.row_status

    def forget(self) -> None:
        """Lets the next run start from nothing."""
        self._highs.clearSolver()

    def set_start(self, columns: Ints, values: Floats) -> None:
        """Hands a tree search the values of some columns to begin from."""
        if self._scale is not None:
            values = values / self._scale.columns[columns]
        self._highs.setSolution(len(columns), _ints(columns), values)

    def conflict(self, seconds: float) -> tuple[list[int], list[int]]:
        """Rows and columns that together admit no point; none if none were found in that time."""
        self.set_options({"iis_strategy": 2, "iis_time_limit": seconds})
        _, iis = self._highs.getIis()
        return list(iis.row_index_), list(iis.col_index_)

    def relaxed_point(self, penalty: Floats) -> Floats:
        """(columns,) where rows are missed by as little as can be, penalty (rows,) $ per unit.

        A row with a negative penalty, and every bound, has to hold.
        """
        self._highs.feasibilityRelaxation(-1.0, -1.0, 1.0, None, None, penalty)
        return self.solution.values


def basis_of(columns: Statuses, rows: Statuses) -> Basis:
    """A basis of the statuses of columns and rows, as many `BASIC` as there are rows."""
    basis = highspy.HighsBasis()
    basis.col_status, basis.row_status = columns.tolist(), rows.tolist()
    basis.valid = True
    return Basis(basis)


def _ints(values: Any) -> Any:
    return np.asarray(values, np.int32)


def _array(values: list[float]) -> Floats:
    return np.fromiter(values, np.float64, len(values))
