"""Microgrids from the component library whose optimum can be derived by hand."""

from __future__ import annotations

import numpy as np

from resilience.case import Case
from resilience.models.case_program import horizon
from resilience.models.microgrid import Physics
from resilience.models.structures import Cone, Largest, Split, Structure
from resilience.testing.cases import small_case
from resilience.testing.tiny import TinyProgram, tiny_program


def case_program(
    name: str, case: Case, physics: Physics, optimum: float, structure: type[Structure]
) -> TinyProgram:
    """A case's horizon, whose relaxation has the same optimum."""
    program = horizon(case, physics)
    return TinyProgram(
        name,
        program.standard,
        optimum,
        {structure},
        program.data,
        program.x0,
        relaxed=optimum,
    )


BATTERY = {
    "p_max_mw": 2.0,
    "e_mwh": 6.0,
    "soc_min": 0.1,
    "soc_max": 0.9,
    "efficiency_charge": 0.999,
    "efficiency_discharge": 1.0 / 1.001,
    "degradation_cost_per_mwh": 0.2,
}


@tiny_program
def island() -> TinyProgram:
    """2 MW for two hours from a battery that may give 2.4 MWh: 2.4 / 1.001 are delivered at 0.2,
    the rest of the 4 MWh is shed at 1.5.
    """
    served = 2.4 / 1.001
    case = small_case(
        slots=8,
        step_min=15.0,
        load=[{"p_max_mw": 2.0, "shed_cost_per_mwh": 1.5}],
        ess=[{**BATTERY, "soc_initial": 0.5}],
    )
    optimum = 0.2 * served + 1.5 * (4.0 - served)
    return case_program("island", case, "copperplate", optimum, Split)


@tiny_program
def precharge() -> TinyProgram:
    """2 hours with the grid at 0.3, then 2 without; 1 MW. The empty battery is charged with just
    what it will deliver, 2 * 1.001 / 0.999 MWh, on top of the 2 MWh of demand.
    """
    case = small_case(
        slots=16,
        step_min=15.0,
        buses=2,
        lines=[(1, 2, 0.01, 0.01)],
        outages=["1-2@02:00-04:00"],
        load=[{"bus": "2", "p_max_mw": 1.0, "shed_cost_per_mwh": 1.5}],
        ess=[{"bus": "2", **BATTERY, "soc_initial": 0.1}],
        grid=[{"import_max_mw": 9.0, "export_max_mw": 9.0, "import_cost_per_mwh": 0.3}],
    )
    optimum = 0.3 * (2.0 + 2.0 * 1.001 / 0.999) + 0.2 * 2.0
    return case_program("precharge", case, "copperplate", optimum, Split)


@tiny_program
def feeder() -> TinyProgram:
    """1 MW at the end of r = 0.1, x = 0.05 pu, 1 pu at its head: with l the squared current,
    l = (1 + r l)^2 + (x l)^2, a quadratic; the grid delivers 1 + r l at 1 $/MWh.
    Nothing is exported, so that the import/export split holds by itself.
    """
    r, x = 0.1, 0.05
    a, b = r**2 + x**2, 1.0 - 2.0 * r
    current = (b - np.sqrt(b**2 - 4.0 * a)) / (2.0 * a)
    case = small_case(
        slots=1,
        buses=2,
        lines=[(1, 2, r, x)],
        voltage_band_pu=(0.8, 1.1),
        load=[{"bus": "2", "p_max_mw": 1.0, "shed_cost_per_mwh": 50.0}],
        grid=[{"import_max_mw": 2.0, "import_cost_per_mwh": 1.0}],
    )
    optimum = 1.0 + r * current
    return case_program("feeder", case, "distflow", optimum, Cone)


@tiny_program
def tank() -> TinyProgram:
    """2 MWh of fuel at the start and 3 from 02:00 on, at 10 $ per MWh: the dear load has all of its
    4 MWh, one in every hour, the other has 1 MWh in the last two, and 3 MWh are shed at 30.
    """
    case = small_case(
        slots=4,
        tanks=[
            {
                "capacity_m3": 1.0,
                "initial_m3": 0.5,
                "delivery": [{"hour": 2.0, "amount_m3": 0.75}],
            }
        ],
        generator=[
            {"p_max_mw": 2.0, "cost_per_mwh": 10.0, "tank": "tank1", "fuel_m3_per_mwh": 0.25}
        ],
        load=[
            {"p_max_mw": 1.0, "shed_cost_per_mwh": 150.0},
            {"p_max_mw": 1.0, "shed_cost_per_mwh": 30.0},
        ],
    )
    return case_program("tank", case, "copperplate", 50.0 + 3.0 * 30.0, Largest)
