"""What `mpc` and `mpc-blind` ask their program, worked out by hand; `test_rolling` is about the
answers.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from resilience.arrays import Bools, Floats, Ints
from resilience.case import Case
from resilience.dispatch.mpc import MPC, BlindMPC
from resilience.dispatch.window_program import WindowRequest, WindowSteps
from resilience.fragility.beliefs.history import LineHistory
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.microgrid import Microgrid
from resilience.simulation.observation import Observation, parts_of
from resilience.simulation.setting import Setting
from resilience.simulation.world import World
from resilience.testing import small_case

STEPS = WindowSteps(slots=2, blocks=2, block_slots=3)  # slots 0, 1, 2 to 4 and 5 to 7 from now
GROWTH = np.array([0.02, 0.03])  # of demand from slot to slot, by scenario
ENERGY = np.array([[1.1, 1.3], [2.1, 2.3]])


class Omen:
    """A belief in 3-4 and 2-3: since slot 2 the second is down, since slot 3 the first, or else it
    has no answer.
    """

    daily, overnight = False, True
    longest_slots = 2

    def __init__(self) -> None:
        self.asked: list[tuple[LineHistory, int]] = []

    def paths(self, history: LineHistory, slots: int, n: int) -> Bools:
        raise NotImplementedError

    def chances(self, history: LineHistory, slots: int) -> Floats:
        """Rising from slot to slot."""
        self.asked.append((history, slots))
        since = tuple(history.since.tolist())
        growth = {(-1, 2): (0.04, 0.03), (3, -1): (0.02, 0.05)}[since]
        return np.outer(growth, np.arange(1, 9))

    def expected_left(self, history: LineHistory) -> Ints:
        """Slots more."""
        since = tuple(history.since.tolist())
        return np.array({(-1, 2): [0, 1], (3, -1): [2, 0]}[since])


def street() -> Case:
    """Four buses in a row, of which the last two may be cut off; unequal stores and loads there."""
    return small_case(
        slots=14,
        step_min=30.0,
        buses=4,
        lines=[(1, 2, 0.01, 0.02), (2, 3, 0.03, 0.02), (3, 4, 0.02, 0.04)],
        line_tables=[{"name": "2-3", "breakpoint": True}, {"name": "3-4", "breakpoint": True}],
        profiles={
            "demand": [0.5] * 14,
            "price": [3.1, 2.9, 3.3, 2.8, 3.2, 2.7, 3.4, 2.6, 3.5, 2.4, 3.6, 2.0, 5.0, 3.0],
        },
        load=[
            {"bus": "3", "p_max_mw": 3.0, "shed_cost_per_mwh": 19.0, "profile": "demand"},
            {"bus": "4", "p_max_mw": 1.2, "shed_cost_per_mwh": 17.0, "profile": "demand"},
        ],
        ess=[
            {"bus": "3", "p_max_mw": 2.0, "e_mwh": 5.0, "soc_min": 0.1, "soc_initial": 0.4}
            | {"efficiency_charge": 0.8, "efficiency_discharge": 0.9}
            | {"degradation_cost_per_mwh": 0.5},
            {"bus": "4", "p_max_mw": 1.5, "e_mwh": 4.0, "soc_min": 0.2, "soc_initial": 0.6}
            | {"efficiency_charge": 0.9, "efficiency_discharge": 0.6}
            | {"degradation_cost_per_mwh": 0.25},
        ],
        generator=[{"bus": "2", "p_max_mw": 0.8, "cost_per_mwh": 6.0}],
        grid=[{"import_max_mw": 9.0, "import_cost_per_mwh": 1.0, "price_profile": "price"}],
    ).replace(reserve_price_per_mwh=7.5)


@pytest.fixture
def setting() -> Setting:
    """Two scenarios; who draws outages names the lines in another order than the case."""
    none = Scenarios(("3-4", "2-3"), np.zeros((2, 14, 2), bool), np.array([0.4, 0.6]))
    microgrid = Microgrid.build(street(), "copperplate")
    return World.build(microgrid, none, end_value_per_mwh=1.5).setting


def slot(setting: Setting, t: int) -> Observation:
    """Line 2-3 is down in the first scenario from slot 2 on, 3-4 in the second from slot 3 on."""
    up = np.array([[True, True], [t < 2, True], [True, t < 3]])
    blank = np.zeros((4, 2))
    return Observation(
        t,
        ENERGY,
        up,
        blank.astype(np.intp),
        np.array([31, 47]),
        lambda name, at: (name == "demand") * at[:, None] * GROWTH,
        blank,
    )


def noted(
    monkeypatch: pytest.MonkeyPatch, program: object, answers: list[list[float]]
) -> list[WindowRequest]:
    """What a program is asked from now on; it answers one after the other."""
    requests: list[WindowRequest] = []

    def decisions(request: WindowRequest) -> tuple[Floats, Floats]:
        requests.append(request)
        return np.array(answers[len(requests) - 1]), np.empty(0)

    monkeypatch.setattr(program, "decisions", decisions)
    return requests


Asks = Callable[[int], tuple[MPC, Omen, list[WindowRequest], Floats]]


@pytest.fixture
def asks(setting: Setting, monkeypatch: pytest.MonkeyPatch) -> Asks:
    """An `mpc` that has seen every slot so far, and what it asks in this one."""

    def ask(t: int) -> tuple[MPC, Omen, list[WindowRequest], Floats]:
        omen = Omen()
        mpc = MPC(setting, omen, STEPS)
        for before in range(t):
            mpc.memory.update(slot(setting, before))
        requests = noted(monkeypatch, mpc.program, [[0.3, -0.2], [0.7, -0.9]])
        return mpc, omen, requests, parts_of(mpc.act(slot(setting, t)))[0]

    return ask


def test_each_scenario_is_asked_for_by_itself(asks: Asks) -> None:
    """Its energy, its forecast, its memory; and what comes back is for it alone."""
    _, omen, (first, second), power = asks(5)
    assert power.tolist() == [[0.3, 0.7], [-0.2, -0.9]]
    for k, request in enumerate((first, second)):
        assert request.t == 5
        assert request.energy.tolist() == ENERGY[:, k].tolist()
        assert request.probability.tolist() == [1.0]
        at = np.array([6, 9])
        assert request.forecast("demand", at).tolist() == (at * GROWTH[k]).tolist()
    (early, slots), (late, _) = omen.asked
    assert slots == 8
    assert (early.t, early.storm_peak, late.storm_peak) == (5, 31, 47)
    assert early.down is not None
    assert early.down.astype(int).tolist() == [[0, 0, 0, 0, 0, 0], [0, 0, 1, 1, 1, 1]]


def test_a_line_is_expected_back_after_what_the_belief_says(asks: Asks) -> None:
    """In slot 5 line 2-3 is down for one slot more, 3-4 for two: the next slot, and a part of the
    block behind it, for which a part is as good as all.
    """
    *_, (first, second), _ = asks(5)
    assert first.up[:, :, 0].astype(int).tolist() == [[1, 1, 1, 1], [0, 0, 1, 1], [1, 1, 1, 1]]
    assert second.up[:, :, 0].astype(int).tolist() == [[1, 1, 1, 1], [1, 1, 1, 1], [0, 0, 0, 1]]


def test_energy_is_worth_what_it_is_behind_the_window(asks: Asks) -> None:
    """Eight slots from slot 3 on end at slot 11. In slot 13 a MWh of the first store sells for
    (3 - 0.5) 0.9 = 2.25, in slot 12 for 4.05; in slot 11 another costs 2 / 0.8. For the second it
    is 2.85 in slot 12, but 2 / 0.9 to buy one in slot 11. Beyond the horizon there is its end.
    """
    *_, (first, second), _ = asks(3)
    assert first.value == pytest.approx([2.5, 2.0 / 0.9])
    assert second.value == pytest.approx([2.5, 2.0 / 0.9])
    *_, (late, _), _ = asks(5)
    assert late.value == pytest.approx([2.25, (3.0 - 0.25) * 0.6])
    *_, (last, _), _ = asks(9)
    assert last.value == pytest.approx([1.5, 1.5])


def test_the_reserve_is_for_a_failure_behind_the_end_of_each_step(asks: Asks) -> None:
    """From slot 3, steps end with slots 3, 4, 7 and 10, and outages last two slots of half an hour:
    slots 4 and 5, 5 and 6, 8 and 9, 11 and 12. Demand of bus 3 is 3 MW times 0.02 per slot, which
    takes a store 0.9; that of bus 4 is 1.2 MW and 0.6. The floors are 0.5 and 0.8 MWh.

    From slot 9 the last two outages lie beyond slot 13, which is repeated.
    """
    pairs = np.array([4 + 5, 5 + 6, 8 + 9, 11 + 12])
    late_pairs = np.array([10 + 11, 11 + 12, 13 + 13, 13 + 13])
    for t, slots in ((3, pairs), (9, late_pairs)):
        *_, requests, _ = asks(t)
        for k, request in enumerate(requests):
            assert request.reserve is not None
            per_slot = 0.5 * GROWTH[k]
            by_hand = [0.5 + 3.0 * per_slot * slots / 0.9, 0.8 + 1.2 * per_slot * slots / 0.6]
            np.testing.assert_allclose(request.reserve[0], by_hand)


def test_the_reserve_is_priced_by_the_chance_of_being_cut_off(asks: Asks) -> None:
    """Bus 3 by line 2-3, bus 4 by both; over the slots of a step, chances add up."""
    *_, requests, _ = asks(5)
    for request, (far, near) in zip(requests, ((0.04, 0.03), (0.02, 0.05)), strict=True):
        assert request.reserve is not None
        cut = [
            [near * n for n in range(1, 9)],
            [1.0 - (1.0 - near * n) * (1.0 - far * n) for n in range(1, 9)],
        ]
        by_hand = [[7.5 * x for x in (c[0], c[1], sum(c[2:5]), sum(c[5:8]))] for c in cut]
        np.testing.assert_allclose(request.reserve[1], by_hand)


def test_blind_mpc_takes_the_lines_as_they_are(
    setting: Setting, monkeypatch: pytest.MonkeyPatch
) -> None:
    mpc = BlindMPC(setting, slots=3, value_per_mwh=2.7)
    requests = noted(monkeypatch, mpc.program, [[0.3, -0.2], [0.7, -0.9]])
    power = parts_of(mpc.act(slot(setting, 5))).power
    assert power.tolist() == [[0.3, 0.7], [-0.2, -0.9]]
    for k, (request, down) in enumerate(zip(requests, (1, 2), strict=True)):
        assert request.t == 5
        assert request.energy.tolist() == ENERGY[:, k].tolist()
        assert request.up.shape == (3, 3, 1)
        assert request.up.sum(axis=(1, 2)).tolist() == [3 * (line != down) for line in range(3)]
        assert request.probability.tolist() == [1.0]
        assert request.value.tolist() == [2.7, 2.7]
        assert request.forecast("demand", np.array([6])).tolist() == [6 * GROWTH[k]]
        assert request.reserve is None
