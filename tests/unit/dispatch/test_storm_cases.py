"""Dispatchers in a storm on its track: the bound holds, nobody sees the future."""

from __future__ import annotations

import numpy as np
import pytest

import resilience as rs
from resilience.case.days import held_out
from resilience.dispatch.memory import Memory
from resilience.dispatch.mpc import MPC
from resilience.dispatch.registry import DISPATCHERS
from resilience.dispatch.stochastic import Stochastic
from resilience.evaluation.compare import compare
from resilience.fragility.beliefs.belief import case_belief
from resilience.fragility.beliefs.bell_belief import BellBelief
from resilience.fragility.beliefs.storm_belief import StormBelief
from resilience.fragility.draw import sample_case
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.microgrid import Microgrid
from resilience.simulation.simulate import simulate
from resilience.simulation.world import World, microgrid_with_fallible_lines

CASE = "ieee33_rammasun"


@pytest.fixture(scope="module")
def world() -> World:
    case = held_out(rs.load_case(CASE))
    return World.build(Microgrid.build(case, "copperplate"), sample_case(case, 2, 5))


def test_nobody_beats_the_bound_in_a_storm() -> None:
    report = compare(CASE, ["rule", "mpc", "mpc-blind"], draws=2, seed=5)
    for name, cost in report.objective.items():
        assert (cost >= report.bound - 1e-6 * np.abs(report.bound)).all(), name
    assert report.world.microgrid.case.slots == 144
    assert len(report.world.scenarios.lines) == 32


def test_a_dispatcher_believes_in_the_storm_of_its_case(world: World) -> None:
    assert isinstance(MPC(world.setting).belief, StormBelief)
    assert isinstance(Stochastic(world.setting).belief, StormBelief)
    assert isinstance(case_belief(rs.load_case("ieee33"), ("1-2",)), BellBelief)


@pytest.mark.parametrize("name", ["mpc", "stochastic"])
def test_nobody_sees_the_future_in_a_storm(name: str) -> None:
    """Storms that differ from 14:00 on are met alike until then: eight hours from noon."""
    whole = held_out(rs.load_case(CASE))
    case = whole.replace(start=whole.start.replace(hour=10), slots=24)
    at = 16
    drawn = sample_case(case, 6, 2)
    shows = drawn.down[:, at:].any(axis=(0, 1)) & ~drawn.down[:, :at].all(axis=(0, 1))
    k = int(np.flatnonzero(shows)[0])
    storm = drawn.chosen(np.array([k]))
    calm = storm.down.copy()
    calm[:, at:] = calm[:, at - 1 : at]
    assert (calm != storm.down).any()
    other = Scenarios(storm.lines, calm, storm.probability)
    microgrid = Microgrid.build(case, "copperplate")
    one, two = (
        simulate(w, DISPATCHERS[name](w.setting))
        for w in (World.build(microgrid, storm), World.build(microgrid, other))
    )
    np.testing.assert_allclose(one.storage[:, :at], two.storage[:, :at], atol=1e-7)


def test_a_storm_is_remembered_over_midnight(world: World) -> None:
    memory = Memory(world.setting, daily=False)
    down = np.ones((37, 2), bool)
    for t in (94, 95, 96, 97):
        down[memory.lines[3], 0] = t == 94
        down[memory.lines[5], 0] = t != 94  # back after one slot
        seen = type("Seen", (), {"t": t, "line_up": down, "centre": np.full(2, -1)})()
        memory.update(seen)
    known = memory.history(seen, 0)
    assert (known.t, known.day) == (97, 0)
    assert known.since[3] == 95
    assert known.first[3] == 95
    assert known.down.shape == (32, 98)
    assert np.argwhere(known.down).tolist() == [[3, 95], [3, 96], [3, 97], [5, 94]]
    assert not memory.history(seen, 1).down.any()


def test_lines_that_a_case_thought_firm_fail_where_scenarios_say_so() -> None:
    """Buses that the copperplate merges part in a comparison over scenarios of their line."""
    case = held_out(rs.load_case("ieee33"), 1)
    down = np.zeros((1, case.slots, 1), bool)
    down[0, 40:60] = True
    report = compare("ieee33", ["rule"], days=1, scenarios=Scenarios(("5-6",), down, np.ones(1)))
    microgrid = report.world.microgrid
    assert "5-6" in microgrid.network.line_names
    assert microgrid_with_fallible_lines(
        case, report.world.scenarios, "copperplate"
    ).network.line_names == (microgrid.network.line_names)
