"""An operator decides what `simulate` has decided, whatever happens in between."""

from __future__ import annotations

import errno
import json
import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from resilience.arrays import Floats
from resilience.dispatch.registry import DISPATCHERS, register_dispatcher
from resilience.errors import UsageError
from resilience.operation.journal import read_journal
from resilience.operation.operator import Operator, alike
from resilience.operation.present import Present
from resilience.simulation.observation import Observation
from resilience.simulation.setting import Setting
from resilience.text.operation import print_answer
from tests.unit.operation.plant import ERROR, Plant, simulated, storm_case, storm_world

TOLERANCE = 1e-6  # $
SHORT = 12  # slots


class Watched:
    """Charges a little more in every slot, and notes which ones it has seen."""

    def __init__(self, setting: Setting) -> None:
        self.name, self.seen = "watched", list[int]()
        self.on_slot: Callable[[int], object] = lambda t: None

    def act(self, observation: Observation) -> Floats:
        self.seen.append(observation.t)
        self.on_slot(observation.t)
        return np.full_like(observation.energy, 0.01 * len(self.seen))


@pytest.fixture
def watched(monkeypatch: pytest.MonkeyPatch) -> list[Watched]:
    """Every dispatcher `watched` that was made."""
    made: list[Watched] = []

    def make(setting: Setting) -> Watched:
        made.append(Watched(setting))
        return made[-1]

    monkeypatch.setattr("resilience.dispatch.registry.DISPATCHERS", DISPATCHERS.copy())
    register_dispatcher("watched", make)
    return made


CASE = storm_case(slots=SHORT, step_min=60.0)
WORLD = storm_world(CASE)


def plain(t: int, **changes: Any) -> dict[str, Any]:
    return Plant(WORLD).state(t) | changes


def run(operator: Operator, plant: Plant, first: int, stop: int) -> list[dict[str, Any]]:
    """What is answered from one slot to another, the plant doing as it is told."""
    answers = []
    for t in range(first, stop):
        answer = operator.decide(plant.state(t))
        assert answer.slot == t
        assert answer.fallback is None, answer.fallback
        plant.act(t, answer.power_mw)
        answers.append(answer.summary())
    return answers


@pytest.mark.parametrize("method", ["rule-0.9", "greedy", "mpc", "stochastic"])
def test_a_day_costs_what_the_simulator_says(method: str) -> None:
    case = storm_case(slots=32, step_min=45.0)
    world = storm_world(case, ERROR)
    expected = simulated(world, method)
    assert (~world.line_up).sum() >= 10
    plant = Plant(world)
    with Operator(case, method, forecast_error=ERROR) as operator:
        answers = run(operator, plant, 0, case.slots)
    assert plant.cost == pytest.approx(expected.cost.sum(), abs=TOLERANCE)
    assert sum(a["cost"] for a in answers) == pytest.approx(expected.cost.sum(), abs=TOLERANCE)
    energy = [[a["energy_mwh"][u.name] for a in answers] for u in case.ess]
    assert np.abs(energy - expected.energy[:, 1:, 0]).max() < TOLERANCE
    shed = [sum(a["shed_mw"].values()) for a in answers]
    assert np.abs(shed - expected.shed.sum((0, 2))).max() < TOLERANCE
    assert expected.shed.sum() > 0.1


def test_what_units_carry_goes_from_one_decision_to_the_next() -> None:
    generator = {"bus": "2", "p_max_mw": 0.9, "p_min_mw": 0.4, "cost_per_mwh": 0.2,
                 "start_cost": 0.3}  # fmt: skip
    case = storm_case(slots=SHORT, step_min=60.0, generator=[generator])
    world = storm_world(case)
    expected = simulated(world, "mpc")
    energy = world.start()
    with Operator(case, "mpc") as operator:
        for t in range(case.slots):
            stored = {u.name: float(e) for u, e in zip(case.ess, energy[:, 0], strict=True)}
            answer = operator.decide(Plant(world).state(t) | {"energy_mwh": stored})
            assert answer.cost == pytest.approx(expected.cost[t, 0], abs=TOLERANCE)
            assert answer.running["generator1"] == bool(expected.decided("generator.on")[0, t, 0])
            energy = np.array([[answer.energy_mwh[u.name]] for u in case.ess])
    runs = expected.decided("generator.on")[0, :, 0]
    assert 0 < runs.sum() < case.slots


