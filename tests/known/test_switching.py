"""Lines that the plan may open and close: load saved through a tie, and always a forest."""

from dataclasses import replace
from typing import Any, Literal

import networkx as nx
import numpy as np
import pytest

from resilience.arrays import Floats
from resilience.case import Case
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower
from resilience.models.case_program import horizon
from resilience.models.methods.start import with_switches_held
from resilience.testing import small_case
from tests.known.feeder33 import LOAD_MW, case33
from tests.known.solving import Solved, solved, watch_that_is_late

GRID = {"import_max_mw": 10.0, "import_cost_per_mwh": 0.3}
LOAD = {"p_max_mw": 1.0, "shed_cost_per_mwh": 1.5}
Z = (1e-4, 1e-4)


def tied(tie: dict[str, Any] | None = None, outage: str = "1-2@01:00-03:00") -> Case:
    """Buses 1-2-3 in a row with 1 MW at 2 and 3, and a tie 1-3 that is open; 1-2 fails for 2 h."""
    case = small_case(
        slots=4,
        buses=3,
        lines=[(1, 2, *Z), (2, 3, *Z), (1, 3, *Z)],
        line_tables=[{"name": "1-3", "switchable": True} | (tie or {})],
        outages=[outage],
        grid=[GRID],
        load=[LOAD | {"bus": "2"}, LOAD | {"bus": "3"}],
    )
    case.source["network"]["line"][-1]["in_service"] = False
    return case.replace(description="the tie is open at the start")


def forest(found: Solved) -> None:
    """Asserts that closed lines are a forest in every slot, each live bus with a source."""
    network, situation = found.problem.microgrid.network, found.problem.situation
    closed = found.problem.data["line.up"] > 0.5
    closed[network.switchable] = found["line.closed"] > 0.5
    for t in range(closed.shape[1]):
        graph = nx.Graph()
        graph.add_nodes_from(range(len(network.bus_names)))
        ends = network.from_bus[closed[:, t]], network.to_bus[closed[:, t]]
        graph.add_edges_from(zip(*ends, strict=True))
        assert graph.number_of_edges() == closed[:, t].sum()
        assert nx.is_forest(graph)
        for buses in nx.connected_components(graph):
            has_source = situation.forming[list(buses)].any()
            assert all(situation.alive[b, t] == has_source for b in buses)


@pytest.mark.parametrize(
    ("method", "physics"),
    [("lp", "copperplate"), ("lp", "lindistflow"), ("milp", "lindistflow"), ("minlp", "distflow")],
)
def test_a_tie_saves_the_load_behind_a_fault(method: str, physics: Any) -> None:
    """2 MW for 4 h at 0.3, and nothing shed; without the tie 4 MWh are, at 1.5."""
    found = solved(tied(), method, physics)
    assert found.objective == pytest.approx(0.3 * 8, rel=1e-3)
    assert found["load.shed"].max() == pytest.approx(0.0, abs=1e-6)
    assert found["line.closed"][0] == pytest.approx([0, 1, 1, 0])
    forest(found)
    locked = solved(tied({"switchable": False}), method, physics)
    assert locked.objective == pytest.approx(0.3 * 4 + 1.5 * 4, rel=1e-3)


def test_scip_closes_the_tie_too() -> None:
    pytest.importorskip("pyscipopt", reason="the extra `exact` is not installed")
    found = solved(tied(), "exact")
    assert found["line.closed"][0] == pytest.approx([0, 1, 1, 0])
    assert found.objective == pytest.approx(solved(tied(), "minlp").objective, rel=1e-6)


def test_a_tie_carries_its_rating_and_no_more() -> None:
    found = solved(tied({"rating_mva": 1.5}), "milp", "copperplate")
    assert found.objective == pytest.approx(0.3 * 7 + 1.5 * 1.0)


def test_switching_costs_each_time() -> None:
    """Closed for the fault and opened after it, for then it would close a cycle."""
    found = solved(tied({"switching_cost": 0.25}), "milp")
    assert found.objective == pytest.approx(0.3 * 8 + 2 * 0.25)
    dear = solved(tied({"switching_cost": 10.0}, outage="1-2@02:00-03:00"), "milp")
    assert dear.objective == pytest.approx(0.3 * 8 + 2 * 10.0)


def test_live_buses_must_be_reconnected_even_at_a_loss() -> None:
    """A bus that could have a source is never left without one; only those that cannot are dead."""
    found = solved(tied(), "milp")
    assert found.problem.situation.alive.all()


def test_switches_in_a_dead_part_stand_open() -> None:
    case = small_case(
        slots=2,
        buses=4,
        lines=[(1, 2, *Z), (2, 3, *Z), (3, 4, *Z)],
        line_tables=[{"name": "2-3", "switchable": True}, {"name": "3-4", "switchable": True}],
        outages=["1-2@01:00-02:00"],
        grid=[GRID],
        load=[LOAD | {"bus": "3"}, LOAD | {"bus": "4"}],
    )
    found = solved(case, "milp")
    assert found["load.shed"] == pytest.approx(np.array([[0, 1], [0, 1]]))
    assert found["line.closed"] == pytest.approx(np.array([[1, 0], [1, 0]]))
    forest(found)


