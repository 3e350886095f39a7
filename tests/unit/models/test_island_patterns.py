"""Islands are searched once per pattern of line status and looked up ever after."""

from __future__ import annotations

import networkx as nx
import numpy as np
import pytest

import resilience as rs
from resilience.models.microgrid import Microgrid
from resilience.models.network import situation as module
from resilience.models.network.situation import Islands


def agree(table: Islands, up: np.ndarray) -> None:
    """What the table says is what networkx finds."""
    island, alive = table.lookup(up)
    buses = len(table.forming)
    for node in range(up.shape[1]):
        graph = nx.empty_graph(buses)
        graph.add_edges_from(table.ends[:, up[:, node]].T.tolist())
        for members in nx.connected_components(graph):
            at = sorted(members)
            inside = island[:, node] == island[at[0], node]
            assert np.flatnonzero(inside).tolist() == at
            assert (alive[at, node] == float(table.forming[at].any())).all()


@pytest.mark.parametrize("lines", [0, 1, 14, 64, 65, 200])
def test_any_number_of_lines_in_a_mesh(lines: int) -> None:
    rng = np.random.default_rng(lines)
    buses = 12 if lines < 64 else 80
    table = Islands(rng.integers(buses, size=(2, lines)), rng.random(buses) < 0.2)
    for _ in range(3):
        agree(table, rng.random((lines, 9)) < 0.6)


def test_a_pattern_is_searched_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sixteen patterns of four breakpoints, however many slots and scenarios."""
    searched: list[int] = []
    search = Islands._search
    monkeypatch.setattr(
        Islands, "_search", lambda self, up: (searched.append(up.shape[1]), search(self, up))[1]
    )
    microgrid = Microgrid.build(rs.load_case("ieee33"), "copperplate")
    names = microgrid.case.network.line_names
    rng = np.random.default_rng(0)
    for _ in range(20):
        up = np.ones((len(names), 300), bool)
        up[microgrid.lines_of] = rng.random((4, 300)) < 0.5
        agree(microgrid.islands, up[microgrid.lines_of])
        situation = microgrid.situation(up)
        assert (situation.island == microgrid.islands.lookup(up[microgrid.lines_of])[0]).all()
    assert sum(searched) == microgrid.islands.patterns == 16


def test_a_full_table_starts_anew_and_stays_right(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_NUMBERS", 40)
    rng = np.random.default_rng(1)
    table = Islands(np.array([[0, 1, 2, 3], [1, 2, 3, 0]]), np.array([True, False, False, True]))
    for _ in range(20):
        agree(table, rng.random((4, 7)) < 0.5)
        assert table.patterns <= 10
