"""What happens in every scenario, in one form for optimised plans and for simulated dispatchers."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.case import Case
from resilience.models.case_program import CaseProgram, terminal_credit
from resilience.models.components import DeviceFleet, device_fleets, in_roles
from resilience.models.program.gate import check_audit, names_of
from resilience.models.program.referee import Audit, audit, settle
from resilience.models.program.standard import Standard
from resilience.models.structures import Angle, Cone, Disc, Mode
from resilience.planning.scenarios.program import ScenarioProgram
from resilience.planning.tables import SlotTable, tabulate
from resilience.planning.two_stage.extensive import own_columns
from resilience.planning.two_stage.lshaped import TwoStageSolution
from resilience.simulation.powers import powers
from resilience.simulation.trajectory import Trajectory
from resilience.simulation.world import World
from resilience.tolerances import RELAXATION_TOLERANCE


@dataclass
class ScenarioOutcomes:
    """Arrays with the scenario as their last axis.

    Attributes:
        operating_cost, terminal_credit: (n,) $.
        devices: names, in the order of `power`: generators, PV, storage, grid, loads.
        power: (devices, slots, n) MW fed in.
        energy: (units, slots, n) MWh at the end of every slot.
        shed: (loads, slots, n) MW.
        audit, where: worst scaled violations, and where the worst of each name is.
        relaxed: what is not satisfied, in words: by name, how much of it and in how many scenarios.
    """

    operating_cost: Floats
    terminal_credit: Floats
    devices: tuple[str, ...]
    power: Floats
    energy: Floats
    shed: Floats
    audit: dict[str, float] = field(default_factory=dict)
    where: dict[str, str] = field(default_factory=dict)
    relaxed: list[str] = field(default_factory=list)

    @property
    def cost(self) -> Floats:
        """(n,) $: operating cost less terminal credit."""
        return self.operating_cost - self.terminal_credit

    @property
    def audit_worst(self) -> str:
        """Where the worst violation is."""
        return self.where[max(self.audit, key=lambda k: self.audit[k])] if self.audit else ""

    def selected(self, index: Ints) -> ScenarioOutcomes:
        """The outcomes of some of the scenarios, or of each several times."""
        arrays = {
            name: getattr(self, name)[..., index]
            for name in ("operating_cost", "terminal_credit", "power", "energy", "shed")
        }
        return replace(self, **arrays)


def device_names(case: Case) -> tuple[str, ...]:
    """Devices in the order of `ScenarioOutcomes.power`."""
    return tuple(name for fleet in ordered(device_fleets(case).values()) for name in fleet.names)


def ordered(fleets: Iterable[DeviceFleet]) -> list[DeviceFleet]:
    """Fleets in the order of `ScenarioOutcomes.power`."""
    return in_roles(fleets, "dispatchable", "weather", "storage", "exchange", "load")


def planned_outcomes(
    program: ScenarioProgram, solution: TwoStageSolution
) -> tuple[ScenarioOutcomes, dict[str, SlotTable]]:
    """What happens in every scenario of a two-stage plan, audited, and the tables of its trunk.

    Raises:
        CertificateError: a scenario breaks what is not said to be relaxed.
    """
    full, trunk = program.full(), program.trunk
    outcomes = _blank(program.microgrid.case, program.distinct.n)
    shortfalls: dict[str, Shortfall] = {}
    for k in range(program.distinct.n):
        storm = program.program_of(k, full)
        z = settle(full, scenario_point(program, solution, k, full), storm.vectors)
        _record(outcomes, k, storm, z)
        _count(shortfalls, full, z)
        checked = audit(full, z, storm.vectors)
        for name, violation in checked.worst.items():
            if violation >= outcomes.audit.get(name, -1.0):
                outcomes.audit[name] = violation
                place = f"{checked.where[name]} in scenario {program.distinct.number[k]}"
                outcomes.where[name] = place
    outcomes.relaxed = [
        f"{name}: {shortfall}" for name, shortfall in shortfalls.items() if shortfall.scenarios
    ]
    check_audit(Audit(outcomes.audit, outcomes.where), names_of(outcomes.relaxed))
    z_trunk = settle(trunk.standard, solution.trunk.copy(), trunk.vectors)
    return outcomes, tabulate(trunk, z_trunk)


@dataclass
class Shortfall:
    """How far something relaxed is from holding, over some scenarios.

    Attributes:
        complaint: what is wrong, in words.
        count, total: elements that do not hold, and all there are.
        worst: largest scaled violation.
        scenarios: number of those in which any does not hold.
        all_scenarios: number of all.
    """

    complaint: str
    count: int = 0
    total: int = 0
    worst: float = 0.0
    scenarios: int = 0
    all_scenarios: int = 0

    def add(self, violation: Floats) -> None:
        """Takes in the elements (n,) of one more scenario."""
        broken = int((violation > RELAXATION_TOLERANCE).sum())
        self.count += broken
        self.total += len(violation)
        self.worst = max(self.worst, float(violation.max(initial=0.0)))
        self.scenarios += broken > 0
        self.all_scenarios += 1

    def __str__(self) -> str:
        return (
            f"{self.count} of {self.total} {self.complaint}, by {self.worst:.2g} at most, "
            f"in {self.scenarios} of {self.all_scenarios} scenarios"
        )


def _count(shortfalls: dict[str, Shortfall], standard: Standard, z: Floats) -> None:
    """Takes in what a scenario's point leaves relaxed, by name."""
    for kind in (Mode, Cone, Angle, Disc):
        for unrolled in standard.structures_of(kind).values():
            complaint = unrolled.structure.complaint
            shortfalls.setdefault(unrolled.name, Shortfall(complaint)).add(unrolled.violation(z))
    integers = z[standard.integer]
    shortfall = shortfalls.setdefault("integrality", Shortfall("integers fractional"))
    shortfall.add(np.abs(integers - np.round(integers)))


