"""Fuel of a plan: what is in every tank, and where the rest of it went."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resilience.arrays import Bools, Floats
from resilience.models.case_program import CaseProgram
from resilience.models.components import DeviceFleet
from resilience.planning.tables import DELIVERY, LEVEL
from resilience.tolerances import AT_LIMIT_TOLERANCE


@dataclass(frozen=True)
class FuelBalance:
    """Where the fuel of all tanks went, arrays (tanks,), m³; what came in is what went out.

    Attributes:
        start, delivered: what was there, and what was brought over the horizon.
        burnt, turned_away, end: by generators, for want of room, and what is in them at the end.
    """

    start: Floats
    delivered: Floats
    burnt: Floats
    turned_away: Floats
    end: Floats


def fuel_balance(program: CaseProgram, z: Floats) -> FuelBalance:
    """The fuel of a settled point of a program with tanks."""
    standard, case = program.standard, program.case
    start, end = program.x0[LEVEL], z[standard.columns(LEVEL)][:, -1]
    delivered, tanks = np.zeros(len(start)), program.microgrid.tanks
    if tanks is not None and standard.has(DELIVERY):
        delivered[tanks.delivered] = z[standard.columns(DELIVERY)].sum(axis=1)
    rows = standard.rows("tank.dynamics")
    turned_away = (program.vectors.row_upper - standard.a @ z)[rows].sum(axis=1)
    brought = delivered * case.step_h
    return FuelBalance(start, brought, start + brought - turned_away - end, turned_away, end)


def fuel_notes(program: CaseProgram, z: Floats) -> list[str]:
    """A sentence per tank; none without tanks."""
    if not program.standard.has(LEVEL):
        return []
    fuel, notes = fuel_balance(program, z), []
    for k, name in enumerate(program.standard.labels(LEVEL)):
        parts = [f"{fuel.start[k]:.3f} m³ at the start"]
        parts += [f"{fuel.delivered[k]:.3f} delivered"] if fuel.delivered[k] else []
        parts += [f"{fuel.burnt[k]:.3f} burnt"]
        away = fuel.turned_away[k]
        parts += [f"{away:.3f} turned away for want of room"] if away > AT_LIMIT_TOLERANCE else []
        notes.append(f"tank {name}: {', '.join(parts)}, {abs(fuel.end[k]):.3f} left")
    return notes


def without_fuel(program: CaseProgram, z: Floats, fleet: DeviceFleet) -> Bools:
    """(devices, slots) whether a device burns from a tank that is empty at the end of the slot."""
    empty = np.zeros((len(fleet.tables), program.situation.n), bool)
    tanks = program.microgrid.tanks
    if tanks is not None and fleet is tanks.generators:
        level = z[program.standard.columns(LEVEL)]
        burners = tanks.burners
        empty[burners] = (level <= AT_LIMIT_TOLERANCE)[tanks.tank_of[burners]]
    return empty
