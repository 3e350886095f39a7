"""What a plan asks operators to do: instructions, schedules, and answers to a first failure."""

from __future__ import annotations

from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

import resilience as rs
from resilience.case import Case
from resilience.errors import UsageError
from resilience.planning.plan import load_plan
from resilience.planning.reading.instructions import instructions
from resilience.planning.scenarios.first_failures import FirstFailure, UnitResponse, first_failures
from resilience.planning.scenarios.plan import ScenarioPlan
from resilience.planning.tables import SlotTable
from resilience.testing import small_case
from resilience.text.actions import action_list, action_rows, failure_cells, mw_range, schedule
from resilience.text.plan import print_plan
from resilience.text.scenario_plan import print_scenario_plan

SLOTS = 12


def ring() -> Case:
    """Half hours; a battery, two diesels of which one is committed, PV, and a tie line."""
    return small_case(
        slots=SLOTS,
        step_min=30,
        buses=3,
        lines=[(1, 2, 0.001, 0.001), (2, 3, 0.001, 0.001), (1, 3, 0.001, 0.001)],
        line_tables=[{"name": "1-3", "switchable": True}],
        outages=["1-3@02:00-03:00"],
        profiles={"sun": [0.0] * 4 + [1.0] * 4 + [0.0] * 4},
        load=[{"bus": "2", "p_max_mw": 2.0, "shed_cost_per_mwh": 10.0}],
        pv=[{"bus": "3", "p_max_mw": 1.0, "profile": "sun"}],
        ess=[{"bus": "3", "p_max_mw": 1.0, "e_mwh": 4.0}],
        generator=[
            {"name": "gen1", "bus": "2", "p_max_mw": 1.0, "cost_per_mwh": 3.0},
            {"name": "gen2", "bus": "2", "p_max_mw": 1.0, "p_min_mw": 0.2, "start_cost": 1.0},
        ],
        grid=[{"import_max_mw": 5.0, "import_cost_per_mwh": 0.3}],
    )


def series(**values: list[float]) -> SlotTable:
    rows = [row + [0.0] * (SLOTS - len(row)) for row in values.values()]
    return SlotTable(tuple(values), np.array(rows))


def tables() -> dict[str, SlotTable]:
    """Tables as a solve would give them, by hand."""
    return {
        "power": series(
            ess1=[-0.4, -0.5, 0.0, 0.0, -0.2, 0.0, 0.0, 0.0, 0.6, -0.1, 0.5],
            gen1=[0.0, 1.0, 0.0, 0.8, 0.0, 0.0, 0.0, 0.5],
            gen2=[0.0, 0.5, 0.0, 0.3],
            pv1=[0.0] * 4 + [1.0, 0.7, 0.4, 1.0],
            grid1=[1.0] * SLOTS,
            load1=[-2.0] * SLOTS,
        ),
        "energy": series(ess1=[2.2, 2.4, 2.4, 2.4, 2.5, 2.5, 2.5, 2.5, 2.2, 2.25, 2.0, 2.0]),
        "on": series(gen2=[0.0, 1.0, 0.0, 1.0]),
        "pv_available": series(pv1=[0.0] * 4 + [1.0] * 4),
        "demand": series(load1=[2.0] * SLOTS),
        "shed": series(load1=[0.0] * 9 + [0.25, 0.1]),
        "line_closed": series(**{
            "1-2": [1.0] * SLOTS, "2-3": [1.0] * SLOTS,
            "1-3": [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0],
        }),
    }  # fmt: skip


def test_every_unit_is_asked_for_what_its_tables_hold() -> None:
    """Pauses of an hour are joined, but not with the other way between, nor where a start costs."""
    asked = instructions(ring(), tables())
    ours = [(one.first, one.stop, one.verb, one.unit) for one in asked]
    assert ours == [
        (0, 5, "charge", "ess1"),
        (1, 1, "open", "1-3"),
        (1, 2, "run", "gen2"),
        (1, 4, "run", "gen1"),
        (3, 4, "run", "gen2"),
        (5, 7, "curtail", "pv1"),
        (6, 6, "close", "1-3"),
        (7, 8, "run", "gen1"),
        (8, 9, "discharge", "ess1"),
        (9, 9, "open", "1-3"),
        (9, 10, "charge", "ess1"),
        (9, 11, "shed", "load1"),
        (10, 11, "discharge", "ess1"),
    ]
    charge = asked[0]
    assert (charge.low_mw, charge.high_mw, charge.stored_mwh) == (0.0, 0.5, 2.5)
    shed = next(one for one in asked if one.verb == "shed")
    assert (shed.low_mw, shed.high_mw) == (0.1, 0.25)
    assert np.isnan(shed.stored_mwh)


