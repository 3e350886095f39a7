"""A case's deterministic horizon as one problem, with its data."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Floats
from resilience.models.language.tree import Cut, Tree
from resilience.models.microgrid import Microgrid, Physics
from resilience.models.network.situation import Situation
from resilience.models.program.standard import Standard, Vectors
from resilience.models.program.unroll import unroll

if TYPE_CHECKING:
    from resilience.case import Case


@dataclass(frozen=True)
class CaseProgram:
    """The problem in numbers together with what it was made from."""

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
    def case(self) -> Case:
        """The case it was made from."""
        return self.microgrid.case


def status(case: Case) -> np.ndarray:
    """(lines, slots) False where one of the case's outages has a line down."""
    up = np.ones((len(case.network.line_names), case.slots), bool)
    for outage in case.outages:
        up[case.network.line(outage.line), outage.first : outage.stop] = False
    return up


def terminal_cuts(case: Case, value_per_mwh: float | None = None) -> list[Cut]:
    """The worth of energy in storage at the end, as a cut on the cost behind the horizon.

    Args:
        case: the case.
        value_per_mwh: $ per MWh; the case's terminal value if omitted.
    """
    value = case.terminal_value_per_mwh if value_per_mwh is None else value_per_mwh
    if not value or not case.ess:
        return []
    return [Cut(0.0, {"ess.energy": np.full(len(case.ess), -value)})]


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
    microgrid = Microgrid.of(case, physics)
    labels = [case.slot_label(t) for t in range(case.slots)]
    standard = unroll([microgrid.stage(case.step_h)], Tree.chain(labels), terminal_cuts(case))
    situation = microgrid.situation(status(case))
    return CaseProgram(microgrid, standard, situation, microgrid.data(situation), microgrid.start())


def as_switched(program: CaseProgram, z: Floats) -> Situation:
    """The situation with every switchable line as z has it: the islands that really form."""
    standard, situation = program.standard, program.situation
    if not standard.has("line.closed"):
        return situation
    up = situation.line_up.copy()
    at = [situation.names.index(name) for name in standard.labels("line.closed")]
    up[at] = z[standard.columns("line.closed")] > 0.5
    return replace(situation, line_up=up)
