"""Several grids, parallel lines, prices below zero, and energy that has to be left."""

from __future__ import annotations

from typing import Any

import pytest

from resilience.case import Case
from resilience.errors import CaseError
from resilience.models.microgrid import Physics
from resilience.testing import small_case
from tests.known.solving import solved

LINES = [(1, 2, 0.011, 0.013), (2, 3, 0.017, 0.019)]
LOAD = {"bus": "2", "p_max_mw": 0.7, "shed_cost_per_mwh": 90.0}


def grid(bus: str, price: float, v_pu: float = 1.02) -> dict[str, Any]:
    return {"bus": bus, "import_max_mw": 5.0, "import_cost_per_mwh": price, "v_pu": v_pu}


def two_grids(switchable: tuple[str, ...]) -> Case:
    return small_case(
        buses=3,
        lines=LINES,
        line_tables=[{"name": name, "switchable": True} for name in switchable],
        load=[LOAD],
        grid=[grid("1", 20.0), grid("3", 30.0)],
    )


def test_fixed_lines_do_not_parallel_grids() -> None:
    with pytest.raises(CaseError, match="parallel_grids = true"):
        two_grids(())


def test_one_place_has_one_voltage() -> None:
    with pytest.raises(CaseError, match=r"1.03, where \[\[grid\]\] grid1 at bus 2 holds 1.02"):
        small_case(buses=3, lines=LINES, load=[LOAD], grid=[grid("2", 20.0), grid("2", 30.0, 1.03)])


@pytest.mark.parametrize("physics", ["copperplate", "lindistflow"])
def test_each_tree_hangs_on_one_grid(physics: Physics) -> None:
    """The cheap grid feeds the load; the tie to the other one is opened."""
    found = solved(two_grids(("1-2", "2-3")), "milp", physics)
    assert found["line.closed"].tolist() == [[1.0, 1.0], [0.0, 0.0]]
    assert found.objective == pytest.approx(2 * 0.7 * 20.0)


@pytest.mark.parametrize("method", ["lp", "milp"])
def test_a_negative_price_pays_for_what_is_imported(method: str) -> None:
    """At -6 $/MWh 0.7 MW of load and 0.4 MW of charging are paid for; no MW goes both ways."""
    case = small_case(
        slots=2,
        profiles={"price": [-0.3, 2.0]},
        load=[LOAD | {"bus": "1"}],
        grid=[grid("1", 20.0) | {"export_max_mw": 3.0, "price_profile": "price"}
              | {"export_cost_per_mwh": 25.0}],
        ess=[{"p_max_mw": 0.4, "e_mwh": 2.5, "soc_initial": 0.3, "soc_min": 0.3}],
    )  # fmt: skip
    found = solved(case, method)
    assert found.objective == pytest.approx(1.1 * -6.0 + 0.3 * 40.0)
    assert found["grid.export"].max() == pytest.approx(0.0, abs=1e-9)


def test_energy_that_has_to_be_left_is_bought() -> None:
    """2.1 MWh of load less 0.25 MWh from storage, which ends at 0.3 of 2.5 MWh, at 20 $/MWh."""
    case = small_case(
        slots=3,
        load=[LOAD | {"bus": "1"}],
        grid=[grid("1", 20.0)],
        ess=[{"p_max_mw": 0.6, "e_mwh": 2.5, "soc_min": 0.1, "soc_initial": 0.4}
             | {"soc_final_min": 0.3}],
    )  # fmt: skip
    found = solved(case, "lp")
    assert found.objective == pytest.approx(1.85 * 20.0)
    assert found["ess.energy"][0, -1] == pytest.approx(0.75)
