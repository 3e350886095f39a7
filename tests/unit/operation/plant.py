"""A microgrid in a storm, as an energy management system meets it: it measures, asks, and acts."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from resilience.case import Case
from resilience.dispatch.registry import factory_of
from resilience.fragility.draw import sample_case
from resilience.models.simulator import Simulator
from resilience.simulation.forecast import ForecastError, sample_outlook
from resilience.simulation.simulate import simulate
from resilience.simulation.trajectory import Trajectory
from resilience.simulation.world import World, microgrid_with_fallible_lines
from resilience.testing import small_case

ERROR = ForecastError(0.05, 0.9, 0.3)


def storm_case(slots: int = 96, step_min: float = 15.0, **changes: Any) -> Case:
    """Three buses in a row, each cut off by its own line in a storm; two unequal batteries."""
    hours = np.arange(slots) * step_min / 60.0
    load = 0.6 + 0.3 * np.sin((hours - 9.0) * math.pi / 12.0)
    sun = np.maximum(np.sin((hours - 6.0) * math.pi / 12.0), 0.0)
    price = np.where((hours > 16.0) & (hours < 21.0), 3.0, 1.0)
    devices: dict[str, Any] = {
        "load": [
            {"bus": "2", "p_max_mw": 0.7, "profile": "load", "shed_cost_per_mwh": 8.0},
            {"bus": "3", "p_max_mw": 1.1, "profile": "load", "shed_cost_per_mwh": 5.0},
        ],
        "pv": [{"bus": "3", "p_max_mw": 0.9, "profile": "sun"}],
        "ess": [
            {"bus": "2", "p_max_mw": 0.5, "e_mwh": 1.3, "soc_initial": 0.4, "soc_max": 0.9},
            {"bus": "3", "p_max_mw": 0.8, "e_mwh": 2.1, "soc_min": 0.15, "soc_initial": 0.6,
             "efficiency_charge": 0.95, "efficiency_discharge": 0.92},
        ],
        "generator": [{"bus": "2", "p_max_mw": 0.3, "cost_per_mwh": 0.5}],
        "grid": [{"import_max_mw": 4.0, "import_cost_per_mwh": 0.15, "price_profile": "price"}],
    }  # fmt: skip
    return small_case(
        slots=slots,
        step_min=step_min,
        buses=3,
        lines=[(1, 2, 0.01, 0.02), (2, 3, 0.03, 0.01)],
        line_tables=[{"name": f"{k}-{k + 1}", "breakpoint": True} for k in (1, 2)],
        profiles={name: [*map(float, v)] for name, v in
                  {"load": load, "sun": sun, "price": price}.items()},
        terminal_value_per_mwh=0.2,
        **(devices | changes),
    )  # fmt: skip


def storm_world(case: Case, error: ForecastError | None = None) -> World:
    """The worst of some days of a case, called scenario 0."""
    storms = sample_case(case, 24, 5)
    worst = int(np.argmax(storms.down.sum((0, 1))))
    grid = microgrid_with_fallible_lines(case, storms, "copperplate")
    outlook = None if error is None else sample_outlook(case, error, storms.n, seed=7)
    world = World.build(grid, storms, outlook=outlook).with_scenarios(np.array([worst]))
    return replace(world, numbers=np.zeros(1, np.intp))


def simulated(world: World, method: str) -> Trajectory:
    """What the simulator makes of a method."""
    return simulate(world, factory_of(method)(world.setting))


class Plant:
    """What really happens, in one scenario.

    Attributes:
        energy: (units, 1) MWh that are stored.
        cost: $ so far.
    """

    def __init__(self, world: World) -> None:
        self.world, self.case = world, world.microgrid.case
        self.energy, self.cost = world.start(), 0.0

    def state(self, t: int) -> dict[str, Any]:
        """What is measured and forecast in slot t, as JSON carries it."""
        world, case = self.world, self.case
        slots = np.arange(t, case.slots)
        names = () if world.outlook is None else world.outlook.names
        centre = int(world.centre(t)[0])
        stored = zip(case.ess, self.energy[:, 0], strict=True)
        status = zip(case.elements, world.line_up[:, t, 0], strict=True)
        state: dict[str, Any] = {
            "time": case.window.time(t).isoformat(),
            "energy_mwh": {unit.name: float(energy) for unit, energy in stored},
            "down": [name for name, up in status if not up],
            "forecast": {name: world.forecast(t)(name, slots)[:, 0].tolist() for name in names},
        }
        if centre >= 0:
            state["hazard_peak"] = f"{centre // 4:02d}:{centre % 4 * 15:02d}"
        carried: dict[str, Any] = json.loads(json.dumps(state))
        return carried

    def act(self, t: int, power_mw: Mapping[str, float]) -> None:
        """Storage does as it is told, and the rest follows."""
        action = np.array([[-power_mw[unit.name]] for unit in self.case.ess])
        slot = self.world.slot(t, self.energy)
        assert isinstance(self.world.simulator, Simulator)
        step = self.world.simulator.step(self.energy, action, slot.stacked, slot.island)
        self.energy = step.energy
        self.cost += float(step.cost[0])