def test_a_fixed_line_in_a_dead_part_is_no_link_of_the_tree() -> None:
    """A ring of three with the grid; a pair behind it is cut off in the second of three hours.

    Of the pair's 0.9 MW one hour is shed, at 1.5; all else is served at 0.3.
    """
    case = small_case(
        slots=3,
        buses=5,
        lines=[(1, 2, *Z), (2, 3, *Z), (1, 3, *Z), (3, 4, *Z), (4, 5, 2e-4, 1e-4)],
        line_tables=[{"name": name, "switchable": True} for name in ("1-2", "2-3", "1-3")],
        outages=["3-4@01:00-02:00"],
        grid=[GRID],
        load=[LOAD | {"bus": b, "p_max_mw": mw} for b, mw in (("2", 0.6), ("3", 0.8), ("5", 0.9))],
    )
    found = solved(case, "milp", "lindistflow")
    assert found.objective == pytest.approx(0.3 * (3 * 1.4 + 2 * 0.9) + 1.5 * 0.9, rel=1e-6)
    assert found["line.closed"].sum(0) == pytest.approx([2, 2, 2])
    forest(found)


def test_an_open_line_has_no_current_even_where_the_cone_is_relaxed() -> None:
    """Else what must be taken could be burnt in it: r l at no flow. Here currents are wanted."""
    program = horizon(tied({"rating_mva": 1.5}), "distflow")
    standard, vectors = program.standard, program.vectors
    tie = standard.labels("line.l").index("1-3")
    current = standard.columns("line.l")[tie]
    cost = np.zeros(standard.n_columns)
    cost[current] = -1.0

    def most(integer: Literal["all", "none"]) -> Floats:
        solver = Highs(lower(standard, integer=integer, modes={}))
        solver.update(replace(vectors, cost=cost, offset=0.0))
        return solver.solve().point

    point, relaxed = most("all"), most("none")
    # A forest has the tie in the two hours of the outage, and in no other.
    assert point[standard.columns("line.closed")[0]] == pytest.approx([0, 1, 1, 0], abs=1e-9)
    assert point[current][[0, 3]] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert point[current][[1, 2]].min() > 0.5
    # A line that is closed by a share has that share of its current.
    closed = relaxed[standard.columns("line.closed")[0]]
    assert 0.05 < closed.min() < 0.2
    np.testing.assert_allclose(relaxed[current], closed * vectors.upper[current], rtol=1e-9)


def two_sources() -> Case:
    """A ring of six buses, all switchable, with the grid at 1 and storage at 4; two lines fail."""
    ring = [(1, 2, *Z), (2, 3, *Z), (3, 4, *Z), (4, 5, *Z), (5, 6, *Z), (6, 1, *Z)]
    return small_case(
        slots=4,
        buses=6,
        lines=ring,
        line_tables=[{"name": f"{i}-{j}", "switchable": True} for i, j, *_ in ring],
        outages=["1-2@01:00-03:00", "6-1@02:00-04:00"],
        grid=[GRID],
        ess=[{"bus": "4", "p_max_mw": 3.0, "e_mwh": 6.0, "soc_initial": 1.0}
             | {"degradation_cost_per_mwh": 0.5, "s_mva": 4.0}],
        load=[{**LOAD, "bus": b, "p_max_mw": 0.5} for b in ("2", "3", "5", "6")],
    )  # fmt: skip


@pytest.mark.parametrize("method", ["milp", "minlp"])
def test_a_ring_with_two_sources(method: str) -> None:
    """The grid at 0.3 serves all but one hour; that one takes 2 MWh from storage at 0.5."""
    found = solved(two_sources(), method)
    assert found.objective == pytest.approx(0.3 * 2 * 3 + 0.5 * 2, rel=1e-3)
    forest(found)


def faulted33() -> Case:
    """Baran and Wu's feeder, all lines switchable, for three hours with two faults."""
    case = case33(switchable=True)
    return case.replace(slots=3, outages="6-7@01:00-03:00, 3-23@02:00-03:00")


def test_33_buses_are_reconnected_around_faults() -> None:
    found = solved(faulted33(), "milp", gap=1e-4)
    assert found["load.shed"].max() == pytest.approx(0.0, abs=1e-6)
    assert found.objective == pytest.approx(3 * LOAD_MW, rel=1e-6)
    forest(found)


def test_minlp_in_a_hurry_keeps_to_forests(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = watch_that_is_late(monkeypatch)
    found = solved(faulted33(), "minlp", time_limit=0.25, clock=clock)
    assert found.bound <= found.objective
    assert not found.answer.relaxed
    forest(found)


CASES = {"tied": tied, "ring": two_sources, "33": faulted33}


@pytest.mark.parametrize("name", CASES)
def test_a_mended_topology_is_a_forest_close_to_the_one_before(name: str) -> None:
    """The fallback without search: what is closed stays closed, and few ties are added."""
    problem = horizon(CASES[name]())
    vectors = with_switches_held(problem)
    at = problem.standard.columns("line.closed")
    assert (vectors.lower[at] == vectors.upper[at]).all()
    z = np.zeros(problem.standard.n_columns)
    z[at] = vectors.lower[at]
    forest(Solved(problem, None, z))  # type: ignore[arg-type]
    network = problem.microgrid.network
    before = network.in_service[network.switchable][:, None]
    up = problem.data["line.up"][network.switchable] > 0.5
    opened = (before & up & (z[at] < 0.5)).sum(0)
    assert opened.max() <= (1 if name == "ring" else 0)


def test_mending_closes_no_tie_between_two_sources() -> None:
    """Storage at bus 2, the grid at bus 1 and an open tie between them: nobody needs it."""
    case = small_case(
        slots=1,
        buses=2,
        lines=[(1, 2, *Z)],
        line_tables=[{"name": "1-2", "switchable": True}],
        grid=[GRID],
        ess=[{"bus": "2", "p_max_mw": 1.0, "e_mwh": 1.0}],
    )
    case.source["network"]["line"][0]["in_service"] = False
    problem = horizon(case.replace(description="the tie is open at the start"))
    assert with_switches_held(problem).upper[problem.standard.columns("line.closed")].sum() == 0.0
