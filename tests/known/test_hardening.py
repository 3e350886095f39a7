"""What to strengthen before the storm: closed forms, every set enumerated, plain evaluation.

Storms are made by hand here: when each line is down as it is, and when it would be with an option.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations, product

import numpy as np
import pytest

from resilience.arrays import Bools
from resilience.case import Case
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.microgrid import Physics
from resilience.models.program.risk import Risk
from resilience.planning.hardening.draws import StrengthDraws, StrengthOption, status_with
from resilience.planning.hardening.evaluation import outcomes_of
from resilience.planning.hardening.program import HardeningProgram, hardening_program
from resilience.planning.hardening.search import HardeningSearch
from resilience.planning.two_stage import recourse
from resilience.planning.two_stage.extensive import extensive
from resilience.planning.two_stage.lshaped import DecompositionOptions
from resilience.testing import small_case

HOURS, PRICE, IMPORT = 4, 30.0, 1.0
EXACT = DecompositionOptions(gap=1e-6)


def feeder(lines: Sequence[tuple[int, int]], loads: dict[int, float]) -> Case:
    """A feeder from a grid at bus 1, loads in MW at some buses."""
    return small_case(
        slots=HOURS,
        buses=max(map(max, lines)),
        lines=[(i, j, 0.01, 0.01) for i, j in lines],
        grid=[{"import_max_mw": 20.0, "import_cost_per_mwh": IMPORT}],
        load=[
            {"bus": str(bus), "p_max_mw": mw, "shed_cost_per_mwh": PRICE}
            for bus, mw in loads.items()
        ],
    )


def by_storm(case: Case, bare: Bools, strong: Bools, weight: Sequence[float]) -> StrengthDraws:
    """Draws in which lines (lines, storms) are down in all hours."""
    bare, strong = (np.repeat(down[:, None], HOURS, axis=1) for down in (bare, strong))
    scenarios = Scenarios(case.network.line_names, bare, np.asarray(weight, float))
    return StrengthDraws(scenarios, strong)


def one_each(case: Case, cost: float = 1.0) -> list[StrengthOption]:
    return [StrengthOption(name, 1.5, cost) for name in case.network.line_names]


def searched(
    case: Case,
    options: Sequence[StrengthOption],
    draws: StrengthDraws,
    budget: float,
    risk: Risk | None = None,
    physics: Physics = "copperplate",
) -> HardeningSearch:
    program = hardening_program(case, options, draws, budget, risk=risk, physics=physics)
    return HardeningSearch(program, EXACT)


def test_one_line_is_worth_what_it_serves_more_often() -> None:
    """(p0 - p1) x load x hours x (price of shedding - import): 0.5 and 0.2 of storms, 2 MW."""
    case = feeder([(1, 2)], {2: 2.0})
    bare, strong = np.array([[True, True, False]]), np.array([[True, False, False]])
    search = searched(case, one_each(case), by_storm(case, bare, strong, [0.2, 0.3, 0.5]), 1.0)
    choice = search.best(1.0)
    saved = search.value(np.array([False])) - choice.value
    assert choice.chosen.tolist() == [True]
    assert saved == pytest.approx((0.5 - 0.2) * 2.0 * HOURS * (PRICE - IMPORT), rel=1e-9)
    assert choice.bound == pytest.approx(choice.value, rel=1e-6)


def test_customers_wait_as_long_as_their_loads_are_not_served() -> None:
    """Ninety are cut off for four hours in half of the storms, ten never; nobody knows of a third.

    A battery serves a quarter of the ninety's load, so a quarter of them.
    """
    case = feeder([(1, 2), (1, 3), (1, 4)], {2: 2.0, 3: 1.0, 4: 1.0})
    loads = [
        load.model_copy(update={"customers": n})
        for load, n in zip(case.load, (90, 10, None), strict=True)
    ]
    draws = by_storm(
        case, np.array([[True, False], [False, False], [False, False]]), np.zeros((0, 2), bool),
        [0.5, 0.5],
    )  # fmt: skip
    known = outcomes_of(case.replace(load=loads), draws.scenarios, "copperplate")
    assert known.mean("customer_h") == pytest.approx(0.5 * 0.9 * HOURS)
    battery = {"name": "b", "bus": "2", "p_max_mw": 0.5, "e_mwh": 2.0, "soc_initial": 1.0}
    helped = outcomes_of(case.replace(load=loads, ess=[battery]), draws.scenarios, "copperplate")
    assert helped.mean("customer_h") == pytest.approx(0.75 * 0.5 * 0.9 * HOURS)
    assert np.isnan(outcomes_of(case, draws.scenarios, "copperplate").mean("customer_h"))


def test_one_of_two_lines_in_series_is_worth_nothing_and_greedy_stops() -> None:
    """1-2 and 2-3 fail together, 1-4 alone in one storm of ten: greedy takes 1-4 and is stuck."""
    case = feeder([(1, 2), (2, 3), (1, 4)], {3: 2.0, 4: 1.0})
    bare = np.array([[True, False], [True, False], [False, True]])
    draws = by_storm(case, bare, np.zeros_like(bare), [0.9, 0.1])
    search = searched(case, one_each(case), draws, 2.0)
    nothing, pair = np.zeros(3, bool), np.array([True, True, False])
    assert search.value(nothing) == pytest.approx(search.value(np.array([True, False, False])))
    assert search.value(nothing) == pytest.approx(search.value(np.array([False, True, False])))
    saved = 0.9 * 2.0 * HOURS * (PRICE - IMPORT)
    assert search.value(nothing) - search.value(pair) == pytest.approx(saved)
    path = search.greedy(2.0)
    assert [c.tolist() for c in path[1:]] == [[False, False, True]]
    choice = search.best(2.0, path)
    assert choice.chosen.tolist() == pair.tolist()
    assert search.best(1.0).chosen.tolist() == [False, False, True]
    # With a budget for one and nothing at 1-4 nothing is built: it would save nothing.
    alone = by_storm(case, bare[:, :1], np.zeros((3, 1), bool), [1.0])
    assert not searched(case, one_each(case), alone, 1.0).best(1.0).chosen.any()


def test_symmetric_laterals_cost_the_same_whichever_is_built() -> None:
    case = feeder([(1, 2), (1, 3)], {2: 1.0, 3: 1.0})
    bare = np.array([[True, False], [False, True]])
    search = searched(case, one_each(case), by_storm(case, bare, ~bare & False, [0.5, 0.5]), 1.0)
    values = [search.value(np.array(chosen)) for chosen in ([True, False], [False, True])]
    assert values[0] == pytest.approx(values[1])
    choice = search.best(1.0)
    assert choice.chosen.sum() == 1
    assert choice.value == pytest.approx(values[0])


STORMS = 9
TREE = [(1, 2), (2, 3), (3, 4), (2, 5), (5, 6), (6, 7), (1, 8), (8, 9)]


def island_feeder(more: Sequence[tuple[int, int]] = ()) -> Case:
    """Nine buses with storage, generators, and loads at two prices; every source forms islands.

    Lines beside those of the tree close loops.
    """
    rng = np.random.default_rng(3)
    return small_case(
        slots=HOURS,
        buses=9,
        lines=[(i, j, 0.01, 0.01) for i, j in [*TREE, *more]],
        profiles={"day": rng.uniform(0.5, 1.0, HOURS).tolist()},
        grid=[{"import_max_mw": 20.0, "import_cost_per_mwh": IMPORT, "v_pu": 1.0}],
        generator=[{"bus": "4", "p_max_mw": 1.0, "cost_per_mwh": 12.0}],
        ess=[{"bus": "7", "e_mwh": 3.0, "p_max_mw": 1.0, "soc_initial": 0.5, "soc_min": 0.0}],
        load=[
            {
                "bus": str(bus),
                "p_max_mw": float(rng.uniform(0.3, 1.5)),
                "shed_cost_per_mwh": PRICE * (5.0 if bus in (4, 9) else 1.0),
                "profile": "day",
            }
            for bus in range(2, 10)
        ],
    )


def random_draws(case: Case, options: Sequence[StrengthOption], *, later: bool) -> StrengthDraws:
    """Lines down for a while; with an option for a part of that, or later where `later`."""
    rng = np.random.default_rng(11)
    names = case.network.line_names
    bare = rng.random((len(names), 1, STORMS)) < 0.5
    bare = bare & (np.arange(HOURS)[:, None] >= rng.integers(0, 3, (len(names), 1, STORMS)))
    strong = np.zeros((len(options), HOURS, STORMS), bool)
    for k, option in enumerate(options):
        down = bare[names.index(option.line)]
        kept = rng.random(STORMS) < 0.6 / option.factor
        strong[k] = (np.roll(down, 1, axis=0) if later else down) & kept
    weight = rng.uniform(0.5, 1.5, STORMS)
    return StrengthDraws(Scenarios(names, bare, weight / weight.sum()), strong)


def plain(
    case: Case,
    options: Sequence[StrengthOption],
    draws: StrengthDraws,
    chosen: Bools,
    risk: Risk,
    physics: Physics = "copperplate",
) -> float:
    """$ of the risk as any plan over scenarios is measured."""
    return outcomes_of(case, status_with(draws, options, chosen), physics).value(risk)


def sets_of(n: int, most: int) -> list[Bools]:
    sets = [c for k in range(most + 1) for c in combinations(range(n), k)]
    return [np.isin(np.arange(n), c) for c in sets]


@pytest.mark.parametrize("later", [False, True])
@pytest.mark.parametrize("risk", ["mean", "cvar:0.7:0.5", "cvar:0.7:1"])
def test_the_best_two_of_eight_are_those_of_all_pairs(risk: str, later: bool) -> None:
    """C(8, 2) sets and smaller ones, each evaluated as plans over scenarios are."""
    case, measure = island_feeder(), Risk.parse(risk)
    options = one_each(case)
    draws = random_draws(case, options, later=later)
    search = searched(case, options, draws, 2.0, measure)
    values = {c.tobytes(): search.value(c) for c in sets_of(8, 2)}
    choice = search.best(2.0)
    assert choice.value == pytest.approx(min(values.values()), rel=1e-6)
    assert choice.bound <= choice.value * (1 + 1e-9)
    assert choice.gap <= 1e-6
    some = [np.zeros(8, bool), choice.chosen, np.ones(8, bool), *sets_of(8, 2)[::9]]
    for chosen in some:
        expected = plain(case, options, draws, chosen, measure)
        assert search.value(chosen) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("physics", ["copperplate", "lindistflow"])
def test_on_a_mesh_the_best_two_are_those_of_all_pairs(physics: Physics) -> None:
    """Two loops, one within the other: what a line is worth hangs on the way around it."""
    case = island_feeder([(4, 7), (9, 3)])
    options = one_each(case)
    draws = random_draws(case, options, later=False)
    search = searched(case, options, draws, 2.0, physics=physics)
    sets = sets_of(10, 2) if physics == "copperplate" else sets_of(10, 2)[::5]
    values = [search.value(chosen) for chosen in sets]
    choice = search.best(2.0)
    if physics == "copperplate":
        assert choice.value == pytest.approx(min(values), rel=1e-6)
    assert choice.value <= min(values) * (1.0 + 1e-6)
    assert choice.gap <= 1e-6
    for chosen in [choice.chosen, np.ones(10, bool), *sets[::7]]:
        expected = plain(case, options, draws, chosen, Risk(), physics)
        assert search.value(chosen) == pytest.approx(expected, rel=1e-5)


def test_more_to_spend_never_costs_more_and_cuts_serve_all_budgets() -> None:
    case = island_feeder()
    options = [replace(o, cost=1.0 + 0.3 * k) for k, o in enumerate(one_each(case))]
    draws = random_draws(case, options, later=False)
    search = searched(case, options, draws, 0.0)
    budgets = [0.0, 1.0, 2.5, 4.0, 7.0, 100.0]
    choices = [search.best(budget) for budget in budgets]
    values = [choice.value for choice in choices]
    assert values == sorted(values, reverse=True)
    cost = np.array([o.cost for o in options])
    for choice in choices:
        assert cost @ choice.chosen <= choice.budget + 1e-9
        best = min(search.value(c) for c in sets_of(8, 8) if cost @ c <= choice.budget)
        assert choice.value == pytest.approx(best, rel=1e-6)
    assert not choices[0].chosen.any()


def test_one_option_a_line_of_several() -> None:
    """Three lines with two options each, 27 choices; and the extensive form proves the same."""
    case = island_feeder()
    names = case.network.line_names[:3]
    options = [StrengthOption(n, f, c) for n in names for f, c in ((1.2, 1.0), (1.8, 2.2))]
    draws = random_draws(case, options, later=False)
    search = searched(case, options, draws, 3.5)
    cost = np.array([o.cost for o in options])
    best = np.inf
    for picks in product((None, 0, 1), repeat=3):
        chosen = np.zeros(6, bool)
        chosen[[2 * k + pick for k, pick in enumerate(picks) if pick is not None]] = True
        value = search.value(chosen)
        assert value == pytest.approx(plain(case, options, draws, chosen, Risk()), rel=1e-6)
        best = min(best, value) if cost @ chosen <= 3.5 else best
    choice = search.best(3.5)
    assert choice.value == pytest.approx(best, rel=1e-6)
    assert all(np.bincount(np.flatnonzero(choice.chosen) // 2) <= 1)
    whole = extensive(search.program.two_stage, EXACT)
    assert whole.objective == pytest.approx(best, rel=1e-5)
    assert whole.bound == pytest.approx(best, rel=1e-5)


def test_with_voltages_the_statuses_hold_from_both_sides() -> None:
    """At lindistflow a line that is up ties the voltages of its ends, whoever gains by that."""
    case = island_feeder()
    options = one_each(case)[:3]
    draws = random_draws(case, options, later=True)
    search = searched(case, options, draws, 1.0, physics="lindistflow")
    for chosen in sets_of(3, 3):
        expected = plain(case, options, draws, chosen, Risk(), "lindistflow")
        assert search.value(chosen) == pytest.approx(expected, rel=1e-5)
    assert search.best(1.0).value == pytest.approx(
        min(search.value(c) for c in sets_of(3, 1)), rel=1e-5
    )


def test_threads_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Storms are cut into four batches, each with its solver, however many threads there are."""
    monkeypatch.setattr(recourse, "BRANCHES_OF_A_BATCH", 2)
    case = island_feeder()
    options = one_each(case)
    program: HardeningProgram = hardening_program(
        case, options, random_draws(case, options, later=False), 2.0
    )
    search = HardeningSearch(program, DecompositionOptions(gap=1e-6, workers=3))
    alone = HardeningSearch(program, EXACT)
    one, other = search.best(2.0), alone.best(2.0)
    assert (one.value, one.bound, one.rounds) == (other.value, other.bound, other.rounds)