@pytest.mark.parametrize("method", ["mpc", "stochastic"])
def test_who_starts_anew_goes_on_as_if_nothing_had_been(method: str, tmp_path: Path) -> None:
    expected, plant, log = simulated(WORLD, method), Plant(WORLD), tmp_path / "log.jsonl"
    for first, stop in ((0, 5), (5, 6), (6, SHORT)):
        with Operator(CASE, method, log=log) as operator:
            assert not operator.warnings
            run(operator, plant, first, stop)
        with log.open("ab") as file:  # what was not written to its end counts for nothing
            file.write(b'{"logged":"2016-')
    assert plant.cost == pytest.approx(expected.cost.sum(), abs=TOLERANCE)
    with Operator(CASE, method, log=log) as operator:
        assert [answer.slot for answer in operator.answers] == [*range(SHORT)]


def test_a_slot_is_decided_once(watched: list[Watched]) -> None:
    with Operator(CASE, "watched") as operator:
        first = operator.decide(plain(3))
        again = operator.decide(plain(3, energy_mwh={"ess1": 0.3, "ess2": 0.9}, down=["1-2"]))
        assert again.power_mw == first.power_mw
        assert (first.repeated, again.repeated) == (False, True)
        assert again.notes == ["the slot was decided with another down, energy_mwh"]
        assert operator.decide(plain(3)).notes == []
    assert watched[0].seen == [3]


