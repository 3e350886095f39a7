"""Branch exchange and its sweep, against power flows and searches that are not its own."""

from __future__ import annotations

import itertools
from typing import Any

import networkx as nx
import numpy as np
import pytest

from resilience.arrays import Bools, Floats
from resilience.models.methods.trees.exchange import Exchanges, TreeTask, improved, rated
from resilience.models.methods.trees.forest import Forest, TreeLines
from resilience.models.methods.trees.periods import cheapest_sequence
from tests.known.feeder33 import BASE_OPEN, BEST_OPEN, exchanges, feeder, losses_kw

RNG = np.random.default_rng(7)


def wires33(v_min_pu: float = 0.5) -> TreeLines:
    n, lines = 33, 37
    return TreeLines(
        ends=feeder().ends,
        z=feeder().z,
        tap=np.ones(lines),
        rating=np.full(lines, np.inf),
        switchable=np.ones(lines, bool),
        v_min=np.full(n, v_min_pu),
        v_max=np.full(n, 1.1),
    )


def task33(*factors: float, wires: TreeLines | None = None, root_max_mw: float = 9.0) -> TreeTask:
    slots = len(factors)
    return TreeTask(
        wires=wires or wires33(),
        up=np.ones(37, bool),
        roots=np.array([0]),
        alive=np.ones(33, bool),
        drawn=feeder().load[:, None] * np.array(factors),
        v_root=np.ones((33, slots)),
        root_max=np.full((33, slots), root_max_mw),
        weight=np.ones(slots),
    )


def closed_but(open_lines: tuple[int, ...]) -> Bools:
    closed = np.ones(37, bool)
    closed[np.array(open_lines) - 1] = False
    return closed


def open_lines(closed: Bools) -> tuple[int, ...]:
    return tuple(int(k) + 1 for k in np.flatnonzero(~closed))


def test_a_sweep_is_the_power_flow_of_the_impedance_matrix() -> None:
    trees = [BASE_OPEN, BEST_OPEN, *exchanges(BASE_OPEN)[::9]]
    losses, lowest = losses_kw(trees)
    for tree, loss, low in zip(trees, losses, lowest, strict=True):
        forest = rated(task33(1.0), closed_but(tree))
        assert 1e3 * forest.score == pytest.approx(loss, rel=1e-8)
        voltage, _ = forest.forest.swept(task33(1.0).drawn, np.ones((33, 1))) or (None, None)
        assert voltage is not None
        assert np.abs(voltage).min() == pytest.approx(low, rel=1e-8)


def test_ratios_are_taken_out_of_a_sweep() -> None:
    """Two transformers in a row, one against the direction of flow: by Kirchhoff's laws."""
    wires = TreeLines(
        ends=np.array([[0, 1], [2, 1]]),
        z=np.array([0.01 + 0.04j, 0.02 + 0.03j]),
        tap=np.array([0.95, 1.05]),
        rating=np.full(2, np.inf),
        switchable=np.ones(2, bool),
        v_min=np.full(3, 0.5),
        v_max=np.full(3, 1.5),
    )
    forest = Forest.from_closed(wires, np.ones(2, bool), np.array([0]))
    drawn = np.array([[0.0], [0.4 + 0.1j], [0.8 + 0.3j]])
    flow = forest.swept(drawn, np.ones((3, 1)))
    assert flow is not None
    (u, j), g = flow, forest.gain[:, None]
    v, i = g * u, j / g[wires.ends[:, 1]]  # through the impedance, in its own frame
    assert v[0] / 0.95 - wires.z[0] * i[0] == pytest.approx(v[1], abs=1e-8)
    assert v[2] / 1.05 - wires.z[1] * i[1] == pytest.approx(v[1], abs=1e-8)
    assert v[2] * np.conj(-i[1] / 1.05) == pytest.approx(drawn[2], abs=1e-8)
    assert v[1] * np.conj(i[0] + i[1]) == pytest.approx(drawn[1], abs=1e-8)


def test_no_operating_point_is_no_forest() -> None:
    assert rated(task33(6.0), closed_but(BASE_OPEN)).score == np.inf
    assert rated(task33(1.0), closed_but((*BEST_OPEN, 20))).score == np.inf


