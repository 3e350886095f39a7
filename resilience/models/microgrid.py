"""From a case to a stage: components, and the balance at every bus, whatever the components."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Bools, Floats, Ints
from resilience.errors import UsageError
from resilience.models.algebra import Affine, stack
from resilience.models.components import (
    ColdLoads,
    Component,
    DeviceFleet,
    Energised,
    Generators,
    Lines,
    Sited,
    Strengthened,
    Tanks,
    Topology,
    device_fleets,
    forming_now,
    in_roles,
)
from resilience.models.language.stage import Stage
from resilience.models.network.graph import (
    bridges,
    bundle,
    closable,
    cycle,
    joined,
    looped,
    merge,
    mismatch,
)
from resilience.models.network.situation import Islands, Situation
from resilience.models.wiring import flow_limits, voltages

if TYPE_CHECKING:
    from resilience.case import Case, Network
    from resilience.case.schema import DeviceTable

Physics = Literal["copperplate", "lindistflow", "distflow"]
PHYSICS: tuple[Physics, ...] = get_args(Physics)


@dataclass(frozen=True)
class Microgrid:
    """A case at one level of physics.

    Attributes:
        case: devices, horizon and outages.
        physics: the level.
        network: only lines that can be closed; merged where the physics allows it.
        bus_of: (buses of the case,) index in `network` of every bus of the case.
        lines_of: (lines,) index in the case's network of every line of `network`.
        fallible: (lines,) lines that data may take out.
        strengthened: lines that can be strengthened before the storm; usually none. Where there
            are some, or `sited`, closed lines may make loops.
        sited: units and ties that may be built before it; usually none.
    """

    case: Case
    physics: Physics
    network: Network
    bus_of: Ints
    lines_of: Ints
    fallible: Bools
    strengthened: Strengthened | None = None
    sited: Sited | None = None

    @classmethod
    def build(cls, case: Case, physics: Physics = "lindistflow") -> Microgrid:
        """The case at a level of physics.

        Raises:
            UsageError: unknown physics, or a cycle of closed lines where a feeder must be radial.
        """
        if physics not in PHYSICS:
            raise UsageError(
                f"physics {physics!r} is unknown; allowed: {', '.join(PHYSICS)}",
                hint="lindistflow is the default of linear methods, distflow of conic ones",
            )
        hit = {outage.line for outage in case.outages}
        network = closable(case.network)
        network = bundle(network, _fallible(network, hit))
        lines_of = np.array([case.network.line(name) for name in network.line_names], np.intp)
        fallible = _fallible(network, hit)
        bus_of = np.arange(len(network.bus_names))
        if physics == "copperplate":
            merged, bus_of = merge(network, fallible)
            remains = np.isin(network.line_names, merged.line_names)
            network, lines_of, fallible = merged, lines_of[remains], fallible[remains]
        elif network.radial and network.switchable.any() and (loop := cycle(network)):
            raise UsageError(
                f"physics {physics!r} keeps a feeder with switchable lines radial, but these "
                "lines, which cannot be switched, form a cycle: " + ", ".join(loop),
                hint="open one of them, mark one `switchable`, or let no line be; "
                "or set radial = false in [network], where loops may be; "
                "or use --physics copperplate",
            )
        return cls(case, physics, network, bus_of, lines_of, fallible)

    def bus_index(self, tables: Iterable[DeviceTable]) -> Ints:
        """(devices,) index in `network` of the bus of every device."""
        return self.bus_of[np.array([self.case.network.bus(t.bus) for t in tables], np.intp)]

    @cached_property
    def fleets(self) -> dict[str, DeviceFleet]:
        """The devices of the case by kind; kinds of which it has none are left out."""
        return device_fleets(self.case, self.bus_of)

    @cached_property
    def forming(self) -> Bools:
        """(buses,) whether a grid-forming unit stands there."""
        forming = np.zeros(len(self.network.bus_names), bool)
        for fleet in self.fleets.values():
            forming[fleet.bus[fleet.forming()]] = True
        return forming

    @cached_property
    def separate_grids(self) -> Bools:
        """(buses,) buses with a grid that may not share a tree with another; none with a single."""
        on_grid = np.zeros(len(self.network.bus_names), bool)
        for fleet in in_roles(self.fleets.values(), "exchange"):
            on_grid[fleet.bus[fleet.forming()]] = True
        return on_grid & (on_grid.sum() > 1) & (not self.network.parallel_grids)

    @cached_property
    def islands(self) -> Islands:
        """The islands that its lines make, remembered per pattern of line status."""
        return Islands(np.stack([self.network.from_bus, self.network.to_bus]), self.forming)

    @cached_property
    def energised(self) -> Energised | None:
        """What makes islands alive where that is decided; None where data alone tell."""
        cell, sure = self._cells
        names = tuple(self.network.bus_names[k] for k in np.unique(cell, return_index=True)[1])
        lines = next((wire for wire in self._wires if isinstance(wire, Lines)), None)
        energised = Energised(names, cell, sure, tuple(self.fleets.values()), lines)
        return energised if energised.is_decided else None

    @cached_property
    def _cells(self) -> tuple[Ints, Bools]:
        """(buses,) number of every bus's cell, and (cells,) whether it is alive for sure."""
        cell = joined(self.network, ~self.fallible & ~self.network.switchable)
        sure = np.zeros(len(np.unique(cell)), bool)
        for fleet in self.fleets.values():
            sure[cell[fleet.bus[fleet.forms_surely() & ~fleet.may_fail()]]] = True
        return cell, sure

    def forming_in(self, situation: Situation) -> Bools:
        """(buses, nodes) or (buses, 1) `forming`, of units that are in order alone."""
        if situation.unit_up is None or not self.forming_may_fail:
            return self.forming[:, None]
        return forming_now(self.fleets.values(), situation)

    @cached_property
    def units(self) -> tuple[str, ...]:
        """Units that may be out of order, behind the lines in status of elements."""
        return self.case.fallible_units

    @cached_property
    def forming_may_fail(self) -> bool:
        """Whether a unit that can form an island may be out of order."""
        fleets = self.fleets.values()
        return any(bool((fleet.forming() & fleet.may_fail()).any()) for fleet in fleets)

    @cached_property
    def components(self) -> tuple[Component, ...]:
        """Everything that emits into the stage, voltages and switches included."""
        first: tuple[Component, ...] = () if self.energised is None else (self.energised,)
        choices = [built for built in (self.strengthened, self.sited) if built is not None]
        first = (*choices, *first)
        tanks = () if self.tanks is None else (self.tanks,)
        return (*first, *self.fleets.values(), *self.cold_loads, *tanks, *self._wires)

    @cached_property
    def cold_loads(self) -> tuple[ColdLoads, ...]:
        """Loads that return with a surplus after an interruption, kind by kind; usually none."""
        loads = in_roles(self.fleets.values(), "load")
        return tuple(ColdLoads(fleet) for fleet in loads if len(fleet.cold))

    @cached_property
    def tanks(self) -> Tanks | None:
        """The tanks that generators burn from; None where there are none."""
        generators = self.fleets.get("generator")
        if not self.case.tank or not isinstance(generators, Generators):
            return None
        return Tanks(self.case.tank, generators)

    @cached_property
    def _looped(self) -> Bools:
        """(lines,) lines in a loop of closed lines."""
        return looped(self.network)

    @cached_property
    def _wires(self) -> list[Component]:
        network, fleets = self.network, self.fleets.values()
        if len(network.bus_names) == 1:
            return []
        buses = None
        if self.physics != "copperplate":
            cell, sure = self._cells
            buses = voltages(network, fleets, sure[cell], self._looped)
        shift = np.angle(network.ratio)
        lines = Lines(
            names=network.line_names,
            from_bus=network.from_bus,
            to_bus=network.to_bus,
            r=network.r_pu,
            x=network.x_pu,
            ratio=network.ratio,
            y_from=network.y_from_pu,
            y_to=network.y_to_pu,
            rating=network.rating_mva,
            angle_min=np.radians(network.angle_min_degree) - shift,
            angle_max=np.radians(network.angle_max_degree) - shift,
            limits=flow_limits(
                self.case,
                network,
                fleets,
                buses,
                self._looped,
                self.fallible | network.switchable,
                losses=self.physics == "distflow",
            ),
            determined=bridges(network) | (self._looped & (buses is not None)),
            fallible=self.fallible,
            switchable=network.switchable,
            closed=network.in_service,
            switching_cost=network.switching_cost,
            v_min=buses.v_min_pu if buses else None,
            v_max=buses.v_max_pu if buses else None,
            losses=self.physics == "distflow",
            loss_cost_per_mwh=self.case.loss_cost_per_mwh,
            may_be_dark=network.is_charged,
            strengthened=self._strengthened_lines,
            looped=self._looped if buses else None,
            loop_shift=np.angle(mismatch(network)) if buses else None,
        )
        switches = (
            [Topology(lines, network.bus_names, self.forming, self.separate_grids, network.radial)]
            if network.switchable.any() and self.strengthened is None and self.sited is None
            else []
        )
        return [*([buses] if buses else []), lines, *switches]

    @property
    def flow_limits_proven(self) -> bool:
        """Whether limits of flows are proven, or audited alone; see `FlowLimits`."""
        return all(x.limits.proven for x in self._wires if isinstance(x, Lines))

    def _emitting(self, energised: Energised | None, peak: Floats | None) -> Iterator[Component]:
        """The components of a stage in which it is decided what is alive, or known; see `stage`."""
        for component in self.components:
            if isinstance(component, Lines) and peak is not None:
                yield replace(component, limits=replace(component.limits, peak=peak))
            elif not isinstance(component, Energised) or energised is not None:
                yield component

    def _cover(self, stage: Stage, strengthened: Strengthened, peak: Floats) -> None:
        """The rows of dear loads, for profiles that reach (profiles,)."""
        fleets, (lines,) = (
            list(self.fleets.values()),
            (x for x in self._wires if isinstance(x, Lines)),
        )
        loads = in_roles(fleets, "load")
        reach = dict(zip(lines.limits.profiles, peak, strict=True))
        demand = [-mw * reach[name] for fleet in loads for name, mw in fleet.expected()]
        strengthened.cover(stage, lines, fleets, np.array(demand))

    def limit_profiles(self, profile: Callable[[str | None], Floats], nodes: int) -> Floats:
        """(profiles, nodes) values of the profiles that limits of lines follow, see `stage`."""
        lines = next((wire for wire in self._wires if isinstance(wire, Lines)), None)
        return np.ones((0, nodes)) if lines is None else lines.limits.values(profile, nodes)

    @property
    def _strengthened_lines(self) -> Bools | None:
        """(lines,) whether a line can be strengthened; None where none can."""
        if self.strengthened is None:
            return None
        return np.isin(self.network.line_names, self.strengthened.lines)

    def stage(
        self,
        dt: float,
        *,
        energy_known: bool = False,
        may_spill: bool = False,
        peak: Floats | None = None,
    ) -> Stage:
        """One step: all components, and `balance` of power at every bus.

        Args:
            dt: its length, h.
            energy_known: what is stored at the start is known before its data are made, see
                `situation`, so that data tell which islands are alive.
            may_spill: what must be taken may be spilled, as in simulations; a plan has to use it.
            peak: (profiles,) the most that profiles of lines' limits, see `FlowLimits`, reach in
                the nodes of the stage; their peaks if omitted. The less it is, the sharper is what
                relaxed integers tell.
        """
        stage = Stage(dt, reactive=self.physics != "copperplate")
        energised = None if energy_known else self.energised
        fed = []
        for component in self._emitting(energised, peak):
            power = component.emit(stage)
            if power is None:
                continue
            if self.sited is not None:
                self.sited.limit(stage, component, power)
            if isinstance(component, DeviceFleet):
                if energised is not None:
                    energised.limit(stage, component, power)
                if may_spill:
                    power = component.with_spill(stage, power)
            fed.append(power)
        if energised is not None:
            energised.connect(stage)
        if self.strengthened is not None and peak is not None:
            self._cover(stage, self.strengthened, peak)
        stage.eq("balance.p", self._at_buses([(i.p, i.bus) for i in fed]))
        if stage.reactive:
            reactive = [(i.q, i.bus) for i in fed if i.q is not None]
            stage.eq("balance.q", self._at_buses(reactive))
        return stage

    def _at_buses(self, injections: list[tuple[Affine, Ints]]) -> Affine:
        """(buses,) the sum of powers (devices,) at the buses where the devices stand."""
        bus = np.concatenate([bus for _, bus in injections])
        place = sp.csc_array(
            (np.ones(len(bus)), (bus, np.arange(len(bus)))),
            shape=(len(self.network.bus_names), len(bus)),
        )
        return stack([power for power, _ in injections]).mapped(place, self.network.bus_names)

    def situation(
        self,
        line_up: Bools,
        profile: Callable[[str | None], Floats] | None = None,
        *,
        before: Bools | None = None,
        is_last: Bools | None = None,
        energy: Floats | None = None,
    ) -> Situation:
        """The world at every node.

        Args:
            line_up: (elements of the case, nodes) False where a line has failed, or a unit is out;
                with rows for its lines alone, all units are in order.
            profile: per-unit values over the nodes; the case's own if omitted.
            before: `line_up` one slot before; outages begin in no slot if omitted.
            is_last: (nodes,) where the horizon ends; nowhere if omitted.
            energy: (units, nodes) MWh stored at the start, where it is known: a storage without
                energy to give forms nothing then.
        """
        network, lines = self.network, len(self.case.network.line_names)
        has_units = len(line_up) > lines
        situation = Situation(
            profile=profile or self.case.profile,
            names=network.line_names,
            ends=self.islands.ends,
            line_up=line_up[self.lines_of],
            forming=self.forming,
            n=line_up.shape[1],
            islands=self.islands,
            units=self.units if has_units else (),
            unit_up=line_up[lines:] if has_units else None,
            line_up_before=None if before is None else before[self.lines_of],
            is_last=is_last,
        )
        if energy is None and not (has_units and self.forming_may_fail):
            return situation
        forms = forming_now(self.fleets.values(), situation, energy)
        return replace(situation, forming_now=forms)

    def data(self, situation: Situation) -> dict[str, Floats]:
        """The data of every component, arrays (labels, nodes)."""
        return {k: v for c in self.components for k, v in c.data(situation).items()}

    def start(self) -> dict[str, Floats]:
        """The states of every component at the start."""
        return {k: v for c in self.components for k, v in c.start().items()}


def _fallible(network: Network, hit: set[str]) -> Bools:
    """(lines,) lines that are breakpoints or that an outage of the case hits."""
    return network.breakpoint | np.isin(network.line_names, list(hit))
