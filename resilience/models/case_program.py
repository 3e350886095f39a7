"""A case's deterministic horizon as one program, with its data."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Bools, Floats
from resilience.models.algebra import Labels
from resilience.models.language.tree import Cut, Tree
from resilience.models.microgrid import Microgrid, Physics
from resilience.models.network.situation import Situation
from resilience.models.program.cliques import Cliques
from resilience.models.program.gate import cost_scale
from resilience.models.program.standard import Standard, Vectors
from resilience.models.program.unroll import unroll
from resilience.tolerances import INTEGRALITY_TOLERANCE

if TYPE_CHECKING:
    from resilience.case import Case


@dataclass(frozen=True)
class CaseProgram:
    """A program in numbers together with what it was made from.

    Attributes:
        microgrid: the case's components at a level of physics.
        standard: the program.
        situation: status of lines, islands and profiles, slot by slot.
        data: by name, (labels, slots) what goes into bounds, sides and prices.
        x0: by name, (labels,) states at the start.
    """

    microgrid: Microgrid
    standard: Standard
    situation: Situation
    data: dict[str, Floats]
    x0: dict[str, Floats]

    @cached_property
    def vectors(self) -> Vectors:
        """Cost, bounds and right-hand sides for the case's own data."""
        return self.standard.vectors(self.data, self.x0)

    @property
    def cliques(self) -> Cliques | None:
        """Rows on products of voltages in loops, where a method asked for them."""
        return None

    @property
    def in_mw(self) -> CaseProgram:
        """The program in MW and $: itself, unless it was put into other units."""
        return self

    @property
    def column_unit(self) -> Floats | float:
        """(columns,) or 1: what one unit of each column is there."""
        return 1.0

    @property
    def cost_unit(self) -> float:
        """What one unit of its cost is there, $."""
        return 1.0

    @property
    def slot_variables(self) -> Labels:
        """`ess.charge[ess1]`, ...: every variable of a slot."""
        blocks = self.standard.form.own_blocks
        return tuple(f"{block.name}[{label}]" for block in blocks for label in block.labels)

    def slot_values(self, z: Floats) -> Floats:
        """(variables, slots) the values of all columns, as `slot_variables` names them."""
        return z[self.standard.copies[0].own_columns].T

    @property
    def case(self) -> Case:
        """The case it was made from."""
        return self.microgrid.case

    def values(self, name: str, z: Floats) -> Floats:
        """(labels, slots) a variable at the point z, or a datum."""
        return z[self.standard.columns(name)] if self.standard.has(name) else self.data[name]


def status(case: Case) -> Bools:
    """(elements of the case, slots) False where one of the case's outages has one down."""
    up = np.ones((len(case.elements), case.slots), bool)
    for outage in case.outages:
        up[case.element(outage.line), outage.first : outage.stop] = False
    return up


def line_up_before(line_up: Bools, tree: Tree) -> Bools:
    """(elements, nodes) status one slot before every node of a tree; all up at the start."""
    return np.where(tree.parent >= 0, line_up[:, tree.parent], True)


def terminal_cuts(microgrid: Microgrid, value_per_mwh: float | None = None) -> list[Cut]:
    """The worth of energy in storage at the end, as a cut on the cost behind the horizon.

    Args:
        microgrid: has the storage.
        value_per_mwh: $ per MWh; the case's terminal value if omitted.
    """
    if value_per_mwh is None:
        value_per_mwh = microgrid.case.terminal_value_per_mwh
    slopes = {
        fleet.stored: np.full(len(fleet.tables), -value_per_mwh)
        for fleet in microgrid.fleets.values()
        if fleet.stored is not None
    }
    return [Cut(0.0, slopes)] if value_per_mwh and slopes else []


def terminal_credit(case: Case, energy: Floats) -> Floats:
    """The worth of energy in storage at the end, $.

    Args:
        case: the case.
        energy: (units, slots, ...) MWh at the end of every slot.

    Returns:
        (...) one number per scenario.
    """
    return case.terminal_value_per_mwh * energy[:, -1].sum(axis=0)


def horizon(case: Case, physics: Physics = "lindistflow") -> CaseProgram:
    """The whole horizon of the case, its outages known in advance."""
    microgrid = Microgrid.build(case, physics)
    labels = [case.slot_label(t) for t in range(case.slots)]
    standard = unroll([microgrid.stage(case.step_h)], Tree.chain(labels), terminal_cuts(microgrid))
    up = status(case)
    is_last = np.arange(case.slots) == case.slots - 1
    situation = microgrid.situation(up, before=line_up_before(up, standard.tree), is_last=is_last)
    return CaseProgram(microgrid, standard, situation, microgrid.data(situation), microgrid.start())


def case_cost_scale(case: Case) -> float:
    """The most that one quantity of a case can cost in a slot, $: see `gate.cost_scale`.

    Costs do not depend on the physics, of which copperplate is the quickest to state.
    """
    return cost_scale(horizon(case, "copperplate").vectors)


def as_switched(program: CaseProgram, z: Floats) -> Situation:
    """The situation with every line and every forming unit as z has it: what is really alive."""
    standard, situation = program.standard, program.situation
    if program.microgrid.energised is not None:
        situation = replace(situation, forming_now=_forming_now(program, z))
    if not standard.has("line.closed"):
        return situation
    up = situation.line_up.copy()
    rows = [situation.names.index(name) for name in standard.labels("line.closed")]
    up[rows] = z[standard.columns("line.closed")] > 0.5
    return replace(situation, line_up=up)


def _forming_now(program: CaseProgram, z: Floats) -> Bools:
    """(buses, nodes) whether a unit forms there: it runs or has energy, and z leaves it no dark."""
    standard, nodes, situation = program.standard, program.standard.tree.n, program.situation
    forming = np.zeros((len(situation.forming), nodes), bool)
    for fleet in program.microgrid.fleets.values():
        forms = np.repeat(fleet.forming()[:, None], nodes, axis=1)
        if fleet.stored is not None:
            ends = np.column_stack([z[standard.columns(fleet.stored)], program.x0[fleet.stored]])
            forms &= fleet.has_energy(ends[:, standard.tree.parent])
        forms &= situation.works(fleet.names)
        if fleet.running is not None and standard.has(fleet.running):
            committed = [fleet.names.index(name) for name in standard.labels(fleet.running)]
            forms[committed] &= z[standard.columns(fleet.running)] > 0.5
        device, node = np.nonzero(forms)
        forming[fleet.bus[device], node] = True
    cells = program.microgrid.energised
    if cells is not None:
        lit = z[standard.columns("cell.energised")] > INTEGRALITY_TOLERANCE
        forming &= lit[cells.cell]
    return forming
