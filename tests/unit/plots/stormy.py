"""Comparisons to draw: a tiny one by hand, and one of the 33-bus feeder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from resilience.case import Case
from resilience.dispatch.registry import DISPATCHERS
from resilience.evaluation.comparison import Comparison
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.microgrid import Microgrid
from resilience.simulation.simulate import simulate
from resilience.simulation.trajectory import Trajectory
from resilience.simulation.world import World
from resilience.testing import small_case

SLOTS = 24


def chain(slots: int = SLOTS) -> Case:
    """Grid at bus 1, storage and PV at bus 2, a load at bus 3 that has no source of its own."""
    return small_case(
        slots=slots,
        buses=3,
        lines=[(1, 2, 0.01, 0.01), (2, 3, 0.01, 0.01)],
        line_tables=[{"name": "1-2", "breakpoint": True}, {"name": "2-3", "breakpoint": True}],
        grid=[{"import_max_mw": 9.0, "import_cost_per_mwh": 1.0}],
        ess=[{"bus": "2", "p_max_mw": 1.0, "e_mwh": 4.0}],
        pv=[{"bus": "2", "p_max_mw": 2.0}],
        load=[
            {"bus": "2", "p_max_mw": 1.0, "shed_cost_per_mwh": 50.0},
            {"bus": "3", "p_max_mw": 0.5, "shed_cost_per_mwh": 50.0},
        ],
        terminal_value_per_mwh=0.5,
    )


def cut(case: Case) -> Scenarios:
    """Both lines in the first episode, at hours that overlap; nothing in the second."""
    down = np.zeros((2, case.slots, 2), bool)
    down[0, 4:8, 0] = True
    down[1, 6:10, 0] = True
    centre = np.full((case.slots // 24, 2), 24)
    return Scenarios(("1-2", "2-3"), down, np.full(2, 0.5), centre)


def compared(case: Case, scenarios: Scenarios, names: Sequence[str]) -> Comparison:
    """What `compare` does, with a bound that is a thousandth below the cheapest method."""
    world = World.build(Microgrid.build(case, "copperplate"), scenarios)
    runs = {name: simulate(world, DISPATCHERS[name](world.setting)) for name in names}
    value = case.terminal_value_per_mwh
    cost = {name: run.objective(value) for name, run in runs.items()}
    bound = np.min(list(cost.values()), axis=0) - 1e-3
    return Comparison(case, scenarios, runs, cost, bound, value)


def by_hand(costs: Mapping[str, Sequence[float]], bound: Sequence[float]) -> Comparison:
    """A day whose costs are given; every method sheds its own length in MWh: idle 4, and so on."""
    case, n = chain(), len(bound)
    scenarios = Scenarios((), np.zeros((0, SLOTS, n), bool), np.full(n, 1.0 / n))
    runs = {}
    for name in costs:
        flows = np.zeros((1, SLOTS, n))
        flows[0, 3] = len(name)
        runs[name] = Trajectory(
            name=name,
            cost=np.zeros((SLOTS, n)),
            energy=np.zeros((1, SLOTS + 1, n)),
            storage=np.zeros((1, SLOTS, n)),
            flows=flows,
            columns=("load.shed[load1]",),
            step_h=1.0,
            seconds=0.0,
        )
    arrays = {name: np.array(values, float) for name, values in costs.items()}
    return Comparison(case, scenarios, runs, arrays, np.array(bound, float), 0.0)
