"""What happens in every scenario, in one form for optimised plans and for simulated dispatchers."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.case import Case
from resilience.models.case_program import CaseProgram, terminal_credit
from resilience.models.program.referee import audit, settle
from resilience.models.program.standard import Standard
from resilience.planning.scenario_program import ScenarioProgram
from resilience.planning.tables import SlotTable, tabulate
from resilience.planning.two_stage.extensive import own_columns
from resilience.planning.two_stage.lshaped import TwoStageSolution
from resilience.simulation.trajectory import Trajectory
from resilience.simulation.world import World


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
    """

    operating_cost: Floats
    terminal_credit: Floats
    devices: tuple[str, ...]
    power: Floats
    energy: Floats
    shed: Floats
    audit: dict[str, float] = field(default_factory=dict)
    where: dict[str, str] = field(default_factory=dict)

    @property
    def cost(self) -> Floats:
        """(n,) $: operating cost less terminal credit."""
        return self.operating_cost - self.terminal_credit

    @property
    def audit_worst(self) -> str:
        """Where the worst violation is."""
        return self.where[max(self.audit, key=lambda k: self.audit[k])] if self.audit else ""

    def at(self, index: Ints) -> ScenarioOutcomes:
        """The outcomes of some of the scenarios, or of each several times."""
        arrays = {
            name: getattr(self, name)[..., index]
            for name in ("operating_cost", "terminal_credit", "power", "energy", "shed")
        }
        return replace(self, **arrays)


def device_names(case: Case) -> tuple[str, ...]:
    """Devices in the order of `ScenarioOutcomes.power`."""
    fleets = (case.generator, case.pv, case.ess, case.grid, case.load)
    return tuple(device.name for fleet in fleets for device in fleet)


def of_plan(
    program: ScenarioProgram, solved: TwoStageSolution
) -> tuple[ScenarioOutcomes, dict[str, SlotTable]]:
    """What happens in every storm of a two-stage plan, audited, and the tables of its trunk."""
    case, full, n = program.microgrid.case, program.full(), program.distinct.n
    shape = (case.slots, n)
    found = ScenarioOutcomes(
        np.empty(n),
        np.empty(n),
        device_names(case),
        np.empty((len(device_names(case)), *shape)),
        np.empty((len(case.ess), *shape)),
        np.zeros((len(case.load), *shape)),
    )
    for k in range(n):
        storm = program.program_of(k, full)
        z = settle(full, whole_point(program, solved, k, full), storm.vectors)
        _take(found, k, storm, z)
        checked = audit(full, z, storm.vectors)
        for name, violation in checked.worst.items():
            if violation >= found.audit.get(name, -1.0):
                found.audit[name] = violation
                found.where[name] = (
                    f"{checked.where[name]} in scenario {program.distinct.number[k]}"
                )
    trunk = program.trunk
    tables = tabulate(trunk, settle(trunk.standard, solved.trunk.copy(), trunk.vectors))
    return found, tables


def whole_point(
    program: ScenarioProgram, solved: TwoStageSolution, storm: int, full: Standard
) -> Floats:
    """A storm's trunk and chain as one point of the whole horizon."""
    two, trunk = program.two_stage, program.two_stage.trunk
    first, own = own_columns(two.first), own_columns(full)
    z, chain = np.zeros(full.n_columns), int(program.chain[storm])
    leaves = min(int(program.leaves[storm]), trunk)
    z[: full.n_states] = solved.trunk[: full.n_states]
    for t in range(leaves):
        z[own[t]] = solved.trunk[first[t]]
    if chain < 0:
        z[full.future[0]] = solved.trunk[two.first.future[0]]
        return z
    standard, point = two.programs[two.chains[chain].program], solved.points[chain]
    inside = own_columns(standard)[two.chains[chain].offset :]
    for t, columns in enumerate(inside, leaves):
        z[own[t]] = point[columns]
    z[full.future[0]] = point[standard.future[0]]
    return z


def _take(found: ScenarioOutcomes, k: int, program: CaseProgram, z: Floats) -> None:
    standard, case = program.standard, program.case

    def values(name: str, there: object) -> Floats:
        return z[standard.columns(name)] if there else np.empty((0, case.slots))

    shed = values("load.shed", case.load)
    demand = program.data["load.demand"] if case.load else shed
    found.power[:, :, k] = np.concatenate(
        [
            values("generator.p", case.generator),
            values("pv.p", case.pv),
            values("ess.discharge", case.ess) - values("ess.charge", case.ess),
            values("grid.import", case.grid) - values("grid.export", case.grid),
            shed - demand,
        ]
    )
    found.energy[:, :, k] = values("ess.energy", case.ess)
    found.shed[:, :, k] = shed
    terms = standard.cost_terms(z, program.data)
    found.operating_cost[k] = sum(float(spent.sum()) for spent in terms.values())
    found.terminal_credit[k] = terminal_credit(case, found.energy[:, :, k])


def of_run(world: World, run: Trajectory) -> ScenarioOutcomes:
    """What happened in every scenario of a simulation."""
    case = world.microgrid.case

    def flow(kind: str) -> Floats:
        return run.flow(kind)

    every = np.arange(case.slots)
    shed = flow("load.shed")
    demand = np.array([t.p_max_mw * world.profile(t.profile, every) for t in case.load])
    power = [flow("generator.p"), flow("pv.p"), run.storage]
    power += [flow("grid.import") - flow("grid.export")]
    power += [shed - demand.reshape(shed.shape)]
    energy = run.energy[:, 1:]
    credit = terminal_credit(case, energy)
    return ScenarioOutcomes(
        run.cost.sum(0), credit, device_names(case), np.concatenate(power), energy, shed
    )
