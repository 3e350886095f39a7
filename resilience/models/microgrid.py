"""From a case to a stage: components, and the balance at every bus, whatever the components."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
import scipy.sparse as sp

from resilience.arrays import Bools, Floats, Ints
from resilience.errors import UsageError
from resilience.models import components as parts
from resilience.models.algebra import Affine, stack
from resilience.models.components import Component, Injection
from resilience.models.language.stage import Stage
from resilience.models.network.graph import bundle, closable, cycle, exchange, merge
from resilience.models.network.islands import Islands
from resilience.models.network.situation import Situation

if TYPE_CHECKING:
    from resilience.case import Case, Network
    from resilience.case.schema import ESSTable, GeneratorTable, GridTable

Physics = Literal["copperplate", "lindistflow", "distflow"]
PHYSICS: tuple[Physics, ...] = get_args(Physics)
MARGIN = 1.25  # of what two sides of a line can exchange, so that losses never bind


@dataclass(frozen=True)
class Microgrid:
    """A case at one level of physics.

    Attributes:
        network: only lines that can be closed; merged where the physics allows it.
        bus_of: index in `network` of every bus of the case, (buses of the case,).
        lines_of: index in the case's network of every line of `network`.
    """

    case: Case
    physics: Physics
    network: Network
    bus_of: Ints
    lines_of: Ints
    fallible: Bools

    @classmethod
    def of(cls, case: Case, physics: Physics = "lindistflow") -> Microgrid:
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
            whole = network
            network, bus_of = merge(whole, fallible)
            kept = np.isin(whole.line_names, network.line_names)
            lines_of, fallible = lines_of[kept], fallible[kept]
        elif loop := cycle(network):
            raise UsageError(
                f"physics {physics!r} needs a radial feeder, but these closed lines form a cycle: "
                + ", ".join(loop),
                hint="open one of them, mark one `switchable`, or use --physics copperplate",
            )
        return cls(case, physics, network, bus_of, lines_of, fallible)

    def at(self, tables: Iterable[object]) -> Ints:
        """Bus index of every device."""
        names = [self.case.network.bus(t.bus) for t in tables]  # type: ignore[attr-defined]
        return self.bus_of[np.asarray(names, np.intp)]

    @cached_property
    def forming(self) -> Bools:
        """(buses,) whether a grid-forming unit stands there."""
        case, found = self.case, np.zeros(len(self.network.bus_names), bool)
        units: list[ESSTable | GeneratorTable | GridTable] = [
            *case.ess,
            *case.generator,
            *case.grid,
        ]
        found[self.at([t for t in units if t.grid_forming])] = True
        return found

    @cached_property
    def islands(self) -> Islands:
        """The islands that its lines make, remembered per pattern of line status."""
        return Islands(np.stack([self.network.from_bus, self.network.to_bus]), self.forming)

    @cached_property
    def components(self) -> tuple[Component, ...]:
        """Everything that emits into the stage, voltages and switches included."""
        case = self.case
        fleets: list[Component] = []
        if case.load:
            fleets.append(parts.Loads(case.load, self.at(case.load)))
        if case.pv:
            fleets.append(parts.PV(case.pv, self.at(case.pv)))
        if case.ess:
            fleets.append(parts.ESS(case.ess, self.at(case.ess)))
        if case.generator:
            fleets.append(parts.Generators(case.generator, self.at(case.generator)))
        if case.grid:
            fleets.append(parts.Grids(case.grid, self.at(case.grid)))
        if len(self.network.bus_names) > 1:
            fleets += self._wires()
        return tuple(fleets)

    def _wires(self) -> list[Component]:
        network, wired = self.network, self.physics != "copperplate"
        lines = parts.Lines(
            names=network.line_names,
            from_bus=network.from_bus,
            to_bus=network.to_bus,
            r=network.r_pu,
            x=network.x_pu,
            rating=network.rating_mva,
            flow_max=MARGIN * exchange(network, *self._capacity()),
            fallible=self.fallible,
            switchable=network.switchable,
            closed=network.in_service,
            switching_cost=network.switching_cost,
            v_band=(float(network.v_min_pu.min()), float(network.v_max_pu.max())),
            losses=self.physics == "distflow",
        )
        found: list[Component] = [lines]
        if wired:
            found.insert(0, self._buses())
        if network.switchable.any():
            found.append(parts.Topology(lines, network.bus_names, self.forming))
        return found

    def _buses(self) -> parts.Buses:
        low, high = self.network.v_min_pu.copy(), self.network.v_max_pu.copy()
        for bus, table in zip(self.at(self.case.grid), self.case.grid, strict=True):
            low[bus] = high[bus] = table.v_pu
        return parts.Buses(self.network.bus_names, low, high)

    def _capacity(self) -> tuple[Floats, Floats]:
        """(buses,) most that devices can feed in and take, MVA, reactive power included."""
        case, n = self.case, len(self.network.bus_names)
        supply, demand = np.zeros(n), np.zeros(n)
        for load, bus in zip(case.load, self.at(case.load), strict=True):
            demand[bus] += load.p_max_mw / load.power_factor
        for pv, bus in zip(case.pv, self.at(case.pv), strict=True):
            supply[bus] += max(pv.p_max_mw, pv.s_mva or 0.0)
            demand[bus] += pv.s_mva or 0.0
        for ess, bus in zip(case.ess, self.at(case.ess), strict=True):
            supply[bus] += max(-ess.p_min_mw, ess.s_mva or 0.0)
            demand[bus] += max(ess.p_max_mw, ess.s_mva or 0.0)
        for unit, bus in zip(case.generator, self.at(case.generator), strict=True):
            supply[bus] += unit.p_max_mw + max(unit.q_max_mvar, 0.0)
            demand[bus] += max(-unit.q_min_mvar, 0.0)
        for grid, bus in zip(case.grid, self.at(case.grid), strict=True):
            q = grid.import_max_mw if grid.q_max_mvar is None else grid.q_max_mvar
            supply[bus] += grid.import_max_mw + q
            demand[bus] += grid.export_max_mw + q
        return supply, demand

    def stage(self, dt: float) -> Stage:
        """One step of `dt` hours: all components, and `balance` of power at every bus."""
        stage = Stage(dt, reactive=self.physics != "copperplate")
        fed = [found for c in self.components if (found := c.emit(stage)) is not None]
        balances = {"balance.p": [i.p for i in fed]}
        if stage.reactive:
            balances["balance.q"] = [i.q for i in fed if i.q is not None]
        for name, powers in balances.items():
            stage.eq(name, self._at_buses(powers, fed))
        return stage

    def _at_buses(self, powers: list[Affine], fed: list[Injection]) -> Affine:
        bus = np.concatenate([i.bus for i in fed])
        place = sp.csc_array(
            (np.ones(len(bus)), (bus, np.arange(len(bus)))),
            shape=(len(self.network.bus_names), len(bus)),
        )
        return stack(powers).mapped(place, self.network.bus_names)

    def situation(
        self, line_up: Bools, profile: Callable[[str | None], Floats] | None = None
    ) -> Situation:
        """The world at every node.

        Args:
            line_up: (lines of the case's network, nodes) False where a line has failed.
            profile: per-unit values over the nodes; the case's own if omitted.
        """
        network = self.network
        return Situation(
            profile=profile or self.case.profile,
            names=network.line_names,
            ends=self.islands.ends,
            line_up=line_up[self.lines_of],
            forming=self.forming,
            n=line_up.shape[1],
            islands=self.islands,
        )

    def data(self, situation: Situation) -> dict[str, Floats]:
        """The data of every component, arrays (labels, nodes)."""
        return {k: v for c in self.components for k, v in c.data(situation).items()}

    def start(self) -> dict[str, Floats]:
        """The states of every component at the start."""
        return {k: v for c in self.components for k, v in c.start().items()}


def _fallible(network: Network, hit: set[str]) -> Bools:
    """(lines,) lines that are breakpoints or that an outage of the case hits."""
    return network.breakpoint | np.isin(network.line_names, list(hit))
