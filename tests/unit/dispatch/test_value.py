"""What a MWh in storage is worth: hand values, and every way of selling it, one by one."""

from __future__ import annotations

import numpy as np
import pytest

from resilience.case import Case
from resilience.dispatch.end_value import energy_price, stored_energy_value
from resilience.testing import small_case


def trader(prices: list[float]) -> Case:
    """Efficiencies of 0.9 and 0.8, and wear of 1 $/MWh."""
    return small_case(
        slots=len(prices),
        profiles={"price": [p / 60.0 for p in prices]},
        load=[{"p_max_mw": 1.0, "shed_cost_per_mwh": 1e3}],
        ess=[
            {
                "p_max_mw": 1.0,
                "e_mwh": 4.0,
                "efficiency_charge": 0.9,
                "efficiency_discharge": 0.8,
                "degradation_cost_per_mwh": 1.0,
            }
        ],
        grid=[{"import_max_mw": 2.0, "import_cost_per_mwh": 60.0, "price_profile": "price"}],
    )


def test_night_day_and_evening_by_hand() -> None:
    """Sold for (31 - 1) * 0.8 = 24 in the evening; by day another one costs 18 / 0.9 = 20, at night
    9 / 0.9 = 10."""
    value = stored_energy_value(trader([9.0, 18.0, 31.0]), 5.0)
    np.testing.assert_allclose(value, [[10.0, 20.0, 24.0, 5.0]])


@pytest.mark.parametrize("seed", range(20))
def test_no_way_of_selling_is_better(seed: int) -> None:
    rng = np.random.default_rng(seed)
    prices, end = rng.uniform(2.0, 60.0, 7), float(rng.uniform(5.0, 30.0))
    value = stored_energy_value(trader(prices.tolist()), end)[0]
    buy, sell = prices / 0.9, (prices - 1.0) * 0.8
    for t in range(7):
        kept = min(end, buy[t:].min())
        sold = [min(sell[s], buy[t : s + 1].min()) for s in range(t, 7)]
        assert value[t] == pytest.approx(max(kept, *sold))


def test_without_a_grid_it_is_the_cheapest_generator() -> None:
    case = small_case(
        load=[{"p_max_mw": 1.0, "shed_cost_per_mwh": 50.0}],
        generator=[{"p_max_mw": 2.0, "cost_per_mwh": 7.0}, {"p_max_mw": 2.0, "cost_per_mwh": 6.0}],
        ess=[{"p_max_mw": 1.0, "e_mwh": 2.0}],
    )
    assert energy_price(case).tolist() == [6.0, 6.0]
    np.testing.assert_allclose(stored_energy_value(case, 9.0), [[6.0, 6.0, 9.0]])


def test_of_several_grids_the_cheapest_of_each_slot_counts() -> None:
    """Two connections that never meet; one follows a profile: 7, 3.5 and 5.25 against 6 $/MWh."""
    case = small_case(
        slots=3,
        buses=2,
        profiles={"price": [1.0, 0.5, 0.75]},
        load=[{"p_max_mw": 2.0, "shed_cost_per_mwh": 50.0}],
        grid=[
            {"bus": "1", "import_max_mw": 3.0, "import_cost_per_mwh": 6.0},
            {"bus": "2", "import_max_mw": 4.0, "import_cost_per_mwh": 7.0}
            | {"price_profile": "price"},
        ],
        generator=[{"bus": "2", "p_max_mw": 2.0, "cost_per_mwh": 2.0}],
        ess=[
            {"p_max_mw": 2.0, "e_mwh": 3.0, "efficiency_charge": 0.8, "efficiency_discharge": 0.9}
            | {"degradation_cost_per_mwh": 0.5}
        ],
    )
    assert energy_price(case).tolist() == [6.0, 3.5, 5.25]
    # Sold now at (6 - 0.5) 0.9; bought at 3.5 / 0.8, below 4.5; kept rather than sold at 4.275.
    np.testing.assert_allclose(stored_energy_value(case, 4.5), [[4.95, 4.375, 4.5, 4.5]])
