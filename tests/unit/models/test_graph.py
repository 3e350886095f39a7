"""What follows from which lines there are."""

from __future__ import annotations

from resilience.models.network.graph import bridges
from resilience.testing import small_case


def test_the_flow_of_a_line_in_no_cycle_of_firm_lines_follows_from_the_injections() -> None:
    """A ring 1-2-3, two lines side by side 3-4, and a ring 4-5-6 that a switch keeps open."""
    ring, side_by_side = [(1, 2), (2, 3), (3, 1)], [(3, 4), (3, 4)]
    open_ring = [(4, 5), (5, 6), (6, 4)]
    pairs = [*ring, *side_by_side, *open_ring]
    case = small_case(
        buses=6,
        lines=[(i, j, 0.02 + 0.003 * k, 0.04 + 0.007 * k) for k, (i, j) in enumerate(pairs)],
        line_tables=[{"name": "5-6", "switchable": True}],
        load=[{"bus": "5", "p_max_mw": 0.8, "shed_cost_per_mwh": 9.0}],
        grid=[{"import_max_mw": 1.7, "import_cost_per_mwh": 2.0}],
    )
    found = dict(zip(case.network.line_names, bridges(case.network).tolist(), strict=True))
    assert found == {
        "1-2": False,
        "2-3": False,
        "3-1": False,
        "3-4": False,
        "3-4#2": False,
        "4-5": True,
        "5-6": True,
        "6-4": True,
    }
