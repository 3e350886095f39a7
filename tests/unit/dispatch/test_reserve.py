"""The storm reserve by hand: who is cut off by what, how much they lack, and at what price."""

from __future__ import annotations

import numpy as np
import pytest

import resilience as rs
from resilience.case import Case
from resilience.dispatch.reserve import Reserve, reserve_price
from resilience.models.microgrid import Microgrid
from resilience.testing import small_case


def chain(extra: tuple[tuple[int, int, float, float], ...] = (), **head: object) -> Case:
    """A grid at bus 1, then two breakpoints in a row; a store behind each."""
    lines = [(1, 2, 0.01, 0.01), (2, 3, 0.01, 0.01), *extra]
    return small_case(
        slots=8,
        buses=3,
        lines=lines,
        line_tables=[{"name": f"{i}-{j}", "breakpoint": True} for i, j, *_ in lines],
        load=[
            {"bus": "2", "p_max_mw": 1.0, "shed_cost_per_mwh": 9.0},
            {"bus": "3", "p_max_mw": 3.0, "shed_cost_per_mwh": 8.0, "priority": 2.0},
        ],
        generator=[{"bus": "3", "p_max_mw": 1.0, "cost_per_mwh": 5.0}],
        ess=[
            {"bus": "2", "p_max_mw": 4.0, "e_mwh": 10.0, "soc_min": 0.1, "soc_max": 0.9},
            {"bus": "3", "p_max_mw": 1.5, "e_mwh": 10.0, "efficiency_discharge": 0.5},
        ],
        grid=[{"import_max_mw": 9.0, "import_cost_per_mwh": 1.0}],
        **head,  # type: ignore[arg-type]
    )


def reserve(case: Case) -> Reserve:
    names = [n for n, b in zip(case.network.line_names, case.network.breakpoint, strict=True) if b]
    return Reserve(Microgrid.build(case, "copperplate"), tuple(names))


def test_a_bus_is_cut_off_by_every_line_on_its_way_to_the_grid() -> None:
    found = reserve(chain())
    assert found.cut_off_by.tolist() == [[True, False], [True, True]]
    chance = found.cut_off(np.array([[0.1, 0.0], [0.2, 0.5]]))
    np.testing.assert_allclose(chance, [[0.1, 0.0], [1 - 0.9 * 0.8, 0.5]])


def test_a_bus_in_a_ring_depends_on_all_lines() -> None:
    found = reserve(chain(extra=((1, 3, 0.01, 0.01),)))
    assert found.cut_off_by.all()


def test_the_level_is_what_loads_lack_as_far_as_storage_gives_it() -> None:
    """Bus 2 lacks 1 MW: 3 MWh in three slots, above a floor of 1 MWh. Bus 3 lacks 3 - 1 = 2 MW, of
    which its store gives 1.5, so 4.5 MWh in three slots or 9 MWh in store at an efficiency of 0.5.
    """
    case = chain()
    found = reserve(case)
    lack = found.lack(lambda name, at: case.profile(name)[at], 0, 8)
    np.testing.assert_allclose(lack, [[1.0] * 8, [2.0] * 8])
    np.testing.assert_allclose(found.level(lack, 3), [[4.0] * 6, [9.0] * 6])
    np.testing.assert_allclose(found.level(lack, 8), [[9.0], [10.0]])  # all that fits


def test_a_line_that_is_sure_to_fail_cuts_off() -> None:
    chance = reserve(chain()).cut_off(np.array([[1.0, 0.3], [0.2, 0.5]]))
    np.testing.assert_allclose(chance, [[1.0, 0.3], [1.0, 1 - 0.7 * 0.5]], atol=1e-11)


def mixed() -> Case:
    """Load and sun that vary, behind a line: two unequal stores and a generator at bus 2."""
    return small_case(
        slots=6,
        step_min=30.0,
        buses=2,
        lines=[(1, 2, 0.01, 0.01)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        profiles={
            "demand": [0.9, 0.2, 0.4, 0.5, 0.8, 0.6],
            "sun": [0.1, 0.3, 0.0, 0.5, 0.25, 0.0],
        },
        load=[
            {"bus": "2", "p_max_mw": 5.0, "shed_cost_per_mwh": 9.0, "profile": "demand"},
            {"bus": "1", "p_max_mw": 3.0, "shed_cost_per_mwh": 8.0},
        ],
        pv=[{"bus": "2", "p_max_mw": 2.0, "profile": "sun"}],
        generator=[{"bus": "2", "p_max_mw": 0.7, "cost_per_mwh": 5.0}],
        ess=[
            {"bus": "2", "p_max_mw": 1.1, "p_min_mw": -1.3, "e_mwh": 4.0}
            | {"efficiency_discharge": 0.9, "soc_min": 0.2, "soc_max": 0.95},
            {"bus": "2", "p_max_mw": 0.6, "p_min_mw": -0.8, "e_mwh": 12.0}
            | {"efficiency_discharge": 0.5, "soc_min": 0.1, "soc_max": 0.8},
        ],
        grid=[{"import_max_mw": 9.0, "import_cost_per_mwh": 1.0}],
    )


def test_what_loads_lack_from_a_slot_on() -> None:
    """Slot 3: 2.5 MW of load less 1 of sun and 0.7 of the generator; the last slot is repeated."""
    case = mixed()
    lack = reserve(case).lack(lambda name, at: case.profile(name)[at], 3, 5)
    np.testing.assert_allclose(lack, [[0.8, 2.8, 2.3, 2.3, 2.3]])


def test_stores_of_one_bus_give_by_their_size() -> None:
    """2.1 MW between them, at an efficiency of (4 0.9 + 12 0.5) / 16 = 0.6, above 2 MWh of floor.

    Outages of two half hours from slot 3: 0.8 + 2.1 MW; then 2.1 twice, which is 3.5 MWh stored.
    """
    case = mixed()
    found = reserve(case)
    lack = found.lack(lambda name, at: case.profile(name)[at], 3, 5)
    np.testing.assert_allclose(
        found.level(lack, 2), [[2.0 + 0.5 * 2.9 / 0.6, 2.0 + 0.5 * 4.2 / 0.6, 5.5, 5.5]]
    )
    # A surplus of a slot is of no use in another.
    np.testing.assert_allclose(
        found.level(np.array([[-0.6, 0.8, 1.5, -0.4]]), 2),
        [[2.0 + 0.5 * 0.8 / 0.6, 2.0 + 0.5 * 2.3 / 0.6, 2.0 + 0.5 * 1.5 / 0.6]],
    )
    # All that fits: 0.95 of 4 and 0.8 of 12 MWh.
    np.testing.assert_allclose(found.level(np.full((1, 30), 9.0), 29), [[13.4, 13.4]])


def test_the_price_lies_between_the_generator_and_shedding() -> None:
    assert reserve_price(chain()) == pytest.approx((5.0 + 9.0) / 2)
    case = rs.load_case("ieee33")
    assert reserve_price(case) == pytest.approx((0.5 + 1.5) / 2)
    assert reserve_price(case.replace(reserve_price_per_mwh=0.7)) == 0.7
    for wrong in (0.5, 1.5, 2.0):
        with pytest.raises(
            rs.CaseError, match=r"above 0\.5, the dearest generator, and below 1\.5"
        ):
            case.replace(reserve_price_per_mwh=wrong)
