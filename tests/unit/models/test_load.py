"""Loads: shed in the order of their price, and blocks whole or not at all."""

from __future__ import annotations

from typing import Any

import pytest

from resilience.testing import CaseOptimum, case_optimum, small_case


def served(loads: list[dict[str, Any]], supply: float, **more: Any) -> CaseOptimum:
    grid = [{"import_max_mw": supply, "import_cost_per_mwh": 0.0}]
    return case_optimum(small_case(load=loads, grid=grid, **more))


def test_the_cheapest_load_is_shed_first() -> None:
    # 2 MW for 3 MW of demand. `priority` multiplies the price: 2 * 3 > 5.
    found = served(
        [
            {"p_max_mw": 1.5, "shed_cost_per_mwh": 5.0},
            {"p_max_mw": 1.5, "shed_cost_per_mwh": 2.0, "priority": 3.0},
        ],
        supply=2.0,
    )
    assert found["load.shed"][:, 0] == pytest.approx([1.0, 0.0])
    assert found.objective == pytest.approx(2 * 5.0)


def test_a_block_is_served_whole_or_not_at_all() -> None:
    # 1.5 MW for blocks of 1.0, 0.8 and 0.6 MW: 0.8 + 0.6 beats 1.0 alone.
    blocks = [{"p_max_mw": p, "shed_cost_per_mwh": 1.0, "block": True} for p in (1.0, 0.8, 0.6)]
    found = served(blocks, supply=1.5)
    assert found["load.shed"][:, 0] == pytest.approx([1.0, 0.0, 0.0])
    assert found.objective == pytest.approx(2 * 1.0)


def test_a_load_that_is_no_block_fills_what_blocks_leave() -> None:
    loads = [
        {"p_max_mw": 1.0, "shed_cost_per_mwh": 2.0, "block": True},
        {"p_max_mw": 1.0, "shed_cost_per_mwh": 1.0},
    ]
    found = served(loads, supply=1.6)
    assert found["load.shed"][:, 0] == pytest.approx([0.0, 0.4])
    found = served(loads, supply=0.9)
    assert found["load.shed"][:, 0] == pytest.approx([1.0, 0.1])


def test_a_block_follows_its_profile() -> None:
    # The block is 1 MW, then 0.4 MW: too much for 0.5 MW at first, whole afterwards.
    block = {"p_max_mw": 1.0, "profile": "day", "shed_cost_per_mwh": 1.0, "block": True}
    found = served([block], supply=0.5, profiles={"day": [1.0, 0.4]})
    assert found["load.shed"][0] == pytest.approx([1.0, 0.0])


@pytest.mark.parametrize("block", [False, True])
def test_a_dead_island_sheds_everything(block: bool) -> None:
    load = {"bus": "2", "p_max_mw": 1.0, "shed_cost_per_mwh": 1.0, "block": block}
    found = served(
        [load],
        supply=5.0,
        buses=2,
        lines=[(1, 2, 0.01, 0.01)],
        outages=["1-2@01:00-02:00"],
    )
    assert found["load.shed"][0] == pytest.approx([0.0, 1.0])


def test_a_block_may_ask_for_more_than_its_nominal_peak() -> None:
    # Profiles up to 2 are allowed: 1.5 MW then 0.5 MW, all of it served.
    block = {"p_max_mw": 1.0, "profile": "high", "shed_cost_per_mwh": 1.0, "block": True}
    found = served([block], supply=2.0, profiles={"high": [1.5, 0.5]})
    assert found["load.shed"][0] == pytest.approx([0.0, 0.0])
