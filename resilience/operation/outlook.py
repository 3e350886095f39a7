"""The plan behind a decision: the method's own, or what it goes on to do if all comes as told."""

from __future__ import annotations

import copy
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from resilience.arrays import Floats
from resilience.dispatch.window_plan import WindowPlan
from resilience.models.components import in_roles
from resilience.models.simulator import Simulator, Step
from resilience.operation.present import CarriedOver, Present, by_name
from resilience.simulation.observation import Dispatcher, Observation, parts_of
from resilience.simulation.setting import Setting
from resilience.simulation.slots import Slot
from resilience.simulation.world import stepper

ROLLED_OUT_H = 12.0


def copied(dispatcher: Dispatcher, setting: Setting) -> Dispatcher | None:
    """A dispatcher that remembers the same and may go its own way; None where that cannot be."""
    shared = (setting, setting.simulator, setting.microgrid, setting.case)
    memo: dict[int, Any] = {id(thing): thing for thing in shared}
    try:
        return copy.deepcopy(dispatcher, memo)
    except Exception:
        return None


def rolled_out(
    setting: Setting, dispatcher: Dispatcher, observation: Observation, slot: Slot, step: Step
) -> WindowPlan:
    """What a dispatcher does from a decision on, if load and weather come as forecast, what is out
    stays out, and nothing else fails.

    Args:
        setting: where it acts.
        dispatcher: a copy, which may be used up.
        observation: of the slot that was decided.
        slot: its data.
        step: what followed.
    """
    simulator = setting.simulator
    if not isinstance(simulator, Simulator):  # it keeps a basis, which decisions must not share
        simulator = stepper(setting.microgrid)
    present = Present(replace(setting, simulator=simulator))
    case, carried = setting.case, CarriedOver.after(observation, step)
    rows = [_row(present, slot, step)]
    stop = min(observation.t + max(round(ROLLED_OUT_H / case.step_h), 1), case.slots)
    for _ in range(observation.t + 1, stop):
        ahead, slot = present.ahead(observation, carried)
        step = present.step(ahead, parts_of(dispatcher.act(ahead)))
        rows.append(_row(present, slot, step))
        carried = CarriedOver.after(ahead, step)
    first = np.arange(observation.t, stop)
    n = len(case.ess)
    table = np.array(rows).T
    energy, storage, totals = table[:n], table[n : 2 * n], table[2 * n :]
    generator, weather, grid, shed = totals
    return WindowPlan(
        first=first,
        stop=first + 1,
        units=tuple(unit.name for unit in case.ess),
        energy_mwh=energy,
        lowest_mwh=energy.sum(0),
        highest_mwh=energy.sum(0),
        storage_mw=storage,
        generator_mw=generator,
        weather_mw=weather,
        grid_mw=grid,
        shed_mw=shed,
        probability=np.ones(1),
    )


def _row(present: Present, slot: Slot, step: Step) -> Floats:
    """(2 units + 4,) energy, storage power, and generators, weather, grid and shedding in all."""
    fleets, values = present.setting.microgrid.fleets.values(), partial(present.flow, slot, step)
    totals = [
        sum(float(fleet.power(values).sum()) for fleet in in_roles(fleets, role))
        for role in ("dispatchable", "weather", "exchange")
    ]
    shed = sum(float(values(fleet.shed).sum()) for fleet in in_roles(fleets, "load"))
    storage = (step.discharge - step.charge)[:, 0]
    return np.concatenate([step.energy[:, 0], storage, totals, [shed]])


def plan_summary(plan: WindowPlan, setting: Setting) -> list[dict[str, Any]]:
    """A plan as plain data, a record per step."""
    window, steps = setting.case.window, range(len(plan.first))
    return [
        {
            "begins": window.time(int(plan.first[k])).isoformat(),
            "ends": window.time(int(plan.stop[k])).isoformat(),
            "energy_mwh": by_name(plan.units, plan.energy_mwh[:, k]),
            "lowest_mwh": float(plan.lowest_mwh[k]),
            "highest_mwh": float(plan.highest_mwh[k]),
            "storage_mw": by_name(plan.units, plan.storage_mw[:, k]),
            "generator_mw": float(plan.generator_mw[k]),
            "weather_mw": float(plan.weather_mw[k]),
            "grid_mw": float(plan.grid_mw[k]),
            "shed_mw": float(plan.shed_mw[k]),
        }
        for k in steps
    ]
