"""Microgrids from the component library whose optimum can be derived by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
from small import small
from tiny import Tiny, tiny

from resilience.case import Case
from resilience.models.case_program import horizon
from resilience.models.microgrid import Physics


def of_case(
    name: str, case: Case, physics: Physics, optimum: float, needs: set[str], **more: Any
) -> Tiny:
    made = horizon(case, physics)
    return Tiny(name, made.standard, optimum, frozenset(needs), made.data, made.x0, **more)


BATTERY = {
    "p_max_mw": 2.0,
    "e_mwh": 6.0,
    "soc_min": 0.1,
    "soc_max": 0.9,
    "efficiency_charge": 0.999,
    "efficiency_discharge": 1.0 / 1.001,
    "degradation_cost_per_mwh": 0.2,
}


@tiny
def island() -> Tiny:
    # 2 MW for two hours from a battery that may give 2.4 MWh: 2.4 / 1.001 are delivered at 0.2,
    # the rest of the 4 MWh is shed at 1.5.
    served = 2.4 / 1.001
    case = small(
        slots=8,
        step_min=15.0,
        load=[{"p_max_mw": 2.0, "shed_cost_per_mwh": 1.5}],
        ess=[{**BATTERY, "soc_initial": 0.5}],
    )
    best = 0.2 * served + 1.5 * (4.0 - served)
    return of_case("island", case, "copperplate", best, {"affine", "split"}, relaxed=best)


@tiny
def precharge() -> Tiny:
    # 2 hours with the grid at 0.3, then 2 without; 1 MW. The empty battery is charged with just
    # what it will deliver, 2 * 1.001 / 0.999 MWh, on top of the 2 MWh of demand.
    case = small(
        slots=16,
        step_min=15.0,
        buses=2,
        lines=[(1, 2, 0.01, 0.01)],
        outages=["1-2@02:00-04:00"],
        load=[{"bus": "2", "p_max_mw": 1.0, "shed_cost_per_mwh": 1.5}],
        ess=[{"bus": "2", **BATTERY, "soc_initial": 0.1}],
        grid=[{"import_max_mw": 9.0, "export_max_mw": 9.0, "import_cost_per_mwh": 0.3}],
    )
    best = 0.3 * (2.0 + 2.0 * 1.001 / 0.999) + 0.2 * 2.0
    return of_case("precharge", case, "copperplate", best, {"affine", "split"}, relaxed=best)


@tiny
def feeder() -> Tiny:
    # 1 MW at the end of r = 0.1, x = 0.05 pu, 1 pu at its head: with l the squared current,
    # l = (1 + r l)^2 + (x l)^2, a quadratic; the grid delivers 1 + r l at 1 $/MWh.
    # Nothing is exported, so that the import/export split holds by itself.
    r, x = 0.1, 0.05
    a, b = r**2 + x**2, 1.0 - 2.0 * r
    current = (b - np.sqrt(b**2 - 4.0 * a)) / (2.0 * a)
    case = small(
        slots=1,
        buses=2,
        lines=[(1, 2, r, x)],
        band=(0.8, 1.1),
        load=[{"bus": "2", "p_max_mw": 1.0, "shed_cost_per_mwh": 50.0}],
        grid=[{"import_max_mw": 2.0, "import_cost_per_mwh": 1.0}],
    )
    best = 1.0 + r * current
    return of_case("feeder", case, "distflow", best, {"affine", "cone"}, relaxed=best)