def test_a_hundred_who_ask_at_once_get_one_decision(watched: list[Watched], tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    with Operator(CASE, "watched", log=log) as operator, ThreadPoolExecutor(100) as pool:
        answers = list(pool.map(lambda _: operator.decide(plain(2)), range(100)))
    assert len({json.dumps(dict(a.power_mw)) for a in answers}) == 1
    assert sum(not a.repeated for a in answers) == 1
    assert watched[0].seen == [2]
    assert len(read_journal(log)[1]) == 1


def test_slots_that_nobody_asked_for_are_noticed_as_they_were_before(
    watched: list[Watched],
) -> None:
    noticed = list[int]()
    with Operator(CASE, "watched") as operator:
        operator.decide(plain(2, down=["2-3"]))
        watched[0].on_slot = noticed.append
        answer = operator.decide(plain(6, down=[]))
    assert noticed == [3, 4, 5, 6]
    assert answer.notes[0] == "nothing was told of 03:00 to 06:00: taken as before it"
    assert "nothing is out" in answer.why[0]


def test_a_clock_that_goes_back_is_answered_by_the_rule(watched: list[Watched]) -> None:
    with Operator(CASE, "watched") as operator:
        operator.decide(plain(3))
        ahead = operator.decide(plain(8))
        back = operator.decide(plain(4))
        assert back.decided_by == "rule-0.9"
        assert str(back.fallback) == (
            "the clock went back: 08:00 has been decided, and this slot has not"
        )
        assert operator.decide(plain(8)).power_mw == ahead.power_mw
        assert operator.decide(plain(9)).decided_by == "watched"
    assert watched[0].seen == [3, 4, 5, 6, 7, 8, 9]  # 4 to 7 as nobody told of them


def rule_power(t: int) -> dict[str, float]:
    with Operator(CASE, "rule-0.9") as operator:
        return dict(operator.decide(plain(t)).power_mw)


def test_a_late_decision_is_the_rules_and_the_method_still_notices(
    watched: list[Watched], tmp_path: Path
) -> None:
    log, released = tmp_path / "log.jsonl", threading.Event()
    with Operator(CASE, "watched", log=log, time_limit_s=0.2) as operator:
        watched[0].on_slot = lambda t: released.wait(20.0) if t == 3 else None
        late = operator.decide(plain(3))
        assert late.decided_by == "rule-0.9"
        assert str(late.fallback) == "no answer in time: nothing within 0.2 s"
        assert late.power_mw == rule_power(3)
        released.set()
        operator.time_limit_s = 20.0
        operator._watch.time_limit_s = 20.0
        punctual = operator.decide(plain(4))
        assert punctual.decided_by == "watched"
    with Operator(CASE, "watched", log=log) as operator:  # late is late, done again
        assert not operator.warnings
        assert [a.fallback is None for a in operator.answers] == [False, True]
        assert operator.decide(plain(5)).decided_by == "watched"
    assert [w.seen for w in watched] == [[3, 4], [3, 4, 5]]


def failing(_: int) -> None:
    raise RuntimeError("the solver gave up")


@pytest.mark.parametrize(
    ("action", "words"),
    [
        (failing, "no answer: RuntimeError: the solver gave up"),
        (np.full((2, 1), np.nan),
         "an answer that cannot be carried out: power holds what is no number"),
        (np.zeros((3, 1)),
         "an answer that cannot be carried out: an action of shape (3, 1); allowed: (2, 1)"),
    ],
)  # fmt: skip
def test_a_failing_method_is_replaced_by_the_rule_and_says_so(
    action: Any, words: str, watched: list[Watched], monkeypatch: pytest.MonkeyPatch
) -> None:
    with Operator(CASE, "watched") as operator:
        if callable(action):
            watched[0].on_slot = action
        else:
            monkeypatch.setattr(watched[0], "act", lambda _: action)
        answer = operator.decide(plain(3))
        assert (answer.decided_by, str(answer.fallback)) == ("rule-0.9", words)
        assert answer.power_mw == rule_power(3)
        assert operator.health()["by_rule"] == 1


def test_a_step_that_fails_the_audit_is_replaced_by_the_rule(
    watched: list[Watched], monkeypatch: pytest.MonkeyPatch
) -> None:
    right, calls = Present.step, list[int]()

    def wrong(present: Present, observation: Observation, decision: Any) -> Any:
        from dataclasses import replace

        step = right(present, observation, decision)
        calls.append(observation.t)
        return replace(step, energy=step.energy + 0.01) if len(calls) == 1 else step

    monkeypatch.setattr(Present, "step", wrong)
    with Operator(CASE, "watched") as operator:
        answer = operator.decide(plain(3))
    assert answer.decided_by == "rule-0.9"
    assert "ess.dynamics[ess" in str(answer.fallback)
    assert answer.power_mw == rule_power(3)


def test_an_answer_is_given_though_the_disk_is_full_and_logged_later(
    watched: list[Watched], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = tmp_path / "log.jsonl"
    with Operator(CASE, "watched", log=log) as operator:

        def full(_: int) -> None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        with monkeypatch.context() as patch:
            patch.setattr("resilience.operation.journal.os.fsync", full)
            first = operator.decide(plain(3))
            assert first.notes == [f"not in the log: cannot write {log}: no space left on device"]
            assert operator.health()["status"] == "unwritten"
            assert read_journal(log)[1] == []
        assert operator.decide(plain(3)).power_mw == first.power_mw
        assert operator.health()["status"] == "ok"
        operator.decide(plain(4))
    assert [record["answer"]["slot"] for record in read_journal(log)[1]] == [3, 4]
    assert watched[0].seen == [3, 4]


def test_a_log_is_of_one_process_case_and_method(tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    with Operator(CASE, "rule-0.9", log=log), pytest.raises(UsageError, match="in use by another"):
        Operator(CASE, "rule-0.9", log=log)
    with Operator(CASE, "idle", log=log) as operator:  # nothing was decided: it begins anew
        assert read_journal(log) == (operator.head, [])
    with Operator(CASE, "rule-0.9", log=log) as operator:
        run(operator, Plant(WORLD), 0, 1)
    with pytest.raises(UsageError, match="the log of another method"):
        Operator(CASE, "greedy", log=log)
    with pytest.raises(UsageError, match="the log of another case\n"):
        Operator(CASE.with_ess("ess1", e_mwh=1.5), "rule-0.9", log=log)
    lines = log.read_text().splitlines()
    log.write_text("\n".join([*lines, "no JSON", ""]))
    with pytest.raises(UsageError, match="line 3: no record"):
        Operator(CASE, "rule-0.9", log=log)


def test_a_log_that_was_changed_comes_out_otherwise(tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    with Operator(CASE, "rule-0.9", log=log) as operator:
        run(operator, Plant(WORLD), 0, 4)
    head, records = read_journal(log)
    with Operator(CASE, "rule-0.9") as operator:
        assert dict(operator.head) == head
        assert all(alike(*operator.redone(record)) for record in records)
    records[2]["answer"]["power_mw"]["ess1"] += 1e-6
    log.write_text("".join(json.dumps(r) + "\n" for r in [head, *records]))
    with Operator(CASE, "rule-0.9") as operator:
        assert operator.differing(records) == [2]
    with Operator(CASE, "rule-0.9", log=log) as operator:
        (warning,) = operator.warnings
        assert warning.startswith(
            "1 decisions of the log come out otherwise now, the first at 02:00"
        )
        # What was given away stays what is answered.
        given = records[2]["answer"]["power_mw"]
        assert operator.decide(records[2]["state"]).power_mw == given


@pytest.mark.parametrize("method", ["rule-0.9", "mpc", "stochastic"])
def test_the_plan_begins_with_the_decision(method: str) -> None:
    with Operator(CASE, method) as operator:
        assert operator.plan() is None
        for t in (3, 4):
            answer = operator.decide(plain(t))
            plan = operator.plan()
            assert plan is not None
            assert (plan.first[0], plan.stop[0], plan.stop[-1]) == (t, t + 1, SHORT)
            assert (plan.first[1:] == plan.stop[:-1]).all()
            for k, name in enumerate(plan.units):
                assert plan.energy_mwh[k, 0] == pytest.approx(answer.energy_mwh[name], abs=1e-6)
                assert plan.storage_mw[k, 0] == pytest.approx(answer.power_mw[name], abs=1e-6)
            # What is fed in is what loads take, in every step.
            demand = 0.0 - sum(answer.power_mw[f"load{k}"] for k in (1, 2))
            fed = plan.storage_mw.sum(0) + plan.generator_mw + plan.weather_mw + plan.grid_mw
            assert fed[0] == pytest.approx(demand, abs=1e-6)
            assert (plan.lowest_mwh <= plan.energy_mwh.sum(0) + 1e-9).all()
            assert (plan.highest_mwh >= plan.energy_mwh.sum(0) - 1e-9).all()


def test_a_roll_out_is_what_the_rule_goes_on_to_do() -> None:
    calm = storm_world(CASE)
    calm.scenarios.down[:] = False
    expected = simulated(calm, "rule-0.9")
    with Operator(CASE, "rule-0.9") as operator:
        operator.decide(Plant(calm).state(0))
        plan = operator.plan()
    assert plan is not None
    assert np.abs(plan.energy_mwh - expected.energy[:, 1:, 0]).max() < 1e-12


@pytest.mark.parametrize("width", [60, 80])
def test_no_number_of_an_answer_is_cut_off(width: int) -> None:
    with Operator(CASE, "mpc") as operator:
        answer, plan = operator.decide(plain(3)), operator.plan_summary()
    file = StringIO()
    print_answer(answer, plan, Console(file=file, width=width))
    text = file.getvalue()
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= width
    first = plan["steps"][0]
    for number in (sum(first["storage_mw"].values()), first["grid_mw"]):
        assert f"{number:+.3f}" in text
    assert f"{first['lowest_mwh']:.2f}-{first['highest_mwh']:.2f}" in text