def constant_current_loss(tree: Bools, current: Any) -> float:
    """Of a tree whose buses draw fixed currents: solved on the graph, line by line."""
    graph: nx.Graph = nx.Graph()
    for k in np.flatnonzero(tree):
        graph.add_edge(*feeder().ends[k].tolist(), line=int(k))
    flow = np.zeros((37, current.shape[1]), complex)
    for bus in range(1, 33):
        way = nx.shortest_path(graph, 0, bus)
        for a, b in itertools.pairwise(way):
            k = graph.edges[a, b]["line"]
            flow[k] += current[bus] * (1.0 if feeder().ends[k, 0] == a else -1.0)
    return float((feeder().z.real[:, None] * np.abs(flow) ** 2).sum())


@pytest.mark.parametrize("kind", ["singles", "doubles"])
def test_what_an_exchange_promises_is_what_fixed_currents_lose(kind: str) -> None:
    """The most promising of all trees that one exchange, or two, can reach."""
    task = task33(1.0, 0.6)
    start = rated(task, closed_but(BASE_OPEN))
    voltage, _ = start.forest.swept(task.drawn, task.v_root) or (None, None)
    assert voltage is not None
    current = np.conj(task.drawn / voltage)
    singles = exchanges(BASE_OPEN)[1:]
    doubles = {t for tree in singles for t in exchanges(tree) if len(set(t) - set(BASE_OPEN)) == 2}
    trees = singles if kind == "singles" else sorted(doubles)
    losses = [constant_current_loss(closed_but(tree), current) for tree in trees]
    promised = getattr(Exchanges(task, start), kind)()[0]
    assert open_lines(promised) == trees[int(np.argmin(losses))]


def test_two_exchanges_at_once_leave_a_local_optimum() -> None:
    """From every tenth tree beside the base case to the optimum of all 50,751."""
    for tree in exchanges(BASE_OPEN)[::10]:
        assert open_lines(improved(task33(1.0), closed_but(tree), lambda: False).forest.closed) == (
            BEST_OPEN
        )


def test_time_is_up_before_the_first_exchange() -> None:
    start = closed_but(BASE_OPEN)
    assert open_lines(improved(task33(1.0), start, lambda: True).forest.closed) == BASE_OPEN


def test_a_line_without_a_switch_stays_closed() -> None:
    wires = wires33()
    wires.switchable[np.array([7, 9]) - 1] = False
    closed = improved(task33(1.0, wires=wires), closed_but(BASE_OPEN), lambda: False).forest.closed
    assert closed[[6, 8]].all()
    assert not closed.all()


def test_limits_weigh_more_than_losses() -> None:
    """No tree but few keeps 0.94 pu at 1.02 times the load; the root's limit counts as well."""
    task = task33(1.02, wires=wires33(v_min_pu=0.936))
    best = improved(task, closed_but(BASE_OPEN), lambda: False)
    voltage, _ = best.forest.swept(task.drawn, task.v_root) or (None, None)
    assert voltage is not None
    assert np.abs(voltage).min() >= 0.936
    beyond = rated(task33(1.0, root_max_mw=3.0), closed_but(BEST_OPEN)).score
    assert beyond > 10 * rated(task33(1.0), closed_but(BEST_OPEN)).score


@pytest.mark.parametrize("price", [0.0, 0.3, 2.0])
def test_the_cheapest_sequence_is_that_of_all(price: float) -> None:
    pools = [np.array(list(itertools.product([0.0, 1.0], repeat=2)))] * 4
    costs: list[Floats] = [RNG.uniform(size=4) for _ in pools]
    start, prices = np.array([1.0, 0.0]), np.array([price, 0.5 * price])

    def total(choice: tuple[int, ...]) -> float:
        states = np.array([start, *(pool[k] for pool, k in zip(pools, choice, strict=True))])
        moved = float((np.abs(np.diff(states, axis=0)) @ prices).sum())
        return moved + sum(float(c[k]) for c, k in zip(costs, choice, strict=True))

    sequence = cheapest_sequence(pools, costs, start, prices)
    chosen = tuple(int(2 * a + b) for a, b in sequence.T)
    assert total(chosen) == pytest.approx(min(map(total, itertools.product(range(4), repeat=4))))
