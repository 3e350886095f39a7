"""Pyomo: the readable and exportable form, the oracle of the others, and the way to SCIP."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Literal

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Floats
from resilience.errors import UsageError
from resilience.models.backends.base import (
    NOTHING,
    LeafCuts,
    Solution,
    failures_of,
    of_solver,
    refuse_unknown,
)
from resilience.models.backends.lower import Lowered, lower
from resilience.models.program.standard import Standard, Vectors
from resilience.models.structures import (
    Adjacent,
    Angle,
    Cone,
    Disc,
    Largest,
    SecondOrder,
    Split,
    Structure,
    UnrolledStructure,
)

Cones = Literal["equal", "relaxed"]
FORMATS = {".lp": "lp", ".mps": "mps", ".nl": "nl"}


class Pyomo:
    """Holds everything exactly with SCIP; with HiGHS, discs are polygons and cones not allowed.

    Variables are called after the model, `ess_charge[ess2,14:30]`, and so are constraints.

    Args:
        standard: the program, or one already lowered with a choice of what is relaxed.
        solver: 'highs' (persistent) or 'scip'.
        cones: 'relaxed' holds u v >= sum(x^2) only, which is convex.
        time_limit: seconds per solve.
        gap: relative gap at which a solve stops.
    """

    exact: frozenset[type[Structure]] = frozenset({Split, Cone, Angle, Disc, Adjacent, Largest})
    integers = True

    def __init__(
        self,
        standard: Standard | Lowered,
        *,
        solver: Literal["highs", "scip"] = "highs",
        cones: Cones = "equal",
        time_limit: float = np.inf,
        gap: float = 1e-6,
    ) -> None:
        self.lowered = standard if isinstance(standard, Lowered) else lower(standard)
        self.standard, self.solver, self.cones = self.lowered.standard, solver, cones
        self.time_limit, self.gap = time_limit, gap
        refuse_unknown(self.standard, "pyomo", Pyomo.exact)
        if solver == "highs" and self.standard.structures_of(Cone):
            raise UsageError(
                "pyomo with HiGHS cannot hold the cones of distflow; allowed: lindistflow, "
                "copperplate",
                hint="use solver='scip'",
            )
        if solver == "highs":
            self.exact = self.exact - {Cone, Angle, Disc}
        self._later_cuts = LeafCuts(self.standard)
        self.model: Any = None
        self._sent: Vectors | None = None
        self._persistent: Any = None

    def update(self, vectors: Vectors) -> None:
        """Takes new numbers; the model is built at the first call."""
        self.vectors = self._later_cuts.with_futures_open(vectors)
        v = self.lowered.vectors(self.vectors)
        old = self._sent
        if old is None:
            self._build(v)
        for i in _differing(old, v, "lower", "upper"):
            low, high = v.lower[i], v.upper[i]
            self._vars[i].setlb(low if low > -np.inf else None)
            self._vars[i].setub(high if high < np.inf else None)
        rhs, price = self.model.rhs, self.model.price
        for i in _differing(old, v, "row_upper"):
            if i in self._row_of:
                rhs[self._row_of[i]] = v.row_upper[i]
        for i in self._priced if old is None else _differing(old, v, "cost"):
            price[i] = v.cost[i]
        self.model.offset = v.offset
        self._sent = v

    def _build(self, v: Vectors) -> None:
        import pyomo.environ as pyo

        self.model = model = pyo.ConcreteModel("resilience")
        self._vars = self._columns(pyo)
        quadratic = self.solver == "scip"
        drop = set(len(self.standard.a.indptr) - 1 + self.lowered.disc_rows) if quadratic else set()
        rows = [i for i in range(self.lowered.a.shape[0]) if i not in drop]
        self._row_of = {i: j for j, i in enumerate(rows)}
        model.rhs = pyo.Param(range(len(self._row_of)), mutable=True, initialize=0.0)
        self._constraints(pyo, v)
        self._priced = self._priceable(v)
        model.price = pyo.Param(self._priced, mutable=True, initialize=0.0)
        model.offset = pyo.Param(mutable=True, initialize=0.0)
        spent = sum(model.price[i] * self._vars[i] for i in self._priced)
        model.cost = pyo.Objective(expr=spent + model.offset)
        if quadratic:
            self._quadratics(pyo)
            if self.cones == "equal":
                self._angles(pyo)

    def _priceable(self, v: Vectors) -> list[int]:
        """Columns that cost something now or may for other data."""
        priced = set(np.flatnonzero(v.cost).tolist())
        for stage in self.standard.copies:
            for term in stage.form.costs:
                with_data = np.flatnonzero(np.diff(term.columns_data.indptr))
                priced |= set(stage.columns[:, with_data].ravel().tolist())
        return sorted(priced)

    def _columns(self, pyo: Any) -> list[Any]:
        """Variables of the model, by column."""
        standard, model, slots = self.standard, self.model, list(self.standard.tree.labels)
        variables: list[Any] = [None] * self.lowered.a.shape[1]
        for name, columns in standard.initial.items():
            var = pyo.Var(list(standard.labels(name)), domain=pyo.Reals)
            model.add_component(_plain(name) + "_start", var)
            for label, j in zip(standard.labels(name), columns, strict=True):
                variables[j] = var[label]
        model.future = pyo.Var(range(len(standard.future)), domain=pyo.Reals)
        for k, j in enumerate(standard.future):
            variables[j] = model.future[k]
        for name in standard.names:
            index = standard.columns(name)
            domain = pyo.Reals
            if standard.integer[index].any():
                binary = standard.form.block(name).kind == "binary"
                domain = pyo.Binary if binary else pyo.Integers
            var = pyo.Var(list(standard.labels(name)), slots, domain=domain)
            model.add_component(_plain(name), var)
            for label, row in zip(standard.labels(name), index, strict=True):
                for slot, j in zip(slots, row, strict=True):
                    variables[j] = var[label, slot]
        added = range(standard.n_columns, len(variables))
        model.mode = pyo.Var(added, domain=pyo.Binary)
        for j in added:
            variables[j] = model.mode[j]
        return variables

    def _constraints(self, pyo: Any, v: Vectors) -> None:
        from pyomo.core.expr import LinearExpression

        a, model = self.lowered.a.tocsr(), self.model
        equality = np.concatenate([self.standard.equality, self.lowered.equality])
        ranged = set((self.standard.n_rows + self.lowered.disc_rows).tolist())
        blocks: dict[str, dict[str, Any]] = {}
        for i, j in self._row_of.items():
            entries = slice(a.indptr[i], a.indptr[i + 1])
            variables = [self._vars[k] for k in a.indices[entries]]
            body = LinearExpression(linear_coefs=a.data[entries].tolist(), linear_vars=variables)
            rhs = model.rhs[j]
            name, _, index = self._row_name(i).partition("[")
            if i in ranged:
                row = pyo.inequality(v.row_lower[i], body, rhs)
            else:
                row = body == rhs if equality[i] else body <= rhs
            blocks.setdefault(name, {})[index.rstrip("]")] = row
        for name, bodies in blocks.items():
            rows = pyo.Constraint(list(bodies), rule=lambda _, k, b=bodies: b[k])
            model.add_component("row_" + _plain(name), rows)

    def _row_name(self, i: int) -> str:
        n = self.standard.n_rows
        return self.standard.row_name(i) if i < n else f"lowered[{i - n}]"

    def _quadratics(self, pyo: Any) -> None:
        statements = {Cone: self._cone, Disc: self._disc}
        for k, unrolled in self.standard.structures_of(SecondOrder).items():
            kind = type(unrolled.structure)
            rows = pyo.ConstraintList()
            self.model.add_component(f"{kind.title}{k}_{_plain(unrolled.name)}", rows)
            args = [self._expressions(unrolled, m) for m in range(len(unrolled.matrices))]
            for i in range(unrolled.n):
                limits = [limit[i] for limit in unrolled.limits]
                rows.add(statements[kind]([arg[i] for arg in args], limits))

    def _angles(self, pyo: Any) -> None:
        for k, unrolled in self.standard.structures_of(Angle).items():
            rows = pyo.ConstraintList()
            self.model.add_component(f"angle{k}_{_plain(unrolled.name)}", rows)
            args = [self._expressions(unrolled, m) for m in range(3)]
            for theta, re, im in zip(*args, strict=True):
                rows.add(im * pyo.cos(theta) == re * pyo.sin(theta))
                rows.add(re * pyo.cos(theta) + im * pyo.sin(theta) >= 0.0)
                rows.add(re >= 0.0)
                rows.add((-0.5 * math.pi, theta, 0.5 * math.pi))

    def _cone(self, args: list[Any], limits: list[float]) -> Any:
        u, v, *xs = args
        square = sum(x**2 for x in xs)
        return u * v == square if self.cones == "equal" else square <= u * v

    def _disc(self, args: list[Any], limits: list[float]) -> Any:
        # Relative to the rating: SCIP holds rows to 1e-6, which is more than the square of 1 kVA.
        radius = limits[0] or 1.0
        return sum((x / radius) ** 2 for x in args) <= (limits[0] / radius) ** 2

    def _expressions(self, unrolled: UnrolledStructure[Structure], k: int) -> list[Any]:
        """One expression per element for the k-th argument."""
        m: sp.csr_array = unrolled.matrices[k]
        expressions = []
        for i in range(unrolled.n):
            entries = slice(m.indptr[i], m.indptr[i + 1])
            terms = zip(m.data[entries], m.indices[entries], strict=True)
            expressions.append(sum(w * self._vars[j] for w, j in terms) + unrolled.consts[k][i])
        return expressions

    def add_cuts(self, node: int, alpha: Floats, beta: Floats) -> None:
        """See `Backend.add_cuts`."""
        import pyomo.environ as pyo

        columns, values = self._later_cuts.add(node, alpha, beta)
        if not hasattr(self.model, "cuts"):
            self.model.cuts = pyo.ConstraintList()
        for rhs, row in zip(-np.asarray(alpha), values, strict=True):
            terms = zip(row.tolist(), columns, strict=True)
            self.model.cuts.add(sum(w * self._vars[j] for w, j in terms) <= rhs)
        self._watch(True)
        self.update(self.vectors)

    def write(self, path: Path) -> None:
        """Writes the model; the suffix chooses LP, MPS or NL.

        Raises:
            UsageError: another suffix, or one of formats that cannot hold the angles of loops.
        """
        check_format(path)
        if path.suffix != ".nl" and self.standard.structures_of(Angle):
            raise UsageError(
                f"the angles of closed loops have sines, which no {path.suffix} file holds; "
                "allowed: .nl",
                hint="or export the model of lindistflow, in which they are linear: --method lp",
            )
        options = {} if path.suffix == ".nl" else {"symbolic_solver_labels": True}
        self.model.write(str(path), format=FORMATS[path.suffix], io_options=options)

    @of_solver("the solver behind pyomo")
    def solve(self) -> Solution:
        """Solves with HiGHS or SCIP."""
        return self._highs() if self.solver == "highs" else self._scip()

    @failures_of("HiGHS")
    def _highs(self) -> Solution:
        from pyomo.contrib.appsi.base import TerminationCondition as End
        from pyomo.contrib.appsi.solvers import Highs

        if self._persistent is None:
            self._persistent = Highs()
            self._persistent.config.load_solution = False
        solver = self._persistent
        solver.config.mip_gap = self.gap
        solver.config.time_limit = None if np.isinf(self.time_limit) else self.time_limit
        answer = solver.solve(self.model)
        self._watch(False)
        ended = answer.termination_condition
        if ended in (End.infeasible, End.infeasibleOrUnbounded):
            return Solution("infeasible", None, np.inf, np.inf)
        if answer.best_feasible_objective is None:
            return NOTHING
        answer.solution_loader.load_vars()
        return self._read(ended == End.optimal, answer.best_objective_bound)

    def _watch(self, changes: bool) -> None:
        """Whether the persistent solver looks for more than new bounds and parameters."""
        if self._persistent is None:
            return
        config = self._persistent.update_config
        config.check_for_new_or_removed_constraints = changes
        config.check_for_new_or_removed_vars = changes
        config.check_for_new_or_removed_params = changes
        config.check_for_new_objective = changes
        config.update_constraints = changes
        config.update_named_expressions = changes
        config.update_objective = changes
        config.treat_fixed_vars_as_params = changes

    @failures_of("SCIP")
    def _scip(self) -> Solution:
        from pyomo.contrib.solver.common.factory import SolverFactory
        from pyomo.contrib.solver.common.results import TerminationCondition as End

        options: dict[str, Any] = {
            "load_solutions": False,
            "raise_exception_on_nonoptimal_result": False,
            "rel_gap": self.gap,
        }
        if np.isfinite(self.time_limit):
            options["time_limit"] = self.time_limit
        answer = SolverFactory("scip_direct").solve(self.model, **options)
        if answer.termination_condition == End.interrupted:  # SCIP keeps Ctrl-C to itself
            raise KeyboardInterrupt
        if answer.termination_condition == End.provenInfeasible:
            return Solution("infeasible", None, np.inf, np.inf)
        if answer.incumbent_objective is None:
            return NOTHING
        answer.solution_loader.load_vars()
        done = answer.termination_condition == End.convergenceCriteriaSatisfied
        return self._read(done, answer.objective_bound)

    def _read(self, done: bool, bound: float | None) -> Solution:
        n = self.standard.n_columns
        z = np.array([0.0 if x.value is None else x.value for x in self._vars[:n]])
        v = self.vectors
        value = float(v.cost @ z + v.offset)
        return Solution(
            "optimal" if done else "feasible", z, value, -np.inf if bound is None else bound
        )


def _plain(name: str) -> str:
    return name.replace(".", "_").replace("-", "_")


def check_format(path: Path) -> None:
    """Raises UsageError unless the suffix is one that models can be written to."""
    if path.suffix not in FORMATS:
        raise UsageError(
            f"cannot export to {path.name!r}; allowed suffixes: {', '.join(FORMATS)}",
            hint="LP is the readable one",
        )


def _differing(old: Vectors | None, new: Vectors, *names: str) -> list[int]:
    """Where some of the arrays `names` of two vectors differ; everywhere without old ones."""
    arrays = [getattr(new, name) for name in names]
    apart = np.full(len(arrays[0]), old is None)
    if old is not None:
        for name, array in zip(names, arrays, strict=True):
            apart |= array != getattr(old, name)
    return list(np.flatnonzero(apart).tolist())
