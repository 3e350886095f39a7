"""Cold load: closed forms, a program written here, methods, scenarios, and what refuses it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from rich.console import Console
from scipy.optimize import linprog

import resilience as rs
from resilience.case import Case
from resilience.dispatch.sddp.book import Book
from resilience.errors import CaseError, UsageError
from resilience.fragility.outages.scenarios import Scenarios
from resilience.planning.plan import Plan
from resilience.simulation.replay import replay
from resilience.testing import case_optimum, small_case
from resilience.text.plan import print_case

SHARE, TAU = 0.8, 2.0
COLD = {"p_max_mw": 1.0, "shed_cost_per_mwh": 50.0, "cold_load_share": SHARE, "cold_load_h": TAU}
WARM = {"p_max_mw": 0.5, "shed_cost_per_mwh": 20.0}
METHODS = ["lp", "milp", "socp", "nlp", "minlp"]


def behind_a_line(slots: int, step_min: float, *outages: str, **keys: Any) -> Case:
    grid = {"import_max_mw": 5.0, "import_cost_per_mwh": 1.0}
    return small_case(
        slots=slots,
        step_min=step_min,
        buses=2,
        lines=[(1, 2, 0.001, 0.001)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        outages=outages,
        load=[COLD | {"bus": "2"} | keys],
        grid=[grid],
    )


@pytest.mark.parametrize(("slots", "step_min"), [(24, 60.0), (96, 15.0), (12, 120.0)])
def test_a_load_returns_with_a_surplus_that_decays_whatever_the_step(
    slots: int, step_min: float
) -> None:
    """Off for 6 h: a backlog of tau (1 - e^-3) d, of which the share is made up for in the end; in
    the first hours the surplus is the integral of sigma b / tau e^(-t / tau).
    """
    found = case_optimum(behind_a_line(slots, step_min, "1-2@00:00-06:00"))
    dt = step_min / 60.0
    backlog = TAU * (1.0 - np.exp(-6.0 / TAU))
    back = round(6.0 / dt)
    assert found["load.backlog"][0, back - 1] == pytest.approx(backlog)
    taken = np.concatenate([np.zeros(back), np.full(slots - back, dt)]) @ found["load.surplus"][0]
    assert taken == pytest.approx(SHARE * backlog * (1.0 - np.exp(-18.0 / TAU)))
    two_hours = dt * found["load.surplus"][0, back : back + round(2.0 / dt)].sum()
    assert two_hours == pytest.approx(SHARE * backlog * (1.0 - np.exp(-1.0)))
    # What is shed, and paid for, is the demand alone; nobody takes a surplus in the dark.
    assert found["load.shed"].sum() * dt == pytest.approx(6.0)
    assert np.abs(found["load.surplus"][0, :back]).max() == 0.0
    assert found.objective == pytest.approx(6.0 * 50.0 + 18.0 + taken)


def test_after_long_it_returns_with_its_share_and_falls_to_a_third() -> None:
    case = behind_a_line(96, 15.0, "1-2@00:00-20:00")
    surplus = case_optimum(case)["load.surplus"][0, 80:]
    start = SHARE * TAU / 0.25 * (1.0 - np.exp(-0.25 / TAU))  # the mean over a quarter of an hour
    np.testing.assert_allclose(surplus, start * np.exp(-np.arange(16) * 0.25 / TAU), rtol=1e-4)


SLOTS = 8
GENERATOR = {"p_max_mw": 1.4, "cost_per_mwh": 10.0}
STORE = {"p_max_mw": 1.0, "e_mwh": 2.0, "soc_initial": 0.5}
UP = [1, 1, 0, 0, 0, 1, 1, 1]


def scarce(**keys: Any) -> Case:
    """Both loads on one bus; the set is out for three hours, the store holds one MWh."""
    return small_case(
        slots=SLOTS, load=[COLD | keys, WARM], generator=[GENERATOR], ess=[STORE],
        outages=["generator1@02:00-05:00"],
    )  # fmt: skip


def own_program(tau_h: float = TAU, share: float = SHARE) -> tuple[float, np.ndarray]:
    """Least cost and what is shed of the cold load; its rows written here, from the equations."""
    n = SLOTS
    keep = np.exp(-1.0 / tau_h)
    gain = share * (1.0 - keep)
    # g, charge, discharge, shed cold, shed warm, surplus, backlog at the start of every slot
    g, charge, discharge, cold, warm, surplus, backlog = (np.arange(n) + k * n for k in range(7))
    cost = np.zeros(7 * n)
    cost[g], cost[cold], cost[warm] = 10.0, 50.0, 20.0
    equal, sides, less, most = [], [], [], []

    def row(**terms: Any) -> np.ndarray:
        values = np.zeros(7 * n)
        for columns, value in terms.values():
            values[columns] += value
        return values

    for t in range(n):
        equal.append(row(a=(g[t], 1.0), b=(discharge[t], 1.0), c=(charge[t], -1.0),
                         d=(cold[t], 1.0), e=(warm[t], 1.0), f=(surplus[t], -1.0)))  # fmt: skip
        sides.append(1.5)
        before = row() if t == 0 else row(a=(backlog[t - 1], keep),
                                          b=(cold[t - 1], tau_h * (1.0 - keep)))  # fmt: skip
        equal.append(row(a=(backlog[t], 1.0)) - before)
        sides.append(0.0)
        less += [row(a=(backlog[t], gain), b=(cold[t], -gain * tau_h), c=(surplus[t], -1.0)),
                 row(a=(surplus[t], 1.0), b=(backlog[t], -gain))]  # fmt: skip
        most += [0.0, 0.0]
        stored = row(a=(charge[: t + 1], 1.0), b=(discharge[: t + 1], -1.0))
        less += [stored, -stored]
        most += [1.0, 1.0]
    high = [*(1.4 * np.array(UP)), *np.ones(2 * n), *np.ones(n), *np.full(n, 0.5), *np.full(n, 9.0),
            *np.full(n, 99.0)]  # fmt: skip
    found = linprog(cost, A_ub=np.array(less), b_ub=most, A_eq=np.array(equal), b_eq=sides,
                    bounds=[(0.0, limit) for limit in high])  # fmt: skip
    assert found.status == 0
    return float(found.fun), found.x[cold]


@pytest.mark.parametrize("method", METHODS)
def test_plans_cost_what_a_program_of_ours_does(method: str) -> None:
    plan = rs.solve(scarce(), method)
    assert isinstance(plan, Plan)
    cost, _ = own_program()
    if method == "socp":  # it relaxes that an island is dark as a whole, and says so
        assert "load.whole" in " ".join(plan.relaxed)
        assert plan.objective < cost
        return
    assert plan.objective == pytest.approx(cost, rel=1e-5)
    assert plan.objective > own_program(share=0.0)[0] + 1.0
    again = replay(plan)
    assert again.operating_cost == pytest.approx(plan.operating_cost, rel=1e-6)
    backlog = again.states["load.backlog"][0]
    shed = plan.tables["shed"]["load1"]
    own, keep = 0.0, np.exp(-1.0 / TAU)
    for t in range(SLOTS):
        own = keep * own + TAU * (1.0 - keep) * shed[t]
        assert backlog[t] == pytest.approx(own, abs=1e-6)
    # The surplus is in the balance, and in the power of the load.
    surplus = plan.tables["surplus"]["load1"]
    assert plan.energy_mwh["surplus"] == pytest.approx(surplus.sum())
    assert plan.energy_mwh["losses"] == pytest.approx(0.0, abs=1e-5)
    np.testing.assert_allclose(plan.tables["power"]["load1"], shed - 1.0 - surplus, atol=1e-6)


def test_shedding_who_is_cold_spares_the_surplus_but_no_more() -> None:
    """Back after 6 h with room for half a MW: 1.8 MW are wanted, of a MW per MW shed 1.8 falls."""
    case = behind_a_line(12, 60.0, "1-2@00:00-06:00", cold_load_h=0.5)
    case = case.with_grid("grid1", import_max_mw=0.5)
    found = case_optimum(case)
    served = 1.0 - found["load.shed"][0] + found["load.surplus"][0]
    np.testing.assert_allclose(served[6:], 0.5, atol=1e-9)
    rho = SHARE * (1.0 - np.exp(-2.0))
    backlog = np.concatenate([[0.0], found["load.backlog"][0]])[6:12]
    least = np.maximum(rho * (backlog - 0.5 * found["load.shed"][0, 6:]), 0.0)
    np.testing.assert_allclose(found["load.surplus"][0, 6:], least, atol=1e-9)


def test_a_block_returns_whole_and_with_its_surplus() -> None:
    case = behind_a_line(8, 60.0, "1-2@00:00-04:00", block=True)
    case = case.with_grid("grid1", import_max_mw=1.2)
    found = case_optimum(case)
    assert set(np.round(found["load.on"][0], 9)) <= {0.0, 1.0}
    on = found["load.on"][0] > 0.5
    # 1.8 MW are wanted at first, 1.2 may come: it stays off, and what it lacks is not forgotten.
    assert not on[:5].any()


def test_islands_that_are_dark_by_decision_take_no_surplus() -> None:
    """A store alone forms the island, and is empty; a trickle of sun is lost."""
    store = {"bus": "2", "p_max_mw": 2.0, "e_mwh": 2.0, "soc_initial": 0.0}
    case = small_case(
        slots=8, buses=2, lines=[(1, 2, 0.001, 0.001)], outages=["1-2@00:00-06:00"],
        load=[COLD | {"bus": "2"}], ess=[store], pv=[{"bus": "2", "p_max_mw": 0.1}],
        grid=[{"import_max_mw": 5.0, "import_cost_per_mwh": 1.0}],
    )  # fmt: skip
    found = case_optimum(case)
    dark = found["cell.energised"].min(axis=0) < 0.5
    assert dark.any()
    assert np.abs(found["load.surplus"][0, dark]).max() < 1e-9
    np.testing.assert_allclose(found["load.shed"][0, dark], 1.0, atol=1e-9)
    assert found["load.surplus"][0, 6:].min() > 0.1


def test_reactive_power_goes_with_the_surplus() -> None:
    case = behind_a_line(8, 60.0, "1-2@00:00-04:00", power_factor=0.9)
    plan = rs.solve(case, "lp", physics="lindistflow")
    assert isinstance(plan, Plan)
    q = plan.tables["line_reactive"]["1-2"]
    drawn = -plan.tables["power"]["load1"]
    np.testing.assert_allclose(q, drawn * np.tan(np.arccos(0.9)), atol=1e-5)


def test_plans_over_scenarios_carry_the_backlog() -> None:
    """Two outages of equal chance, seen as they begin, against the plans that know them."""
    case = behind_a_line(12, 60.0)
    down = np.zeros((1, 12, 2), bool)
    down[0, 2:5, 0] = down[0, 4:9, 1] = True
    both = Scenarios(("1-2",), down, np.array([0.5, 0.5]))
    plan = rs.solve(case, "stochastic", scenarios=both)
    alone = [case_optimum(case.replace(outages=f"1-2@{span}")).objective
             for span in ("02:00-05:00", "04:00-09:00")]  # fmt: skip
    assert plan.objective == pytest.approx(np.mean(alone))


def test_off_by_default_nothing_changes() -> None:
    """Neither states nor columns, and the same program."""
    case = behind_a_line(4, 60.0, cold_load_share=0.0)
    program = case_optimum(case).program.standard
    assert not program.has("load.backlog")
    assert not program.has("load.surplus")


@pytest.mark.parametrize(
    ("keys", "wrong"),
    [
        ({"cold_load_share": 50.0}, "cold_load_share"),
        ({"cold_load_h": 500.0}, "cold_load_h"),
        ({"p_max_mw": 0.0, "q_mvar": 1.0}, "cold_load_share"),
    ],
)
def test_nonsense_is_named(keys: dict[str, float], wrong: str) -> None:
    with pytest.raises(CaseError) as caught:
        small_case(load=[COLD | keys], generator=[GENERATOR])
    assert [m.key for m in caught.value.mistakes] == [wrong]


def test_who_cannot_hold_it_says_so() -> None:
    case = rs.load_case("ieee33")
    cold = [load.model_copy(update={"cold_load_share": 0.5, "cold_load_h": 1.0})
            for load in case.load[:2]]  # fmt: skip
    case = case.replace(load=[*cold, *case.load[2:]])
    with pytest.raises(UsageError, match="load1, load2 of case 'ieee33' return with a surplus"):
        Book(case)


def test_a_case_tells_of_units_and_loads() -> None:
    case = scarce().with_generator("generator1", availability=0.9)
    console = Console(width=100)
    with console.capture() as captured:
        print_case(case, console)
    text = captured.get()
    assert "units that fail: generator1" in text
    assert "loads that return with a surplus: load1" in text
