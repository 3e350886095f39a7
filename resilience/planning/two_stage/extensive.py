"""Two-stage programs in one piece: the extensive form, for few scenarios, integers included."""

from __future__ import annotations

from typing import Any

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.errors import InfeasibleError, SolverError
from resilience.models.backends.base import Solution, Status
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower
from resilience.models.backends.risk_averse import RiskAverse
from resilience.models.methods.answer import gap
from resilience.models.methods.explain import grouped
from resilience.models.program.risk import node_prices
from resilience.models.program.standard import Standard, Vectors
from resilience.planning.two_stage.lshaped import DecompositionOptions, TwoStageSolution
from resilience.planning.two_stage.two_stage import TwoStage
from resilience.progress import phase

SHOWN = 6  # names of conflicting rows in an error


def extensive(two: TwoStage, options: DecompositionOptions | None = None) -> TwoStageSolution:
    """Solves a two-stage program as one, modes relaxed, integers held.

    Raises:
        InfeasibleError: there is no point; what conflicts is named, with its scenario.
        SolverError: no point was found in time.
    """
    options = options or DecompositionOptions()
    whole = two.whole()
    lowered = lower(whole, modes={}, discs=options.discs)
    limits: dict[str, Any] = {"time_limit": options.time_limit, "gap": options.gap}
    averse = RiskAverse(lowered, two.risk, **limits) if two.risk.averse else None
    if averse is not None:
        averse.price(two.data_of(np.arange(two.tree.n)))
    solver = averse or Highs(lowered, **limits)
    vectors = whole.vectors(two.data, two.x0)
    with phase("extensive form", f"{whole.n_rows} rows, {whole.n_columns} columns"):
        solver.update(_held(two, whole, vectors, options))
        found = solver.solve()
    if found.z is None:
        raise _none(solver, found)
    trunk, points = parted(two, whole, found.z)
    cost = costs(two, whole, found.z)
    chance = np.append([c.probability for c in two.chains], two.staying)
    value = two.risk.value(cost, chance)
    bound = found.bound if solver.is_mip else solver.certified_bound(found)
    done = gap(value, bound) <= options.gap
    status: Status = "optimal" if done else "feasible"
    return TwoStageSolution(status, trunk, points, cost, chance, value, min(bound, value))


def own_columns(standard: Standard) -> list[Ints]:
    """Columns that every node has for itself."""
    columns: list[Ints] = [np.empty(0, np.intp)] * standard.tree.n
    for stage in standard.copies:
        for node, own in zip(stage.nodes, stage.own_columns, strict=True):
            columns[node] = own
    return columns


def parted(two: TwoStage, whole: Standard, z: Floats) -> tuple[Floats, list[Floats]]:
    """A point of the extensive form as one of the trunk and one of every chain's program."""
    own = own_columns(whole)
    future = dict(zip(whole.tree.leaves.tolist(), whole.future.tolist(), strict=True))
    first, n = two.first, two.first.n_states
    trunk = np.zeros(first.n_columns)
    trunk[:n] = z[:n]
    for node, columns in enumerate(own_columns(first)):
        trunk[columns] = z[own[node]]
    if two.trunk - 1 in future:
        trunk[first.future[0]] = z[future[two.trunk - 1]]
    inside = [own_columns(program) for program in two.programs]
    points = []
    for chain in two.chains:
        program = two.programs[chain.program]
        point = np.zeros(program.n_columns)
        for step, node in enumerate(chain.nodes, chain.offset):
            point[inside[chain.program][step]] = z[own[node]]
        link = program.state_columns(chain.offset - 1) if chain.offset else np.arange(n)
        point[link] = z[whole.state_columns(chain.leaves)] if chain.leaves >= 0 else z[:n]
        point[program.future[0]] = z[future[int(chain.nodes[-1])]]
        points.append(point)
    return trunk, points


def costs(two: TwoStage, whole: Standard, z: Floats) -> Floats:
    """(chains + 1,) $ of every scenario at a point of the extensive form, that of staying last."""
    prices, offset = node_prices(whole, two.data_of(np.arange(two.tree.n)))
    each = prices @ z + offset
    spent = np.append(np.cumsum(each[: two.trunk]), 0.0)
    found = [spent[c.leaves] + each[c.nodes].sum() for c in two.chains]
    return np.append(found, spent[two.trunk - 1])


def _held(
    two: TwoStage, whole: Standard, vectors: Vectors, options: DecompositionOptions
) -> Vectors:
    """Columns held in the trunk and in chains, at zero."""
    own = own_columns(whole)
    columns = [np.empty(0, np.intp)]
    if options.held is not None:
        columns += _same(own_columns(two.first), own, options.held, range(two.trunk))
    for k, held in options.holds.items():
        chain = two.chains[k]
        inside = own_columns(two.programs[chain.program])[chain.offset :]
        columns += _same(inside, own, held, chain.nodes)
    at = np.concatenate(columns)
    return vectors.fixed(at, np.zeros(len(at)))


def _same(inside: list[Ints], whole: list[Ints], held: Ints, nodes: Ints | range) -> list[Ints]:
    """Columns `held` of a part where the whole has them, node by node."""
    return [
        whole[node][np.isin(columns, held)] for columns, node in zip(inside, nodes, strict=True)
    ]


def _none(solver: Highs, found: Solution) -> InfeasibleError | SolverError:
    if found.status != "infeasible":
        return SolverError("HiGHS found no plan in time", hint="raise --time-limit")
    names = grouped(solver.conflict())
    return InfeasibleError(
        "no plan satisfies all scenarios; in conflict: "
        + (", ".join(names[:SHOWN]) or "no small set of rows could be named"),
        hint="let PV be curtailed, or leave the scenario out that is named",
    )
