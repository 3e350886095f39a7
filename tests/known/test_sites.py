"""Units that may be built before the storm: closed forms, all sets, plain evaluation."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest

from resilience.arrays import Bools
from resilience.case import Case
from resilience.models.microgrid import Physics
from resilience.models.program.risk import Risk
from resilience.planning.hardening.draws import StrengthDraws, StrengthOption, status_with
from resilience.planning.hardening.evaluation import outcomes_of
from resilience.planning.hardening.program import Option, hardening_program
from resilience.planning.hardening.search import HardeningSearch
from resilience.planning.hardening.sites import UnitOption, ties_of, units_of, with_built
from resilience.planning.hardening.yearly import Years, capital_recovery
from resilience.planning.two_stage.extensive import extensive
from tests.known.test_hardening import (
    EXACT,
    HOURS,
    IMPORT,
    PRICE,
    by_storm,
    feeder,
    island_feeder,
    one_each,
    random_draws,
)

DEPOT = {"bus": "9", "p_max_mw": 0.6, "e_mwh": 1.5, "soc_initial": 0.8, "soc_min": 0.2,
         "efficiency_charge": 0.95, "efficiency_discharge": 0.9,
         "degradation_cost_per_mwh": 0.5, "s_mva": 0.7}  # fmt: skip
# The plant stands where a generator forms its island: the program lets every island live.
SITES: list[dict[str, Any]] = [
    {"name": "depot", "kind": "ess", "units": 3, "cost": 1.0, "unit": DEPOT},
    {"name": "diesel", "kind": "generator", "cost": 1.5,
     "unit": {"bus": "3", "p_max_mw": 0.8, "cost_per_mwh": 9.0, "q_max_mvar": 0.3}},
    {"name": "roof", "kind": "pv", "cost": 0.7,
     "unit": {"bus": "4", "p_max_mw": 0.9, "profile": "day", "s_mva": 1.0}},
]  # fmt: skip


def plain(
    case: Case,
    options: list[Option],
    draws: StrengthDraws,
    chosen: Bools,
    risk: Risk | None = None,
    physics: Physics = "copperplate",
) -> float:
    """$ of the risk as any plan over scenarios is measured, in the case with what is built."""
    lines = [o for o in options if isinstance(o, StrengthOption)]
    units = [o for o, is_built in zip(options, chosen, strict=True) if is_built]
    scenarios = status_with(draws, lines, chosen[: len(lines)])
    built = with_built(case, [o for o in units if not isinstance(o, StrengthOption)])
    return outcomes_of(built, scenarios, physics).value(risk or Risk())


def offered(sites: list[dict[str, Any]], **changes: Any) -> Case:
    return island_feeder().replace(plan={"site": sites}, terminal_value_per_mwh=0.7, **changes)


def sets_in_turn(options: list[Option]) -> list[Bools]:
    """All sets with one option a line, in which no unit comes before the first of its site."""
    found = []
    for picks in product((False, True), repeat=len(options)):
        numbers: dict[str, list[int]] = {}
        for option, picked in zip(options, picks, strict=True):
            if picked and isinstance(option, UnitOption):
                numbers.setdefault(option.site, []).append(option.number)
        if all(n == list(range(1, len(n) + 1)) for n in numbers.values()):
            found.append(np.array(picks))
    return found


@pytest.mark.parametrize("risk", ["mean", "cvar:0.7:0.5"])
def test_the_best_of_lines_and_units_is_that_of_all_sets(risk: str) -> None:
    """Two lines, three units of storage, a generator and a plant: 64 sets, each evaluated."""
    case, measure = offered(SITES), Risk.parse(risk)
    lines = one_each(case)[2:4]
    options: list[Option] = [*lines, *units_of(case)]
    draws = random_draws(case, lines, later=False)
    program = hardening_program(case, options, draws, 3.0, risk=measure)
    search = HardeningSearch(program, EXACT)
    sets = sets_in_turn(options)
    assert len(sets) == 64
    values = [search.value(chosen) for chosen in sets]
    for chosen, value in list(zip(sets, values, strict=True))[::3]:
        assert value == pytest.approx(plain(case, options, draws, chosen, measure), rel=1e-6)
    for budget in (0.0, 1.0, 2.3, 3.0, 10.0):
        choice = search.best(budget, search.greedy(budget))
        fits = [v for c, v in zip(sets, values, strict=True) if program.cost @ c <= budget + 1e-9]
        assert choice.value == pytest.approx(min(fits), rel=1e-6)
        assert choice.bound <= choice.value + 1e-6 * abs(choice.value)
        assert any((choice.chosen == c).all() for c in sets)
    whole = extensive(hardening_program(case, options, draws, 3.0, risk=measure).two_stage, EXACT)
    assert whole.objective == pytest.approx(search.best(3.0).value, rel=1e-5)


def test_what_pays_is_that_of_all_sets() -> None:
    """No budget, but a price for everything: what it saves has to be more."""
    case = offered(SITES)
    lines = one_each(case)[2:4]
    options: list[Option] = [*lines, *units_of(case)]
    draws = random_draws(case, lines, later=False)
    for scale, risk in ((0.5, "mean"), (12.0, "mean"), (40.0, "cvar:0.7:0.5"), (1e3, "mean")):
        price = scale * np.array([option.cost for option in options])
        program = hardening_program(
            case, options, draws, np.inf, price=price, risk=Risk.parse(risk)
        )
        search = HardeningSearch(program, EXACT)
        values = [search.value(chosen) for chosen in sets_in_turn(options)]
        choice = search.best(np.inf, search.greedy(np.inf))
        assert choice.value == pytest.approx(min(values), rel=1e-6)
        assert choice.gap <= 1e-6
        assert extensive(program.two_stage, EXACT).objective == pytest.approx(min(values), rel=1e-5)
        assert choice.chosen.any() == (scale < 1e3)


def test_a_line_pays_where_a_year_of_storms_costs_more_than_its_payments() -> None:
    """2 MW for four hours in 0.3 of the storms, 1.5 of them a year, against an annuity."""
    case = feeder([(1, 2)], {2: 2.0})
    draws = by_storm(
        case, np.array([[True, True, False]]), np.array([[True, False, False]]), [0.2, 0.3, 0.5]
    )
    saved_per_year = 1.5 * 0.3 * 2.0 * HOURS * (PRICE - IMPORT)
    years = Years(1.5, 0.06)
    share = float(capital_recovery(25.0, 0.06))
    for factor, pays in ((0.99, True), (1.01, False)):
        options = [StrengthOption("1-2", 1.5, factor * saved_per_year / share, 25.0)]
        price = years.annual_cost(options) / years.storms_per_year
        program = hardening_program(case, options, draws, np.inf, price=price)
        assert HardeningSearch(program, EXACT).best(np.inf).chosen.tolist() == [pays]


@pytest.mark.parametrize("rate", [0.0, 1e-9, 0.05, 0.3])
@pytest.mark.parametrize("life", [1, 7, 40])
def test_payments_over_a_life_are_worth_what_was_spent(rate: float, life: int) -> None:
    payment = float(capital_recovery(life, rate))
    worth = sum(payment / (1.0 + rate) ** year for year in range(1, life + 1))
    assert worth == pytest.approx(1.0, rel=1e-9)


def test_with_voltages_a_unit_that_is_not_built_gives_no_reactive_power() -> None:
    case = offered(SITES)
    options: list[Option] = list(units_of(case))
    draws = random_draws(case, [], later=False)
    program = hardening_program(case, options, draws, 2.0, physics="lindistflow")
    search = HardeningSearch(program, EXACT)
    sets = sets_in_turn(options)
    values = [search.value(chosen) for chosen in sets]
    for chosen, value in zip(sets, values, strict=True):
        expected = plain(case, options, draws, chosen, physics="lindistflow")
        assert value == pytest.approx(expected, rel=1e-5)
    fits = [v for c, v in zip(sets, values, strict=True) if program.cost @ c <= 2.0]
    assert search.best(2.0).value == pytest.approx(min(fits), rel=1e-5)


def test_storage_is_worth_what_it_brings_until_the_load_is_served() -> None:
    """A load of 1 MW is cut off for four hours in half of the storms, and batteries come full.

    A unit of 0.8 MWh at 90 % serves 0.72 MWh of it, and keeps what it has in the other storms,
    where it is worth nothing; five units serve 3.6 MWh, and the sixth what is left of four.
    """
    unit = {"bus": "2", "p_max_mw": 2.0, "e_mwh": 0.8, "soc_initial": 1.0,
            "efficiency_discharge": 0.9}  # fmt: skip
    site = {"name": "battery", "kind": "ess", "units": 8, "cost": 2.0, "unit": unit}
    case = feeder([(1, 2)], {2: 1.0}).replace(plan={"site": [site]})
    draws = by_storm(case, np.array([[True, False]]), np.zeros((0, 2), bool), [0.5, 0.5])
    options: list[Option] = list(units_of(case))
    search = HardeningSearch(hardening_program(case, options, draws, 0.0), EXACT)
    calm = HOURS * 1.0 * IMPORT
    for n in range(9):
        served = min(0.72 * n, HOURS)
        # Before a calm day's end, too, the batteries are emptied: import costs something.
        expected = 0.5 * PRICE * (HOURS - served) + 0.5 * (calm - served * IMPORT)
        built = np.arange(8) < n
        assert search.value(built) == pytest.approx(expected, rel=1e-7)
        assert plain(case, options, draws, built) == pytest.approx(expected, rel=1e-7)
        choice = search.best(2.0 * n)
        assert choice.chosen.sum() == min(n, 6)
        assert choice.value == pytest.approx(expected, rel=1e-6)


def test_a_line_and_a_generator_behind_it_stand_in_for_each_other() -> None:
    """Either serves the load; both are worth what the cheaper energy saves beside."""
    site = {"name": "diesel", "kind": "generator", "cost": 1.0,
            "unit": {"bus": "2", "p_max_mw": 2.0, "cost_per_mwh": 11.0}}  # fmt: skip
    case = feeder([(1, 2)], {2: 2.0}).replace(plan={"site": [site]})
    lines = one_each(case)
    options: list[Option] = [*lines, *units_of(case)]
    draws = by_storm(case, np.array([[True]]), np.array([[False]]), [1.0])
    search = HardeningSearch(hardening_program(case, options, draws, 1.0), EXACT)
    expected = {(0, 0): PRICE, (1, 0): IMPORT, (0, 1): 11.0, (1, 1): IMPORT}
    for chosen, price in expected.items():
        value = search.value(np.array(chosen, bool))
        assert value == pytest.approx(2.0 * HOURS * price, rel=1e-9)
    assert search.best(2.0).chosen.tolist() == [True, False]


def test_a_tie_is_worth_the_load_that_it_feeds() -> None:
    """Two laterals, and a tie between their ends: either feeds both while the other is down."""
    case = feeder([(1, 2), (1, 3), (2, 3)], {2: 2.0, 3: 1.0}).replace(
        line=[{"name": "2-3", "in_service": False, "tie_cost": 5.0}]
    )
    options: list[Option] = list(ties_of(case))
    bare = np.array([[True, False, True, False], [False, True, True, False], [False] * 4])
    draws = by_storm(case, bare, np.zeros((0, 4), bool), [0.3, 0.2, 0.1, 0.4])
    search = HardeningSearch(hardening_program(case, options, draws, 5.0), EXACT)
    nothing, tied = np.array([False]), np.array([True])
    saved = (0.3 * 2.0 + 0.2 * 1.0) * HOURS * (PRICE - IMPORT)
    assert search.value(nothing) - search.value(tied) == pytest.approx(saved, rel=1e-9)
    for chosen in (nothing, tied):
        assert plain(case, options, draws, chosen) == pytest.approx(search.value(chosen), rel=1e-7)
    assert search.best(5.0).chosen.tolist() == [True]
    assert not search.best(4.0).chosen.any()


def test_ties_beside_lines_and_units_are_worth_what_closed_lines_are() -> None:
    """Open ties that are built act like lines that close loops, in the same storms."""
    ties, lines = ("4-7", "9-3"), one_each(island_feeder())[2:4]
    tables = [{"name": name, "in_service": False, "tie_cost": 1.2} for name in ties]
    base = island_feeder([(4, 7), (9, 3)]).replace(terminal_value_per_mwh=0.7)
    case = base.replace(line=tables, plan={"site": SITES[:1]})
    options: list[Option] = [*lines, *units_of(case), *ties_of(case)]
    draws = random_draws(island_feeder(), lines, later=False)
    program = hardening_program(case, options, draws, 3.0)
    search = HardeningSearch(program, EXACT)
    sets = sets_in_turn(options)
    assert len(sets) == 2 * 2 * 4 * 2 * 2
    values = [search.value(chosen) for chosen in sets]
    for chosen, value in list(zip(sets, values, strict=True))[::5]:
        closed = [
            {"name": n, "in_service": bool(b)} for n, b in zip(ties, chosen[-2:], strict=True)
        ]
        mesh = base.replace(line=closed)
        expected = plain(mesh, options[:-2], draws, chosen[:-2])
        assert value == pytest.approx(expected, rel=1e-6)
        # Trees, by shares: a program that may close loops is never dearer.
        assert value <= plain(case, options, draws, chosen) * (1.0 + 1e-7)
    for budget in (1.2, 3.0, 6.0):
        choice = search.best(budget, search.greedy(budget))
        fits = [v for c, v in zip(sets, values, strict=True) if program.cost @ c <= budget + 1e-9]
        assert choice.value == pytest.approx(min(fits), rel=1e-6)
        assert choice.gap <= 1e-6
