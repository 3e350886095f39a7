"""Is a plan one that the wires can carry? AC power flow of all its slots, islands included.

The plan's powers are taken as they are. In every island the largest unit that forms then is the
root: it holds the voltage, and gives what the plan did not fund, losses above all.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.case import Case
from resilience.errors import UsageError
from resilience.models.ac_check import (
    FormingUnits,
    at_buses,
    carriers,
    connected,
    forming_then,
    forming_units,
    held_voltages,
)
from resilience.models.case_program import status
from resilience.models.components import DeviceFleet, device_fleets
from resilience.models.network.powerflow import Flow, flow
from resilience.planning.plan import Plan
from resilience.tolerances import AC_LIMIT_TOLERANCE


@dataclass(frozen=True)
class WorstSlot:
    """Where and when a limit is exceeded most.

    Attributes:
        name: of the bus, line or unit.
        time: of the slot.
        value: there and then, pu, MVA, degrees or MW.
        limit: in the same unit.
        excess: beyond the limit; negative: what remains up to it.
    """

    name: str
    time: str
    value: float
    limit: float
    excess: float


@dataclass(frozen=True)
class PlanACCheck:
    """What AC power flow says of a plan. Slots that did not converge count in nothing else.

    Attributes:
        slots: number of slots checked.
        not_converged: times of the slots without a solution.
        undervoltage, overvoltage: bus and time nearest to its limit or farthest beyond it, pu.
        overload: the same for lines with a rating, MVA; None where no line has one.
        angle: the same for the angle between the ends of lines that limit it, degrees; None where
            none does.
        root: the same for the active power of the units that carry an island, MW.
        loss_mwh: AC losses.
        plan_loss_mwh: losses that the plan reckoned with.
        unfunded_mwh: the difference, which the roots had to give.
        flow: voltages and flows of all slots.
    """

    slots: int
    not_converged: tuple[str, ...]
    undervoltage: WorstSlot | None
    overvoltage: WorstSlot | None
    overload: WorstSlot | None
    angle: WorstSlot | None
    root: WorstSlot | None
    loss_mwh: float
    plan_loss_mwh: float
    unfunded_mwh: float
    flow: Flow = field(repr=False, compare=False)

    @property
    def ok(self) -> bool:
        """Every slot has a solution and no limit is exceeded."""
        limits = (self.undervoltage, self.overvoltage, self.overload, self.angle, self.root)
        within = all(worst is None or worst.excess <= AC_LIMIT_TOLERANCE for worst in limits)
        return within and not self.not_converged

    def summary(self) -> dict[str, Any]:
        """Everything but the flow, as plain data."""
        names = ("undervoltage", "overvoltage", "overload", "angle", "root")
        worst = {name: getattr(self, name) for name in names}
        return {
            "ok": self.ok,
            "slots": self.slots,
            "not_converged": list(self.not_converged),
            **{name: slot and asdict(slot) for name, slot in worst.items()},
            "loss_mwh": self.loss_mwh,
            "plan_loss_mwh": self.plan_loss_mwh,
            "unfunded_mwh": self.unfunded_mwh,
        }


def ac_check_plan(plan: Plan) -> PlanACCheck:
    """Checks all slots of a plan at once, with its own powers, line status and islands.

    Where the plan has no reactive power, its sources give none but the roots, which give all. A
    root holds the plan's voltage, or the grid's `v_pu`, or 1 pu.

    Raises:
        UsageError: a plan without its case.
    """
    if plan.case is None:
        raise UsageError("a plan without its case has no network", hint="solve the case again")
    case = plan.case
    fleets = list(device_fleets(case).values())
    situation, units = connected(case, _closed(plan, case)), forming_units(fleets)
    chosen = carriers(case, units, situation, _forming_then(plan, case, fleets, units))
    root = at_buses(case, units.bus, chosen) > 0
    p, q = _injections(plan, case, fleets)
    volts = _held_voltages(plan, case, fleets)
    solution = flow(case.network, p, q, situation.line_up, root, volts)
    solved = solution.converged
    loss = float(solution.loss_mw[solved].sum()) * case.step_h
    planned = float(p[:, solved].sum()) * case.step_h
    return PlanACCheck(
        slots=case.slots,
        not_converged=tuple(case.slot_label(int(t)) for t in np.flatnonzero(~solved)),
        **_limits(case, solution),
        root=_worst_root(plan, case, solution, units, chosen),
        loss_mwh=loss,
        plan_loss_mwh=planned,
        unfunded_mwh=loss - planned,
        flow=solution,
    )


def _closed(plan: Plan, case: Case) -> Bools:
    """(lines, slots) lines that carry power: not failed, and closed in the plan."""
    network = case.network
    up: Bools = status(case)[: len(network.line_names)] & network.in_service[:, None]
    if "line_closed" in plan.tables:
        # Merged buses and bundles of lines have no row: these lines cannot be anything but closed.
        table = plan.tables["line_closed"]
        up[[network.line(name) for name in table.labels]] = table.values > 0.5
    return up


def _forming_then(plan: Plan, case: Case, fleets: list[DeviceFleet], units: FormingUnits) -> Bools:
    """(forming units, slots) whether a unit forms its island in the plan, which may be dark."""
    energy = np.empty((0, case.slots))
    stores = [fleet for fleet in fleets if fleet.stored is not None]
    if stores:
        start = np.concatenate([fleet.start()[str(fleet.stored)] for fleet in stores])
        energy = np.column_stack([start, plan.tables["energy"].values[:, :-1]])
    on = plan.tables.get("on")
    running = {} if on is None else dict(zip(on.labels, on.values, strict=True))
    works = status(case)[len(case.network.line_names) :]
    for name, up in zip(case.fallible_units, works, strict=True):
        running[name] = running.get(name, 1.0) * up
    lit = plan.tables["island"].values[units.bus] > 0
    return lit & forming_then(fleets, units, energy, running)


def _injections(plan: Plan, case: Case, fleets: list[DeviceFleet]) -> tuple[Floats, Floats]:
    """(buses, slots) active and reactive power that the plan feeds in."""
    power, q = plan.tables["power"], np.zeros((len(case.network.bus_names), case.slots))
    bus_of = {
        name: bus for fleet in fleets for name, bus in zip(fleet.names, fleet.bus, strict=True)
    }
    p = at_buses(case, np.array([bus_of[name] for name in power.labels], np.intp), power.values)
    for fleet in fleets:
        fed = np.array([power[name] for name in fleet.names])
        q += at_buses(case, fleet.bus, fleet.reactive_per_mw()[:, None] * fed)
    if "reactive" in plan.tables:
        table = plan.tables["reactive"]
        bus = np.array([bus_of[name] for name in table.labels], np.intp)
        q += at_buses(case, bus, table.values)
    return p, q


def _held_voltages(plan: Plan, case: Case, fleets: list[DeviceFleet]) -> Floats:
    """(buses, slots) voltage to hold where a bus is a root, pu."""
    volts = np.tile(held_voltages(case, fleets)[:, None], case.slots)
    if "voltage" in plan.tables:
        table = plan.tables["voltage"]
        bus: Ints = np.array([case.network.bus(name) for name in table.labels], np.intp)
        volts[bus] = table.values
    return volts


def _limits(case: Case, solution: Flow) -> dict[str, WorstSlot | None]:
    network, v = case.network, solution.v_pu
    low, high = network.v_min_pu[:, None], network.v_max_pu[:, None]
    rated = np.flatnonzero(np.isfinite(network.rating_mva))
    loading, rating = solution.s_line_mva[rated], network.rating_mva[rated, None]
    names = [network.line_names[k] for k in rated]
    angle = solution.line_angle_degree
    angle_min, angle_max = network.angle_min_degree[:, None], network.angle_max_degree[:, None]
    nearer = np.where(angle_min - angle > angle - angle_max, angle_min, angle_max)
    return {
        "undervoltage": _worst(case, network.bus_names, v, low, low - v),
        "overvoltage": _worst(case, network.bus_names, v, high, v - high),
        "overload": _worst(case, names, loading, rating, loading - rating),
        "angle": _worst(case, network.line_names, angle, nearer, solution.angle_excess_degree),
    }


def _worst_root(
    plan: Plan, case: Case, solution: Flow, units: FormingUnits, chosen: Bools
) -> WorstSlot | None:
    """The unit that has to give or take most beyond its range to carry its island."""
    if not units.names:
        return None
    planned = np.array([plan.tables["power"][name] for name in units.names])
    fed = np.where(chosen, planned + solution.p_root_mw[units.bus], np.nan)
    p_min, p_max = units.p_min_mw[:, None], units.p_max_mw[:, None]
    limit = np.where(fed - p_max > p_min - fed, p_max, p_min)
    return _worst(case, units.names, fed, limit, np.maximum(fed - p_max, p_min - fed))


def _worst(
    case: Case, names: list[str] | tuple[str, ...], value: Floats, limit: Floats, excess: Floats
) -> WorstSlot | None:
    """The entry of greatest excess, arrays (names, slots); None where there is no number."""
    if not np.isfinite(excess).any():
        return None
    k, t = np.unravel_index(np.nanargmax(excess), excess.shape)
    bound = np.broadcast_to(limit, excess.shape)[k, t]
    return WorstSlot(
        names[int(k)],
        case.slot_label(int(t)),
        float(value[k, t]),
        float(bound),
        float(excess[k, t]),
    )