def _blank(case: Case, n: int) -> ScenarioOutcomes:
    """Room for n scenarios."""
    names, shape = device_names(case), (case.slots, n)
    fleets = device_fleets(case).values()
    units, loads = (sum(len(f.tables) for f in in_roles(fleets, r)) for r in ("storage", "load"))
    return ScenarioOutcomes(
        operating_cost=np.empty(n),
        terminal_credit=np.empty(n),
        devices=names,
        power=np.empty((len(names), *shape)),
        energy=np.empty((units, *shape)),
        shed=np.zeros((loads, *shape)),
    )


def scenario_point(
    program: ScenarioProgram, solution: TwoStageSolution, scenario: int, full: Standard
) -> Floats:
    """A scenario's trunk and branch as one point of the whole horizon, a program `full`.

    The trunk's slots come from the common first stage as far as the scenario follows it; those
    after it from the scenario's own branch, whose program counts its slots from `offset` on.
    """
    two, trunk = program.two_stage, program.two_stage.trunk
    trunk_columns, full_columns = own_columns(two.first), own_columns(full)
    z, chain = np.zeros(full.n_columns), int(program.chain[scenario])
    leaves = min(int(program.leaves[scenario]), trunk)
    z[: full.n_states] = solution.trunk[: full.n_states]
    for t in range(leaves):
        z[full_columns[t]] = solution.trunk[trunk_columns[t]]
    if chain < 0:
        z[full.future[0]] = solution.trunk[two.first.future[0]]
        return z
    standard, point = two.programs[two.branches[chain].program], solution.points[chain]
    branch_columns = own_columns(standard)[two.branches[chain].offset :]
    for t, columns in enumerate(branch_columns, leaves):
        z[full_columns[t]] = point[columns]
    z[full.future[0]] = point[standard.future[0]]
    return z


def _record(outcomes: ScenarioOutcomes, k: int, program: CaseProgram, z: Floats) -> None:
    """Writes what the point z of a scenario's program means into column k of the outcomes."""
    case, fleets = program.case, ordered(program.microgrid.fleets.values())

    def values(name: str) -> Floats:
        return program.values(name, z)

    nothing = np.empty((0, case.slots))
    outcomes.power[:, :, k] = np.concatenate([nothing, *(f.power(values) for f in fleets)])
    outcomes.energy[:, :, k] = np.concatenate(
        [nothing, *(values(f.stored) for f in fleets if f.stored is not None)]
    )
    outcomes.shed[:, :, k] = np.concatenate(
        [nothing, *(values(f.shed) for f in in_roles(fleets, "load"))]
    )
    terms = program.standard.cost_terms(z, program.data)
    outcomes.operating_cost[k] = sum(float(spent.sum()) for spent in terms.values())
    outcomes.terminal_credit[k] = terminal_credit(case, outcomes.energy[:, :, k])


def simulated_outcomes(world: World, trajectory: Trajectory) -> ScenarioOutcomes:
    """What happened in every scenario of a simulation."""
    case, power = world.microgrid.case, powers(world, trajectory)
    fleets = ordered(world.microgrid.fleets.values())
    energy = trajectory.energy[:, 1:]
    return ScenarioOutcomes(
        operating_cost=trajectory.cost.sum(0),
        terminal_credit=terminal_credit(case, energy),
        devices=device_names(case),
        power=np.concatenate([power[fleet.kind] for fleet in fleets]),
        energy=energy,
        shed=trajectory.shed,
    )