def test_instructions_add_up_to_the_plan() -> None:
    """On a real plan: no slot in which a unit does something is left out, none is there twice."""
    plan = rs.solve("ieee33", "lp")
    assert plan.case is not None
    asked = plan.instructions()
    sizes = {unit.name: unit.p_max_mw for unit in plan.case.ess}
    sizes |= {unit.name: unit.p_max_mw for unit in plan.case.generator}
    for name, size in sizes.items():
        power = plan.tables["power"][name]
        mine = [one for one in asked if one.unit == name]
        covered = np.zeros(len(power), int)
        for one in mine:
            covered[one.first : one.stop] += 1
            inside = np.abs(power[one.first : one.stop])
            assert one.high_mw == pytest.approx(inside.max())
            assert np.all(np.sign(power[one.first : one.stop]) * (
                -1 if one.verb == "charge" else 1) >= -1e-9) or one.low_mw == 0.0  # fmt: skip
        assert covered.max(initial=0) <= 1
        assert (covered[np.abs(power) > 2e-3 * size] == 1).all()


def test_the_frame_has_a_row_per_instruction(tmp_path: Path) -> None:
    plan = rs.solve("ieee33", "lp")
    frame = plan.actions()
    assert len(frame) == len(plan.instructions())
    assert list(frame.columns) == [
        "start", "stop", "do", "unit", "low_mw", "high_mw", "stored_mwh"
    ]  # fmt: skip
    assert frame.start.is_monotonic_increasing
    again = load_plan(plan.save(tmp_path / "plan"))
    assert again.actions().equals(frame)
    (tmp_path / "plan" / "case.toml").unlink()
    with pytest.raises(UsageError, match="without its case"):
        load_plan(tmp_path / "plan").actions()


def shown(*things: object, width: int) -> str:
    file = StringIO()
    console = Console(file=file, width=width)
    for thing in things:
        console.print(thing)
    return file.getvalue()


def test_the_list_says_who_when_and_how_much() -> None:
    text = shown(action_list(ring(), instructions(ring(), tables()), "To do"), width=80)
    lines = [line.strip() for line in text.splitlines()]
    assert lines[0] == "To do: mean MW, and MWh stored at the end"
    assert lines[1] == "00:00-02:30  charge ess1 at 0-0.5 MW to 2.5 MWh"
    assert "00:30        open 1-3" in lines
    assert "04:30-05:30  shed load1 by 0.1-0.25 MW" in lines
    assert shown(action_list(ring(), [], "To do"), width=80).count("nothing") == 1


def test_the_list_says_which_storage_rests() -> None:
    """A unit that is asked for something rests at all other times, one that is not always does."""
    devices = [{"name": name, "bus": "1", "p_max_mw": 1.0, "e_mwh": 4.0} for name in "abc"]
    case = small_case(slots=SLOTS, ess=devices, generator=[{"bus": "1", "p_max_mw": 1.0}])
    idle = [0.0] * SLOTS
    powers = series(a=[-0.5], b=[0.0, 0.0, 0.7], c=idle, generator1=idle)
    asked = instructions(case, {"power": powers, "energy": series(a=idle, b=idle, c=idle)})
    lines = [" ".join(row) for row in action_rows(case, asked)]
    assert lines[-2:] == ["other times rest a, b", "all the time rest c"]
    printed = shown(action_list(case, asked, "To do"), width=60).splitlines()
    assert [" ".join(line.split()) for line in printed[-2:]] == lines[-2:]
    assert action_rows(case, []) == []


@pytest.mark.parametrize("width", [60, 80, 140])
def test_no_number_of_a_schedule_is_cut_off(width: int) -> None:
    case = rs.load_case("ieee33")
    plan = rs.solve(case, "lp")
    text = shown(*schedule(case, plan.tables, width), width=width)
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= width
    assert all(unit.name in text for unit in case.ess)
    assert all(unit.name in text for unit in case.generator)
    assert text.count("14:00-15:00") == text.count("from-to")


@pytest.mark.parametrize("width", [50, 60, 80])
def test_no_number_of_a_plan_is_cut_off(width: int) -> None:
    """Costs of thousands of $ stand beside the energy only where both have room."""
    load = {"p_max_mw": 2.0, "shed_cost_per_mwh": 123456.0}
    plan = rs.solve(small_case(load=[load], generator=[{"p_max_mw": 1.5}]), "lp")
    text = shown_plan(plan, width)
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= width
    assert f"{plan.costs['load.shed']:.4f}" in text
    side_by_side = any("Cost" in line and "Energy" in line for line in text.splitlines())
    assert side_by_side == (width > 60)


def shown_plan(plan: rs.Plan, width: int) -> str:
    file = StringIO()
    print_plan(plan, Console(file=file, width=width))
    return file.getvalue()


