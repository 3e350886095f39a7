r"""Few scenarios in place of many: fast forward selection, weights that keep means.

Heitsch and Roemisch (Scenario reduction algorithms in stochastic programming, Computational
Optimization and Applications 24, 2003): in every step the scenario is kept that makes

$$ D = \sum_j p_j \min_{i \text{ kept}} d(j, i) $$

smallest. If at the end every scenario that is not kept gives its probability to the nearest one
that is, $D$ is the transport distance between the two distributions. The first step is optimal, the
rest is greedy. The distance between two scenarios is the time in which lines differ, each line
weighted by the load that hangs on it, if given.

Nearest weights understate a storm: the scenario nearest to many binary paths is their median, in
which whatever fails in fewer than half of them does not. Where means are to be kept, the weights
are those of the least transport that keeps them (`transport.py`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resilience.arrays import Floats, Ints
from resilience.case.schema import GridTable, LoadTable, UnitTable
from resilience.errors import SolverError, UsageError
from resilience.fragility.outages.scenarios import Scenarios
from resilience.fragility.outages.transport import (
    in_units_of_spread,
    least_transport,
    with_means_in_reach,
)

if TYPE_CHECKING:
    from resilience.case import Case

Distances = NDArray[np.float32] | NDArray[np.float64]
MAX_DIFFERENT = 20_000  # scenarios, whose distances then take 1.6 GB


def load_behind_mw(case: Case, lines: Sequence[str]) -> Floats:
    """(lines,) peak load that loses its way to the grid with a line, MW; all lines in service.

    Of a unit it is the power that it gives.

    Raises:
        UsageError: a line or unit that the case lacks.
    """
    import networkx as nx

    network = case.network
    graph = nx.MultiGraph()
    graph.add_nodes_from(range(len(network.bus_names)))
    ends = zip(network.from_bus.tolist(), network.to_bus.tolist(), strict=True)
    graph.add_edges_from((i, j, k) for k, (i, j) in enumerate(ends) if network.in_service[k])
    roots = {network.bus(grid.bus) for grid in case.tables_of(GridTable)}
    load = np.zeros(len(network.bus_names))
    for table in case.tables_of(LoadTable):
        load[network.bus(table.bus)] += table.p_max_mw
    behind_mw = np.zeros(len(lines))
    size_mw = _unit_sizes_mw(case)
    for row, name in enumerate(lines):
        if name in size_mw and not network.has_line(name):
            behind_mw[row] = size_mw[name]
            continue
        k = network.line(name)
        edge = int(network.from_bus[k]), int(network.to_bus[k]), k
        if not graph.has_edge(*edge):
            continue
        graph.remove_edge(*edge)
        fed = {bus for island in nx.connected_components(graph) if island & roots for bus in island}
        behind_mw[row] = sum(load[bus] for bus in range(len(load)) if bus not in fed)
        graph.add_edge(*edge)
    return behind_mw


def _unit_sizes_mw(case: Case) -> dict[str, float]:
    """By name of the units, what each can give at most; of a tank, what burns from it."""
    sizes = {}
    for unit in case.tables_of(UnitTable):
        powers_mw = [getattr(unit, key, 0.0) for key in ("p_max_mw", "import_max_mw")]
        sizes[unit.name] = float(max(*powers_mw, -getattr(unit, "p_min_mw", 0.0)))
    for tank in case.tank:
        sizes[tank.name] = sum(unit.p_max_mw for unit in case.generator if unit.tank == tank.name)
    return sizes


def reduced(
    scenarios: Scenarios,
    k: int,
    *,
    load_mw: ArrayLike | None = None,
    means: Mapping[str, Floats] | None = None,
) -> Scenarios:
    """The `k` scenarios that stand best for all, with weights that add up to 1.

    Scenarios with the same outages count as one; where there are no more than k different ones,
    nothing is lost. `represents` of what is returned holds them all.

    Args:
        scenarios: many.
        k: how many to keep, 1 or more.
        load_mw: (lines,) load at risk behind each line, MW; all alike if omitted.
        means: by name, (scenarios,) values whose expectations are kept, as
            `resilience.fragility.moments` gives. Where k scenarios cannot have them all, a few more
            are kept, at most one more than there are means. If omitted, every scenario gives its
            probability to the nearest.

    Raises:
        UsageError: k below 1, too many scenarios, or loads that do not fit the lines.
    """
    load = np.ones(len(scenarios.lines)) if load_mw is None else np.asarray(load_mw, float)
    if k < 1 or load.shape != (len(scenarios.lines),) or not (load >= 0.0).all():
        raise UsageError(
            f"{k} scenarios, loads of shape {load.shape}; allowed: 1 or more scenarios, a load of "
            f"0 or more for each of {len(scenarios.lines)} lines",
            hint="20 to 50 scenarios carry most of a storm",
        )
    different, alike = _different(scenarios)
    if len(different) > MAX_DIFFERENT:
        raise UsageError(
            f"{len(different)} different scenarios; allowed: {MAX_DIFFERENT}",
            hint="reduce them in parts, or draw fewer",
        )
    probability: Floats = np.bincount(alike, scenarios.probability).astype(float)
    distance = outage_distance(scenarios.chosen(different), load)
    selected, nearest, lost = fast_forward(distance, probability, min(k, len(different)))
    weight = np.bincount(nearest, probability, minlength=len(selected)).astype(float)
    if means:
        values = np.array([row[different] for row in means.values()])
        selected, weight, lost = _keeping(values, selected, distance, probability)
    unit = "slots" if load_mw is None else "slots MW"
    index = different[selected]
    return Scenarios(
        scenarios.lines,
        scenarios.down[:, :, index],
        weight / weight.sum(),
        None if scenarios.centre is None else scenarios.centre[:, index],
        scenarios.seed,
        f"{scenarios.process}; {len(selected)} kept of {scenarios.n}, distance {lost:.4g} {unit}",
        represents=scenarios,
    )


def _keeping(
    values: Floats, selected: Ints, distance: Distances, probability: Floats
) -> tuple[Ints, Floats, float]:
    """Scenarios and weights with the means of all, and the transport distance.

    Args:
        values: (means, scenarios).
        selected: scenarios to keep at least, unless they get no weight.
        distance: (scenarios, scenarios).
        probability: (scenarios,).
    """
    apart = in_units_of_spread(values, probability)
    selected = with_means_in_reach(selected, apart)
    to_kept = np.asarray(distance[:, selected], float)
    transport = least_transport(to_kept, probability, apart[:, selected])
    if transport is None:
        raise SolverError("HiGHS found no weights that keep the means", hint="keep more scenarios")
    weighty = transport.weight > 0.0
    return selected[weighty], transport.weight[weighty], transport.distance


def outage_distance(scenarios: Scenarios, load: Floats) -> NDArray[np.float32]:
    """(scenarios, scenarios) slots in which lines differ, weighted by the load (lines,) on them."""
    down = scenarios.down.reshape(-1, scenarios.n)
    varies = down.any(axis=1) & ~down.all(axis=1)
    weight = np.repeat(load, scenarios.slots)[varies]
    varying = down[varies].astype(np.float32)
    down_time = (weight @ down[varies]).astype(np.float32)
    common = (varying * weight.astype(np.float32)[:, None]).T @ varying
    distance = (down_time[:, None] + down_time - 2.0 * common).astype(np.float32, copy=False)
    np.fill_diagonal(distance, 0.0)
    return np.maximum(distance, 0.0, out=distance)


def fast_forward(distance: Distances, probability: Floats, k: int) -> tuple[Ints, Ints, float]:
    """Fast forward selection.

    Args:
        distance: (n, n) between scenarios, 0 on the diagonal.
        probability: (n,) of the scenarios.
        k: how many to keep, 1 to n.

    Returns:
        (k,) indices of those kept, in the order chosen; (n,) which of these stands for each
        scenario, as a position in the first; and the transport distance.
    """
    selected: list[int] = []
    nearest = np.zeros(len(probability), np.intp)
    to_nearest = np.full(len(probability), np.inf)
    for number in range(k):
        total = _totals(distance, to_nearest, probability)
        total[selected] = np.inf
        chosen = int(np.argmin(total))
        selected.append(chosen)
        closer = distance[chosen] < to_nearest
        nearest[closer] = number
        to_nearest = np.minimum(to_nearest, distance[chosen])
    return np.array(selected, np.intp), nearest, float(to_nearest @ probability)


def _totals(
    distance: Distances, to_nearest: Floats, probability: Floats, rows: int = 512
) -> Floats:
    """(n,) the transport distance that each scenario would leave if it were kept as well."""
    totals = np.empty(len(probability))
    probability = probability.astype(distance.dtype)
    for start in range(0, len(totals), rows):
        block = np.minimum(distance[start : start + rows], to_nearest.astype(distance.dtype))
        totals[start : start + rows] = block @ probability
    return totals


def _different(scenarios: Scenarios) -> tuple[Ints, Ints]:
    """Indices of scenarios whose outages differ, and for every scenario its place among them."""
    packed = np.packbits(scenarios.down.reshape(-1, scenarios.n), axis=0).T
    rows = np.ascontiguousarray(packed).view(f"V{packed.shape[1]}").ravel() if packed.size else None
    if rows is None:
        return np.zeros(1, np.intp), np.zeros(scenarios.n, np.intp)
    _, first, alike = np.unique(rows, return_index=True, return_inverse=True)
    return first, alike.ravel()
