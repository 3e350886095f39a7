"""Two-stage programs in one piece: the extensive form, for few scenarios, integers included."""

from __future__ import annotations

from typing import Any

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.errors import InfeasibleError, SolverError
from resilience.models.backends.base import Solution
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower
from resilience.models.backends.risk_averse import RiskAverse
from resilience.models.methods.explain import grouped
from resilience.models.program.gate import gap, status_of
from resilience.models.program.risk import node_prices
from resilience.models.program.standard import Standard, Vectors
from resilience.planning.two_stage.lshaped import (
    DecompositionOptions,
    TwoStageSolution,
    out_of_time,
)
from resilience.planning.two_stage.two_stage import TwoStage
from resilience.progress import phase

MAX_LISTED = 6  # names of conflicting rows in an error


def extensive(two_stage: TwoStage, options: DecompositionOptions | None = None) -> TwoStageSolution:
    """Solves a two-stage program as one, modes relaxed, integers held.

    Raises:
        InfeasibleError: there is no point; what conflicts is named, with its scenario.
        OutOfTimeError: no point was found in time.
        SolverError: the solver failed.
        CertificateError: the bound lies above the plan.
    """
    options = options or DecompositionOptions()
    standard, risk = two_stage.extensive_form(), two_stage.risk
    lowered = lower(standard, modes={}, discs=options.discs)
    limits: dict[str, Any] = {"time_limit": options.time_limit, "gap": options.gap}
    averse = RiskAverse(lowered, risk, **limits) if risk.averse else None
    if averse is not None:
        averse.price(two_stage.data_of(np.arange(two_stage.tree.n)))
    solver = averse or Highs(lowered, **limits)
    vectors = standard.vectors(two_stage.data, two_stage.x0)
    with phase("extensive form", f"{standard.n_rows} rows, {standard.n_columns} columns"):
        solver.update(_with_idle_columns(two_stage, standard, vectors, options))
        solution = solver.solve()
    if solution.z is None:
        raise _no_plan(solver, solution, options)
    trunk, points = trunk_and_branches(two_stage, standard, solution.z)
    cost = costs(two_stage, standard, solution.z)
    probability = np.append([b.probability for b in two_stage.branches], two_stage.staying)
    value = risk.value(cost, probability)
    bound = solution.bound if solver.is_mip else solver.certified_bound(solution)
    status = status_of(gap(value, bound, two_stage.cost_scale), options.gap)
    return TwoStageSolution(status, trunk, points, cost, probability, value, bound)


def own_columns(standard: Standard) -> list[Ints]:
    """Per node, the columns that it has for itself."""
    columns: list[Ints] = [np.empty(0, np.intp)] * standard.tree.n
    for stage in standard.copies:
        for node, of_node in zip(stage.nodes, stage.own_columns, strict=True):
            columns[node] = of_node
    return columns


def trunk_and_branches(
    two_stage: TwoStage, extensive_form: Standard, z: Floats
) -> tuple[Floats, list[Floats]]:
    """A point of the extensive form as one of the trunk and one of every branch's program."""
    columns = own_columns(extensive_form)
    leaves = extensive_form.tree.leaves.tolist()
    future = dict(zip(leaves, extensive_form.future.tolist(), strict=True))
    first, n = two_stage.first, two_stage.first.n_states
    trunk = np.zeros(first.n_columns)
    trunk[:n] = z[:n]
    for node, inside in enumerate(own_columns(first)):
        trunk[inside] = z[columns[node]]
    if two_stage.trunk - 1 in future:
        trunk[first.future[0]] = z[future[two_stage.trunk - 1]]
    program_columns = [own_columns(program) for program in two_stage.programs]
    points = []
    for branch in two_stage.branches:
        program = two_stage.programs[branch.program]
        point = np.zeros(program.n_columns)
        for step, node in enumerate(branch.nodes, branch.offset):
            point[program_columns[branch.program][step]] = z[columns[node]]
        link = program.state_columns(branch.offset - 1) if branch.offset else np.arange(n)
        begins_at_start = branch.trunk_node < 0
        start = np.arange(n) if begins_at_start else extensive_form.state_columns(branch.trunk_node)
        point[link] = z[start]
        point[program.future[0]] = z[future[int(branch.nodes[-1])]]
        points.append(point)
    return trunk, points


def costs(two_stage: TwoStage, extensive_form: Standard, z: Floats) -> Floats:
    """(branches + 1,) $ of every scenario at a point of the extensive form, staying last."""
    prices, offset = node_prices(extensive_form, two_stage.data_of(np.arange(two_stage.tree.n)))
    node_cost = prices @ z + offset
    # The last entry is what is spent before the start, where a branch may begin: at node -1.
    spent = np.append(np.cumsum(node_cost[: two_stage.trunk]), 0.0)
    branch_costs = [spent[b.trunk_node] + node_cost[b.nodes].sum() for b in two_stage.branches]
    return np.append(branch_costs, spent[two_stage.trunk - 1])


def _with_idle_columns(
    two_stage: TwoStage, extensive_form: Standard, vectors: Vectors, options: DecompositionOptions
) -> Vectors:
    """The vectors with the columns at zero that the options hold in the trunk and in branches."""
    outside = own_columns(extensive_form)
    columns = [np.empty(0, np.intp)]
    if options.idle_trunk is not None:
        trunk_nodes = range(two_stage.trunk)
        columns += _matching(own_columns(two_stage.first), outside, options.idle_trunk, trunk_nodes)
    for k, idle in options.idle_branches.items():
        branch = two_stage.branches[k]
        inside = own_columns(two_stage.programs[branch.program])[branch.offset :]
        columns += _matching(inside, outside, idle, branch.nodes)
    idle_columns = np.concatenate(columns)
    return vectors.fixed(idle_columns, np.zeros(len(idle_columns)))


def _matching(
    inside: list[Ints], outside: list[Ints], columns: Ints, nodes: Ints | range
) -> list[Ints]:
    """Columns of a smaller program where the extensive form has them, node by node.

    Args:
        inside: per node of the smaller program, its columns there.
        outside: per node of the extensive form, its columns there.
        columns: of the smaller program.
        nodes: of the extensive form that the smaller program's nodes are.
    """
    return [
        outside[node][np.isin(of_node, columns)]
        for of_node, node in zip(inside, nodes, strict=True)
    ]


def _no_plan(
    solver: Highs, solution: Solution, options: DecompositionOptions
) -> InfeasibleError | SolverError:
    if solver.model.is_out_of_time:
        return out_of_time(options)
    if solution.status != "infeasible":
        return SolverError("HiGHS found no plan", hint="report the case")
    names = grouped(solver.conflict())
    return InfeasibleError(
        "no plan satisfies all scenarios; in conflict: "
        + (", ".join(names[:MAX_LISTED]) or "no small set of rows could be named"),
        hint="let PV be curtailed, or leave the scenario out that is named",
    )