def test_a_schedule_has_means_of_hours_and_energy_at_their_end() -> None:
    text = shown(*schedule(ring(), tables(), 140), width=140)
    first = next(line for line in text.splitlines() if "00:00-01:00" in line).split()
    assert first[1:5] == ["-0.450", "2.4", "+0.500", "+0.250"]
    fifth = next(line for line in text.splitlines() if "04:00-05:00" in line).split()
    assert fifth[1:3] == ["+0.250", "2.25"]
    assert fifth[-1] == "open"


@pytest.mark.parametrize(
    ("low", "high", "text"),
    [
        (1.02, 2.0, "1.02-2"),
        (1e-9, 0.264, "0-0.264"),
        (0.5, 0.5001, "0.5"),
        (10.0, 123.4, "10-123"),
    ],
)
def test_a_range_has_three_digits_of_its_greater_end(low: float, high: float, text: str) -> None:
    assert mw_range(low, high) == text


@pytest.fixture(scope="module")
def stormy() -> ScenarioPlan:
    plan = rs.solve("ieee33-tou", "stochastic", scenarios=12, seed=2)
    assert isinstance(plan, ScenarioPlan)
    return plan


def test_answers_to_a_first_failure_are_those_of_its_scenarios(stormy: ScenarioPlan) -> None:
    failures = first_failures(stormy)
    assert stormy.outages is not None
    assert [f.probability for f in failures] == sorted(
        (f.probability for f in failures), reverse=True
    )
    leaves = np.asarray(stormy.episodes["leaves_slot"], int)
    inside = leaves < stormy.outages.slots
    assert sum(f.probability for f in failures) == pytest.approx(inside.sum() / 12)
    labels, power = stormy.recourse
    for failure in failures:
        members = [
            k for k in np.flatnonzero(inside).tolist()
            if {stormy.outages.lines[i] for i in
                np.flatnonzero(stormy.outages.down[:, leaves[k], k])} == set(failure.lines)
        ]  # fmt: skip
        assert failure.earliest == leaves[members].min()
        for response in failure.responses:
            row = power[labels.index(response.unit)]
            means = [row[leaves[k] : leaves[k] + 8, k].mean() for k in members]
            assert response.mean_mw == pytest.approx(np.mean(means))
            assert (response.low_mw, response.high_mw) == pytest.approx((min(means), max(means)))


def test_every_storage_and_generator_is_named_when_a_line_fails(stormy: ScenarioPlan) -> None:
    """With numbers, or as one that rests; and what is shed in the scenarios of the failure."""
    case, failures = stormy.case, first_failures(stormy)
    assert case is not None
    cells = failure_cells(case, failures)
    named = [row[0] for row in cells.rows if row[0] != "MWh shed"] + cells.idle
    assert sorted(named) == sorted(unit.name for unit in (*case.ess, *case.generator))
    leaves = np.asarray(stormy.episodes["leaves_slot"], int)
    stays = leaves >= case.slots
    shed, weight = (np.asarray(stormy.episodes[k]) for k in ("shed_mwh", "probability"))
    within = sum(failure.probability * failure.shed_mwh for failure in failures)
    assert within + (weight * shed)[stays].sum() == pytest.approx(float(weight @ shed))


def test_idle_units_and_shedding_are_told_of_a_failure() -> None:
    case = small_case(
        ess=[{"name": name, "bus": "1", "p_max_mw": 1.0, "e_mwh": 4.0} for name in "ab"]
    )
    response = UnitResponse("a", -0.25, -0.3, -0.2)
    likely = FirstFailure(("1-2",), 0.5, 1, 3, (response,), 1.25)
    cells = failure_cells(case, [likely, FirstFailure(("2-3",), 0.2, 1, 1, (), 0.0)])
    assert cells.rows == [("a", "-0.250", "."), ("MWh shed", "1.250", "0.000")]
    assert cells.idle == ["b"]


@pytest.mark.parametrize("width", [60, 80])
def test_no_number_of_a_plan_over_scenarios_is_cut_off(stormy: ScenarioPlan, width: int) -> None:
    file = StringIO()
    print_scenario_plan(stormy, Console(file=file, width=width))
    text = file.getvalue()
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= width
    assert text.count("first down") >= 1


def test_both_plans_print_what_to_do(stormy: ScenarioPlan) -> None:
    file = StringIO()
    print_scenario_plan(stormy, Console(file=file, width=80), with_schedule=True)
    text = file.getvalue()
    assert "To do until an outage shows" in text
    assert "If an outage shows: mean MW of the first two hours" in text
    assert "Schedule: MW are means" in text
    assert "MWh at the end" in " ".join(text.split())
    file = StringIO()
    print_plan(rs.solve("ieee33", "lp"), Console(file=file, width=80))
    assert "To do: mean MW" in file.getvalue()
    assert "Schedule" not in file.getvalue()
