"""What makes an island alive: a unit that runs, or a storage with energy to give."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from resilience.case import Case
from resilience.models.backends.highs import Highs
from resilience.models.backends.lower import lower
from resilience.models.case_program import as_switched, horizon
from resilience.models.microgrid import Physics
from resilience.testing import small_case
from tests.known.solving import solved

GRID = {"import_max_mw": 5.0, "import_cost_per_mwh": 20.0}
DIESEL = {"bus": "2", "p_max_mw": 2.0, "p_min_mw": 0.2, "cost_per_mwh": 7.0}
DIESEL |= {"no_load_cost_per_h": 40.0}


def cut_off(**devices: Any) -> Case:
    """0.8 MW of load beside 1.3 MW of PV at bus 2, which is cut off from 01:00 to 04:00."""
    return small_case(
        slots=5,
        buses=2,
        lines=[(1, 2, 0.011, 0.013)],
        outages=["1-2@01:00-04:00"],
        load=[{"bus": "2", "p_max_mw": 0.8, "shed_cost_per_mwh": 500.0}],
        grid=[GRID],
        pv=[{"bus": "2", "p_max_mw": 1.3, "s_mva": 1.6}],
        **devices,
    )


@pytest.mark.parametrize("physics", ["copperplate", "lindistflow"])
@pytest.mark.parametrize("method", ["lp", "milp"])
def test_an_island_lives_on_its_generator_only_while_that_runs(
    method: str, physics: Physics
) -> None:
    """3 h of no-load at 40 $/h and 0.2 MWh each at 7 $/MWh; PV alone would cost nothing."""
    found = solved(cut_off(generator=[DIESEL]), method, physics)
    assert found.objective == pytest.approx(3 * (40.0 + 0.2 * 7.0))
    assert found["load.shed"].max() == pytest.approx(0.0, abs=1e-9)
    assert found["generator.on"][0] == pytest.approx([0, 1, 1, 1, 0])


@pytest.mark.parametrize("method", ["milp", "minlp"])
def test_where_the_generator_costs_more_than_the_load_is_worth_it_is_dark(method: str) -> None:
    """500 $/MWh * 0.8 MW for 3 h is less than to run a set of 900 $/h."""
    found = solved(cut_off(generator=[DIESEL | {"no_load_cost_per_h": 900.0}]), method)
    assert found.objective == pytest.approx(3 * 0.8 * 500.0, rel=1e-6)
    assert found["pv.p"][0, 1:4].max() == pytest.approx(0.0, abs=1e-7)
    assert not as_switched(found.problem, found.answer.z).alive[1, 1:4].any()


@pytest.mark.parametrize(
    ("storage", "shed_h"),
    [
        ({"p_max_mw": 0.0, "soc_initial": 0.7}, 3),
        ({"p_max_mw": 0.6, "p_min_mw": 0.0, "soc_initial": 0.7}, 3),
        ({"p_max_mw": 0.6, "soc_initial": 0.7, "grid_forming": False}, 3),
        ({"p_max_mw": 0.6, "soc_initial": 0.3, "soc_min": 0.3, "soc_max": 0.3}, 3),
        ({"p_max_mw": 0.6, "soc_initial": 0.7}, 0),
        ({"p_max_mw": 0.6, "soc_initial": 0.3, "soc_min": 0.3}, 0),  # it charges before the outage
    ],
)
@pytest.mark.parametrize("method", ["lp", "milp", "minlp"])
def test_a_storage_forms_with_energy_to_give(method: str, storage: dict, shed_h: int) -> None:
    found = solved(cut_off(ess=[{"bus": "2", "e_mwh": 2.5, "s_mva": 0.9} | storage]), method)
    assert found.objective == pytest.approx(shed_h * 0.8 * 500.0, abs=1e-4)


@pytest.mark.parametrize("method", ["lp", "milp"])
def test_an_empty_storage_stays_dark_until_the_line_is_back(method: str) -> None:
    """Without PV before the outage nothing can be charged: 2 h are shed although the sun shines."""
    case = small_case(
        slots=4,
        buses=2,
        lines=[(1, 2, 0.011, 0.013)],
        outages=["1-2@00:00-02:00"],
        load=[{"bus": "2", "p_max_mw": 0.8, "shed_cost_per_mwh": 50.0}],
        grid=[GRID],
        pv=[{"bus": "2", "p_max_mw": 1.3}],
        ess=[{"bus": "2", "p_max_mw": 0.6, "e_mwh": 2.5, "soc_min": 0.2, "soc_initial": 0.2}],
    )
    found = solved(case, method, "copperplate")
    assert found.objective == pytest.approx(2 * 0.8 * 50.0)
    assert found["pv.p"][0, :2] == pytest.approx([0.0, 0.0], abs=1e-9)
    alive = as_switched(found.problem, found.answer.z).alive
    assert alive[1].tolist() == [0.0, 0.0, 1.0, 1.0]


@pytest.mark.parametrize("method", ["lp", "milp"])
def test_the_last_thousandth_of_the_energy_keeps_the_sun_at_work(method: str) -> None:
    """The load takes 0.9 MWh in the first hour; 0.1 % of 2.5 MWh has to stay for the second."""
    case = small_case(
        slots=3,
        buses=2,
        lines=[(1, 2, 0.011, 0.013)],
        outages=["1-2@00:00-03:00"],
        profiles={"sun": [0.0, 0.7, 0.9]},
        load=[{"bus": "2", "p_max_mw": 0.9, "shed_cost_per_mwh": 50.0}],
        grid=[GRID],
        pv=[{"bus": "2", "p_max_mw": 1.3, "profile": "sun"}],
        ess=[{"bus": "2", "p_max_mw": 0.91, "e_mwh": 2.5, "soc_min": 0.2, "soc_initial": 0.56}],
    )
    found = solved(case, method, "copperplate")
    assert found.objective == pytest.approx(50.0 * 0.0025, rel=1e-3)
    assert found["ess.energy"][0, 0] == pytest.approx(0.5 + 0.0025, abs=2.5e-6)


@pytest.mark.parametrize("method", ["milp", "minlp"])
def test_a_switched_island_lives_on_the_part_with_a_unit_that_runs(method: str) -> None:
    """A tie joins two parts cut off by the storm; one diesel, at bus 3, carries both."""
    case = small_case(
        slots=3,
        buses=3,
        lines=[(1, 2, 0.011, 0.013), (2, 3, 0.017, 0.019)],
        line_tables=[{"name": "2-3", "switchable": True, "switching_cost": 3.0}],
        outages=["1-2@01:00-03:00"],
        load=[{"bus": "2", "p_max_mw": 0.8, "shed_cost_per_mwh": 500.0}],
        grid=[GRID],
        generator=[DIESEL | {"bus": "3", "q_min_mvar": -0.7, "q_max_mvar": 0.9}],
    )
    found = solved(case, method)
    expected = 0.8 * 20.0 + 2 * (40.0 + 0.8 * 7.0)
    # Wires lose 0.8^2 * 0.017 MW / v^2, 1.4 % of the load, at 7 or 20 $/MWh; none in lindistflow.
    assert found.objective == pytest.approx(expected, rel=1e-6 if method == "milp" else 5e-3)
    assert found["load.shed"].max() == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("method", ["lp", "milp", "minlp"])
@pytest.mark.parametrize(
    ("soc_initial", "sun", "cost"),
    [
        (0.3, [1.1, 0.9, 0.7], 3 * 0.8 * 50.0),  # nothing to form with: all is shed and spilled
        (0.5, [1.1, 0.9, 0.6], 0.0),  # 0.3, 0.1 MW are charged, 0.2 MW discharged
        # 1.1 MWh have room: 0.6 and 0.4 MW of two hours, 0.6 MW of the third have not.
        (0.5, [1.4, 1.2, 1.4], 0.8 * 50.0),
    ],
)
def test_power_that_must_be_taken_is_spilled_in_the_dark(
    method: str, soc_initial: float, sun: list[float], cost: float
) -> None:
    """0.8 MW of load beside PV that cannot be curtailed, in an island that only a storage forms."""
    case = small_case(
        slots=3,
        buses=2,
        lines=[(1, 2, 0.011, 0.013)],
        outages=["1-2@00:00-03:00"],
        profiles={"sun": [s / 1.3 for s in sun]},
        load=[{"bus": "2", "p_max_mw": 0.8, "shed_cost_per_mwh": 50.0}],
        grid=[GRID],
        pv=[{"bus": "2", "p_max_mw": 1.3, "profile": "sun", "curtailable": False}],
        ess=[{"bus": "2", "p_max_mw": 0.65, "e_mwh": 2.5, "s_mva": 0.9, "soc_min": 0.3}
             | {"soc_max": 0.94, "soc_initial": soc_initial}],
    )  # fmt: skip
    found = solved(case, method)
    assert found.objective == pytest.approx(cost, abs=1e-4)
    alive = as_switched(found.problem, found.answer.z).alive[1] > 0.5
    fed = np.array(sun) * alive
    assert alive.sum() == 3 - round(cost / 40.0)
    assert found["pv.p"][0] == pytest.approx(fed, abs=1e-6)


@pytest.mark.parametrize(("q_min", "q_max", "needed"), [(0.7, 0.9, 0.437), (-0.9, -0.5, 0.763)])
def test_an_inverter_has_all_the_reactive_power_of_its_rating(
    q_min: float, q_max: float, needed: float
) -> None:
    """The load takes 0.8 tan(acos 0.95) = 0.263 Mvar; while it runs, the diesel gives at least 0.7
    or takes 0.5. The others are the storage's, which is too empty to form and has 0.2 MW only.
    """
    case = small_case(
        slots=3,
        buses=2,
        lines=[(1, 2, 0.011, 0.013)],
        outages=["1-2@01:00-03:00"],
        load=[{"bus": "2", "p_max_mw": 0.8, "shed_cost_per_mwh": 500.0, "power_factor": 0.95}],
        grid=[GRID],
        generator=[DIESEL | {"q_min_mvar": q_min, "q_max_mvar": q_max}],
        ess=[{"bus": "2", "p_max_mw": 0.2, "e_mwh": 2.5, "s_mva": 0.9, "soc_min": 0.3}
             | {"soc_initial": 0.3}],
    )  # fmt: skip
    found = solved(case, "milp")
    # It stands still where the grid is there.
    assert found["generator.on"][0] == pytest.approx([0, 1, 1])
    assert found.objective == pytest.approx(0.8 * 20.0 + 2 * (40.0 + 0.8 * 7.0))
    diesel, storage = found["generator.q"][0], found["ess.q"][0]
    assert diesel[0] == pytest.approx(0.0, abs=1e-9)
    assert (diesel + storage)[1:] == pytest.approx([0.26295, 0.26295], abs=1e-5)
    assert (np.abs(storage[1:]) > needed - 1e-3).all()


def test_a_line_that_is_up_leaves_no_part_of_an_island_dark() -> None:
    """Beside a switchable line, too. The sun of bus 4, 1.3 MW that nobody can turn down, is too
    much for the load of bus 2: while the grid is away, the diesel may not run without it.
    """
    case = small_case(
        slots=3,
        buses=4,
        lines=[(1, 2, 0.011, 0.013), (2, 3, 0.017, 0.019), (4, 3, 0.012, 0.014)],
        line_tables=[
            {"name": "2-3", "switchable": True},
            {"name": "4-3", "breakpoint": True},
        ],
        outages=["1-2@01:00-03:00"],
        profiles={"sun": [0.3, 1.0, 1.0]},
        load=[{"bus": "2", "p_max_mw": 0.8, "shed_cost_per_mwh": 500.0}],
        grid=[GRID],
        generator=[DIESEL | {"bus": "3", "q_min_mvar": -0.7, "q_max_mvar": 0.9}],
        pv=[{"bus": "4", "p_max_mw": 1.3, "profile": "sun", "curtailable": False}],
    )
    found = solved(case, "milp")
    assert found.objective == pytest.approx((0.8 - 0.3 * 1.3) * 20.0 + 2 * 0.8 * 500.0)
    assert found["pv.p"][0] == pytest.approx([0.39, 0.0, 0.0], abs=1e-6)


@pytest.mark.parametrize(("lack_mwh", "status"), [(1e-6, "optimal"), (1.5e-6, "infeasible")])
def test_a_rounding_below_the_lowest_energy_leaves_a_program_its_solution(
    lack_mwh: float, status: str
) -> None:
    """Half a millionth of the capacity of 2.5 MWh is 1.25e-6 MWh."""
    storage = {"bus": "2", "p_max_mw": 0.6, "e_mwh": 2.5, "soc_min": 0.3, "soc_initial": 0.3}
    program = horizon(cut_off(ess=[storage]), "copperplate")
    solver = Highs(lower(program.standard, integer="none", modes={}))
    start = {"ess.energy": np.array([0.3 * 2.5 - lack_mwh])}
    solver.update(program.standard.vectors(program.data, start))
    assert solver.solve().status == status
