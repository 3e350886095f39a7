"""A feeder that is dark for an unknown time, with fuel for a part of it."""

from __future__ import annotations

import numpy as np

from resilience.case import Case
from resilience.fragility.outages.blackout import case_blackout
from resilience.fragility.outages.scenarios import Scenarios
from resilience.simulation.world import World, microgrid_with_fallible_lines
from resilience.testing import small_case

SLOTS = 20
FIRST = 2
DEMAND = (0.7 + 0.3 * np.sin(np.arange(SLOTS) / 3.0)).tolist()
LAW = {"law": "lognormal", "hours": [6.0, 0.7], "longest_h": 15.0}


def dark(**blackout: object) -> Case:
    """Cut off from 02:00 on with 8 of up to 30 MWh of fuel, and dear and cheap load."""
    case = small_case(
        slots=SLOTS,
        buses=2,
        lines=[(1, 2, 0.001, 0.001)],
        line_tables=[{"name": "1-2", "breakpoint": True}],
        profiles={"demand": DEMAND},
        terminal_value_per_mwh=0.5,
        tanks=[{"capacity_m3": 2.0, "delivery": [{"hour": 9.0, "amount_m3": 0.5}]}],
        generator=[
            {"bus": "2", "p_max_mw": 2.0, "cost_per_mwh": 2.0, "tank": "tank1"}
            | {"fuel_m3_per_mwh": 0.25}
        ],
        load=[
            {"bus": "2", "profile": "demand", "p_max_mw": 0.7, "shed_cost_per_mwh": 150.0},
            {"bus": "2", "profile": "demand", "p_max_mw": 1.3, "shed_cost_per_mwh": 30.0},
        ],
        ess=[{"bus": "2", "p_max_mw": 1.0, "e_mwh": 4.0, "soc_initial": 1.0}],
        grid=[{"import_max_mw": 5.0, "import_cost_per_mwh": 0.3}],
    )
    start = case.window.time(FIRST)
    return case.replace(blackout={"start": start, **LAW, **blackout})


def world(case: Case | None = None, storms: Scenarios | None = None) -> World:
    """Every end that the blackout can have, with its probability, unless storms are given."""
    case = case or dark()
    storms = storms or case_blackout(case).every_end()
    return World.build(microgrid_with_fallible_lines(case, storms, "copperplate"), storms)
