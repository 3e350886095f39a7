"""What follows from which lines there are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from resilience.models.network.graph import bridges, bundle, cycle
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


def test_a_line_that_stays_open_closes_no_cycle_and_shares_nothing() -> None:
    """A ring 1-2-3 whose side 3-1 is out of use, and 3-4 with a twin that is out of use, too."""
    pairs = [(1, 2), (2, 3), (3, 1), (3, 4), (3, 4)]
    closed = small_case(
        buses=4,
        lines=[(i, j, 0.02 + 0.003 * k, 0.04 + 0.007 * k) for k, (i, j) in enumerate(pairs)],
        load=[{"bus": "4", "p_max_mw": 0.8, "shed_cost_per_mwh": 9.0}],
        grid=[{"import_max_mw": 1.7, "import_cost_per_mwh": 2.0}],
    ).network
    assert closed.line_names == ("1-2", "2-3", "3-1", "3-4", "3-4#2")
    fallible = np.zeros(5, bool)
    assert sorted(cycle(closed)) == ["1-2", "2-3", "3-1"]
    assert not bridges(closed).any()
    assert bundle(closed, fallible).line_names == ("1-2", "2-3", "3-1", "3-4")
    in_use = np.array([True, True, False, True, False])
    network = replace(closed, in_service=in_use)
    assert cycle(network) == []
    assert bridges(network)[in_use].all()
    assert bundle(network, fallible) is network
