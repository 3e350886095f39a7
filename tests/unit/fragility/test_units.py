"""Units that fail: chances against a Markov chain written here, files, words, and mistakes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import resilience as rs
from resilience.arrays import Floats
from resilience.case import Case, Outage, case_text, load_case
from resilience.dispatch.sddp.book import Book
from resilience.errors import CaseError, UsageError
from resilience.fragility import load_scenarios, moments, reduced, summary
from resilience.fragility.draw import draw, sample_case
from resilience.fragility.outages.blackout import case_blackout
from resilience.fragility.outages.main_grid import MainGrid
from resilience.fragility.outages.reduction import load_behind_mw
from resilience.fragility.outages.scenarios import Scenarios
from resilience.fragility.outages.units import FailingUnits, drawn_units, with_units
from resilience.testing import small_case

N = 20_000
DIESEL = {"start_failure": 0.2, "mttf_h": 6.0, "mttr_h": 3.0, "availability": 0.9}


def island_case(slots: int = 12, step_min: float = 60.0, **units: Any) -> Case:
    """A grid at bus 1, and everything else at bus 2, behind one line that storms break."""
    generator = {"bus": "2", "p_max_mw": 2.0, "cost_per_mwh": 1.0}
    store = {"bus": "2", "p_max_mw": 1.0, "e_mwh": 4.0}
    plant = {"bus": "2", "p_max_mw": 1.0}
    return small_case(
        slots=slots,
        step_min=step_min,
        buses=2,
        lines=[(1, 2, 0.001, 0.001)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        load=[{"bus": "2", "p_max_mw": 1.0, "shed_cost_per_mwh": 9.0}],
        grid=[{"import_max_mw": 4.0, "import_cost_per_mwh": 0.2}],
        generator=[generator | units.get("generator", {})],
        ess=[store | units.get("ess", {})],
        pv=[plant | units.get("pv", {})],
    )


def of_line(case: Case, first: int, stop: int, n: int = N) -> Scenarios:
    """Scenarios in which the line is down from slot `first` to `stop`."""
    down = np.zeros((1, case.slots, n), bool)
    down[:, first:stop] = True
    return Scenarios(("1-2",), down, np.full(n, 1.0 / n))


def chain(up: float, fails: Floats, back: float) -> Floats:
    """(slots,) probability to be out, of a unit in order with the probability `up` before."""
    out, chances = 1.0 - up, []
    for chance in fails:
        out = out * (1.0 - back) + (1.0 - out) * chance
        chances.append(out)
    return np.array(chances)


def within_error(share: Floats, expected: Floats, n: int = N) -> bool:
    sigma = np.sqrt(np.maximum(expected * (1.0 - expected), 1e-9) / n)
    return bool((np.abs(share - expected) < 4.0 * sigma).all())


@pytest.mark.parametrize("step_min", [60.0, 15.0])
def test_a_generator_fails_at_its_start_and_while_the_grid_is_lost(step_min: float) -> None:
    case = island_case(step_min=step_min, generator=DIESEL)
    units, dt = FailingUnits.of_case(case), step_min / 60.0
    out = drawn_units(case, units, of_line(case, 3, 9), seed=1)[0].mean(axis=1)
    fails = np.zeros(12)
    fails[3:9] = 1.0 - np.exp(-dt / 6.0)
    fails[3] = 1.0 - 0.8 * np.exp(-dt / 6.0)
    assert within_error(out, chain(0.9, fails, 1.0 - np.exp(-dt / 3.0)))


def test_storage_and_plants_fail_with_the_grid_at_hand() -> None:
    fails = {"mttf_h": 5.0, "mttr_h": 2.0, "availability": 0.97}
    case = island_case(ess=fails, pv={"mttf_h": 20.0})
    units = FailingUnits.of_case(case)
    assert units.names == ("pv1", "ess1")
    plant, store = drawn_units(case, units, of_line(case, 0, 0), seed=1)
    expected = chain(0.97, np.full(12, 1.0 - np.exp(-0.2)), 1.0 - np.exp(-0.5))
    assert within_error(store.mean(axis=1), expected)
    # Nobody repairs the plant: it is out once its life is over.
    assert within_error(plant.mean(axis=1), 1.0 - np.exp(-np.arange(1, 13) / 20.0))
    assert not (plant[:-1] & ~plant[1:]).any()


def test_without_a_grid_a_generator_is_called_on_at_once() -> None:
    case = island_case(generator={"start_failure": 0.2}).replace(grid=[])
    units = FailingUnits.of_case(case)
    out = drawn_units(case, units, of_line(case, 0, 0), seed=1)[0]
    assert within_error(out.mean(axis=1), np.full(12, 0.2))
    assert (out == out[:1]).all()


def test_every_loss_of_the_grid_is_a_start() -> None:
    case = island_case(generator={"start_failure": 0.2})
    lines = of_line(case, 2, 4)
    lines.down[:, 8:10] = True
    out = drawn_units(case, FailingUnits.of_case(case), lines, seed=1)[0].mean(axis=1)
    assert within_error(out, np.repeat([0.0, 0.2, 1.0 - 0.8**2], [2, 6, 4]))


def test_the_grid_is_lost_where_no_path_is_left_or_no_connection() -> None:
    case = load_case("ieee33")
    names = ("1-2", "6-26", "grid")
    buses = np.array([case.network.bus(name) for name in ("1", "2", "26")])
    states = np.array([[0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], bool)
    lost = MainGrid(case, names).is_lost(buses, states)
    assert lost.tolist() == [
        [False, False, False, True],
        [False, True, False, True],
        [False, True, True, True],
    ]


def test_lines_fail_as_they_do_without_units() -> None:
    case = load_case("ieee33")
    fails = [unit.model_copy(update=DIESEL) for unit in case.generator]
    both, alone = sample_case(case.replace(generator=fails), 50, 3), sample_case(case, 50, 3)
    assert both.lines == (*alone.lines, *(unit.name for unit in case.generator))
    np.testing.assert_array_equal(both.down[:4], alone.down)
    assert both.process == f"{alone.process}; units fail"
    assert with_units(case, alone, 3) is alone


def test_more_scenarios_and_more_days_begin_alike() -> None:
    case = island_case(slots=24, generator=DIESEL, ess={"mttf_h": 9.0, "mttr_h": 2.0})
    few, many = (draw(case, n, 4, days=1) for n in (10, 40))
    longer = draw(case.replace(slots=48), 40, 4)
    np.testing.assert_array_equal(few.down, many.down[:, :, :10])
    np.testing.assert_array_equal(many.down, longer.down[:, :24])


def test_a_storm_has_units_beside_its_lines() -> None:
    case = load_case("ieee33_rammasun")
    fails = [unit.model_copy(update={"availability": 0.5}) for unit in case.ess]
    drawn = sample_case(case.replace(ess=fails), 8, 0)
    assert drawn.lines[-len(fails) :] == tuple(unit.name for unit in case.ess)
    assert drawn.down[-len(fails) :].any()


def pair() -> tuple[Case, Scenarios]:
    case = island_case(generator=DIESEL)
    drawn = with_units(case, of_line(case, 3, 9, 6), 2)
    assert drawn.down[1].any()
    return case, drawn


@pytest.mark.parametrize("suffix", [".npz", ".csv"])
def test_files_carry_units(suffix: str, tmp_path: Path) -> None:
    case, drawn = pair()
    path = tmp_path / f"storms{suffix}"
    drawn.save(path)
    again = load_scenarios(path, case)
    assert again.lines == drawn.lines == ("1-2", "generator1")
    np.testing.assert_array_equal(again.down, drawn.down)


def test_files_of_lines_alone_still_load(tmp_path: Path) -> None:
    case, _ = pair()
    path = tmp_path / "storms.csv"
    path.write_text("scenario,line,first,stop\n0,1-2,3,9\n1,,,\n")
    assert load_scenarios(path, case).lines == ("1-2",)
    path.write_text("scenario,line,first,stop\n0,generator2,3,9\n0,load1,1,2\n")
    with pytest.raises(CaseError) as caught:
        load_scenarios(path, case)
    assert [m.value for m in caught.value.mistakes] == ["'generator2'", "'load1'"]
    assert "did you mean generator1?" in caught.value.mistakes[0].hint
    other = Scenarios(("unit9",), np.zeros((1, 12, 1), bool), np.ones(1))
    other.save(tmp_path / "other.npz")
    with pytest.raises(UsageError, match="line 'unit9' is not in case"):
        load_scenarios(tmp_path / "other.npz", case)


def test_words_name_units(tmp_path: Path) -> None:
    case = island_case()
    hit = case.replace(outages="generator1@02:00-05:00, 1-2@01:00-04:00, grid1@03:00-04:00")
    assert hit.outages[0] == Outage("generator1", 2, 5)
    assert hit.fallible_units == ("generator1", "grid1")
    assert hit.elements == ("1-2", "generator1", "grid1")
    assert case.elements == ("1-2",)
    path = tmp_path / "case.toml"
    path.write_text(case_text(hit))
    assert load_case(path).equals(hit)
    for wrong in ("load1", "generator7"):
        with pytest.raises(CaseError, match="a line of the network, or a unit"):
            case.replace(outages=f"{wrong}@02:00-05:00")


def test_a_line_comes_before_a_unit_of_its_name() -> None:
    case = island_case(generator={"name": "1-2"}).replace(outages="1-2@02:00-05:00")
    assert (case.fallible_units, case.element("1-2")) == ((), 0)
    with pytest.raises(CaseError) as caught:
        island_case(generator={"name": "1-2", "availability": 0.9})
    assert [m.key for m in caught.value.mistakes] == ["name"]


@pytest.mark.parametrize(
    ("keys", "wrong"),
    [
        ({"mttr_h": 3.0}, "mttr_h"),
        ({"mttf_h": 0.5}, "mttf_h"),
        ({"mttf_h": -1.0}, "mttf_h"),
        ({"mttf_h": 1e8}, "mttf_h"),
        ({"availability": 0.0}, "availability"),
        ({"availability": 99.5}, "availability"),
        ({"start_failure": 1.0}, "start_failure"),
    ],
)
def test_nonsense_is_named(keys: dict[str, float], wrong: str) -> None:
    with pytest.raises(CaseError) as caught:
        island_case(generator=keys)
    assert [m.key for m in caught.value.mistakes] == [wrong]
    if wrong != "start_failure":
        with pytest.raises(CaseError):
            island_case(ess=keys)


def test_only_a_generator_fails_to_start() -> None:
    with pytest.raises(CaseError, match="start_failure"):
        island_case(ess={"start_failure": 0.1})


def test_numbers_tell_units_from_lines() -> None:
    case, drawn = pair()
    numbers, of_lines = summary(drawn, case), summary(drawn.restricted_to(["1-2"]), case)
    for key, value in of_lines["lines"]["1-2"].items():
        assert numbers["lines"]["1-2"][key] == pytest.approx(value)
    assert list(numbers["units"]) == ["generator1"]
    assert "units" not in of_lines
    assert numbers["all_out_chance"] == pytest.approx(1.0)
    assert load_behind_mw(case, drawn.lines).tolist() == [1.0, 2.0]
    assert moments(case, drawn)["generator1 out, h"].tolist() == drawn.down[1].sum(axis=0).tolist()


def test_fewer_scenarios_keep_the_hours_of_units() -> None:
    case = island_case(generator=DIESEL)
    many = with_units(case, of_line(case, 3, 9, 60), 5)
    means = moments(case, many)
    few = reduced(many, 8, load_mw=load_behind_mw(case, many.lines), means=means)
    hours = moments(case, few)["generator1 out, h"] @ few.probability
    assert hours == pytest.approx(means["generator1 out, h"] @ many.probability)


def test_loads_last_as_long_as_the_generator_is_likely_to() -> None:
    """Nobody repairs it: 1 MW is served for d hours with the chance that it starts and runs on."""
    case = island_case(
        slots=24 * 40, generator={"start_failure": 0.1, "mttf_h": 30.0}, ess={"e_mwh": 0.02}
    ).replace(pv=[], ess=[])
    lasts = rs.survive(case, (4, 12), method="greedy", seed=1).frame()
    for hours, row in zip((4.0, 12.0), lasts.to_dict("records"), strict=True):
        expected = 0.9 * np.exp(-hours / 30.0)
        sigma = np.sqrt(expected * (1.0 - expected) / row["starts"])
        assert abs(row["all_served"] - expected) < 4.0 * sigma


def test_outages_of_units_are_drawn_for_a_plan() -> None:
    case = island_case(slots=24, generator={"availability": 0.01})
    plan = rs.solve(case, "lp", outages="bell", seed=0)
    assert any(text.startswith("generator1@00:00-24:00") for text in plan.outages)


def test_sddp_refuses_units() -> None:
    case = load_case("ieee33")
    fails = [unit.model_copy(update={"availability": 0.5}) for unit in case.ess]
    with pytest.raises(UsageError, match="ess1, ess2, ess3, ess4, ess5 may fail"):
        Book(case.replace(ess=fails))


def test_a_blackout_calls_on_units() -> None:
    """All starts fail, and nobody repairs: out from the blackout's first slot on."""
    case = load_case("ieee33-fuel")
    fails = [unit.model_copy(update={"start_failure": 0.999999}) for unit in case.generator]
    case = case.replace(generator=fails)
    drawn = sample_case(case, 4, 0)
    down = dict(zip(drawn.lines, drawn.down, strict=True))
    (line,) = case_blackout(case).lines
    begins = down[line][:, 0].argmax()
    cut_off = [unit.name for unit in fails if down[unit.name][begins].all()]
    assert cut_off == [unit.name for unit in fails]
    with pytest.raises(UsageError, match="units may fail"):
        rs.compare(case, ["comb"], draws=2)
