"""Islands and their sources, against networkx."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest

from resilience.models.case_program import line_up_before
from resilience.models.language.tree import Tree
from resilience.models.network.situation import Situation


def situation(buses: int, ends: np.ndarray, up: np.ndarray, forming: np.ndarray) -> Situation:
    names = tuple(str(k) for k in range(ends.shape[1]))
    return Situation(lambda _: np.ones(up.shape[1]), names, ends, up, forming, up.shape[1])


@pytest.mark.parametrize("seed", range(5))
def test_islands_are_the_connected_components_of_the_lines_that_are_up(seed: int) -> None:
    rng = np.random.default_rng(seed)
    buses, lines, nodes = 12, 14, 9
    ends = np.stack([rng.integers(buses, size=lines), rng.integers(buses, size=lines)])
    up = rng.random((lines, nodes)) < 0.6
    up[:, -1] = up[:, 0]  # a pattern that comes twice
    forming = rng.random(buses) < 0.2
    found = situation(buses, ends, up, forming)
    for node in range(nodes):
        graph = nx.empty_graph(buses)
        graph.add_edges_from(ends[:, up[:, node]].T.tolist())
        for members in nx.connected_components(graph):
            at = sorted(members)
            inside = np.isin(found.island[:, node], found.island[at[0], node])
            assert np.flatnonzero(inside).tolist() == at
            assert (found.alive[at, node] == float(forming[at].any())).all()


def test_a_network_without_lines_is_as_many_islands_as_buses() -> None:
    ends, up = np.empty((2, 0), np.intp), np.empty((0, 3), bool)
    found = situation(2, ends, up, np.array([True, False]))
    assert (found.island[0] != found.island[1]).all()
    assert found.alive.tolist() == [[1.0] * 3, [0.0] * 3]
    assert found.alive_at(np.array([1, 0, 1])).shape == (3, 3)


def test_lines_are_one_slot_before_what_they_are_in_the_node_before() -> None:
    """Node 0 is the start, where all are up before; 1 follows it, and 2 and 3 follow 1."""
    labels = ("t0", "t1", "low", "high")
    tree = Tree(np.array([-1, 0, 1, 1]), np.array([1.0, 1.0, 0.4, 0.6]), np.zeros(4, int), labels)
    up = np.array([[False, True, True, False], [True, False, False, True]])
    assert line_up_before(up, tree).astype(int).tolist() == [[1, 0, 1, 1], [1, 1, 0, 0]]
