"""A state is checked like a case: every mistake at once, in words, and nothing is guessed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from resilience.errors import CaseError
from resilience.operation.operator import Operator
from resilience.operation.state import StateReader
from tests.unit.operation.plant import storm_case

CASE = storm_case(slots=12, step_min=60.0)
STATE: dict[str, Any] = {
    "time": "2016-07-12T05:20",
    "soc": {"ess1": 0.5},
    "energy_mwh": {"ess2": 0.7},
    "down": ["2-3"],
}


@pytest.fixture(scope="module")
def reader() -> StateReader:
    with Operator(CASE, "rule-0.9") as operator:
        return operator._reader


def without(*keys: str, **changes: Any) -> dict[str, Any]:
    return {k: v for k, v in (STATE | changes).items() if k not in keys}


def keys_of(reader: StateReader, state: Any) -> list[tuple[str, str]]:
    with pytest.raises(CaseError) as refused:
        reader.read(state)
    assert all(m.file == "state" for m in refused.value.mistakes)
    return [(m.key, m.value) for m in refused.value.mistakes]


def test_a_state_is_what_it_says(reader: StateReader) -> None:
    state = reader.read(without(hazard_peak="14:50", forecast={"load": [0.7, 0.8]}))
    assert state.t == 5
    assert state.energy[:, 0].tolist() == [0.5 * 1.3, 0.7]
    down = [name for name, up in zip(CASE.elements, state.line_up[:, 0], strict=True) if not up]
    assert down == ["2-3"]
    assert state.centre == 59
    assert state.forecast["load"].tolist() == [0.7, 0.8]
    assert reader.read(dict(state.stated)).energy.tolist() == state.energy.tolist()


def test_all_mistakes_come_together(reader: StateReader) -> None:
    state = without(
        time="2016-07-12T05:20+02:00",
        down=["1-3"],
        energy_mwh={"ess3": 1.0},
        forecast={"sum": [1]},
        hazard_peak="24:10",
        tank_m3={"t": 1.0},
        devices={"generator.on": {"generator1": 1}},
    )
    assert keys_of(reader, state) == [
        ("time", "2016-07-12T05:20:00+02:00"),
        ("energy_mwh.ess3", "an unknown name"),
        ("soc.ess2", "nothing"),
        ("down", '"1-3"'),
        ("tank_m3.t", "an unknown name"),
        ("forecast.sum", "an unknown name"),
        ("devices.generator.on", "an unknown name"),
        ("hazard_peak", '"24:10"'),
    ]


@pytest.mark.parametrize(
    ("state", "mistakes"),
    [
        (without("down"), [("down", "nothing")]),
        (without("time"), [("time", "nothing")]),
        (without("soc"), [("soc.ess1", "nothing")]),
        (without(time="noon"), [("time", '"noon"')]),
        (without(time="2016-07-11T23:59"), [("time", "2016-07-11T23:59:00")]),
        (without(time="2016-07-12T12:00"), [("time", "2016-07-12T12:00:00")]),
        (without(soc={"ess1": 50}), [("soc.ess1", "50")]),
        (without(soc={"ess1": float("nan")}), [("soc.ess1", "nan")]),
        (without(soc={"ess1": "0.5"}), [("soc.ess1", '"0.5"')]),
        (without(soc={"ess1": 0.5, "ess2": 0.5}),
         [("soc.ess2", "both soc and energy_mwh")]),
        (without(energy_mwh={"ess2": 2.2}), [("energy_mwh.ess2", "2.2")]),
        (without(energy_mwh={"ess2": -0.1}), [("energy_mwh.ess2", "-0.1")]),
        (without(down="2-3"), [("down", '"2-3"')]),
        (without(down=[7]), [("down", '"7"')]),
        (without(forecast={"load": 0.5}), [("forecast.load", "0.5")]),
        (without(forecast={"load": [1e999]}), [("forecast.load[1]", "inf")]),
        (without(hazard_peak="7:30"), [("hazard_peak", '"7:30"')]),
        (without(colour="red"), [("colour", "an unknown key")]),
        ([], [("", "[]")]),
        (None, [("", "None")]),
    ],
)  # fmt: skip
def test_a_mistake_is_named(
    reader: StateReader, state: Any, mistakes: list[tuple[str, str]]
) -> None:
    assert keys_of(reader, state) == mistakes


def test_a_storage_beyond_its_band_is_taken_to_be_at_its_edge(reader: StateReader) -> None:
    state = reader.read(without(energy_mwh={"ess2": 0.1}, soc={"ess1": 1.0}))
    assert state.energy[:, 0].tolist() == [1.3 * 0.9, 2.1 * 0.15]
    assert state.notes == (
        "ess1 holds 1.3 MWh, beyond soc_min or soc_max: decided as if it held 1.17",
        "ess2 holds 0.1 MWh, beyond soc_min or soc_max: decided as if it held 0.315",
    )


def test_a_forecast_is_taken_from_the_present_slot_on(reader: StateReader) -> None:
    with Operator(CASE, "rule-0.9") as operator:
        state = reader.read(without(forecast={"load": [0.25, 0.5]}))
        observation, slot = operator._present.observed(state, operator._carried)
        ahead = np.array([5, 6, 7, 11, 40])
        expected = [0.25, 0.5, *CASE.profile("load")[[7, 11, 11]]]
        assert observation.forecast("load", ahead)[:, 0].tolist() == expected
        assert slot.data["load.demand"][:, 0].tolist() == [0.25 * 0.7, 0.25 * 1.1]


def test_nothing_is_remembered_of_a_state_with_mistakes() -> None:
    with Operator(CASE, "rule-0.9") as operator:
        with pytest.raises(CaseError):
            operator.decide(without("down"))
        assert operator.health()["decisions"] == 0
        assert not operator.decide(STATE).repeated
