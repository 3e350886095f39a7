"""What is drawn of one storm, as arrays: the feeder, the same for all, and what each method did.

Zones are the parts of the feeder that no line which may fail cuts: buses of a zone always share an
island. Power is MW, time is in slots of the span that is drawn.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.case import Case, Network
from resilience.case.schema import LoadTable
from resilience.fragility.outages.bell import REFERENCE_MIN
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.components import DeviceFleet, device_fleets, in_roles
from resilience.models.network.graph import closable, merge
from resilience.models.network.situation import Situation
from resilience.plots import style
from resilience.simulation.trajectory import Trajectory

MAX_GROUPS = 6  # of loads that are shed; what else is shed is one more
MAX_LETTERS = 12  # of the name of a zone, unless the first of its buses has more
OTHERS = "others"


@dataclass(frozen=True)
class FeederView:
    """The feeder in one storm, the same for every method.

    Attributes:
        zones: name of every zone, the buses that belong to it.
        zone_of: (buses of the case,) zone of every bus.
        on_grid: (zones,) whether a grid connection stands there.
        island: (zones, slots) number of the zone's island from 1; 0 where it has no source.
        lines: lines that are out at some time of the span.
        down: (lines, slots) when.
        centre_h: where the hazard peaks, h from the start of the span.
    """

    zones: tuple[str, ...]
    zone_of: Ints
    on_grid: np.ndarray
    island: Ints
    lines: tuple[str, ...]
    down: np.ndarray
    centre_h: tuple[float, ...]


@dataclass(frozen=True)
class MethodView:
    """What one method did in the span. Sources less what is taken and spilled is demand less shed.

    Attributes:
        fed: by title of the fleet: grid, generators, PV and storage, (slots,) MW each.
        intake: of storage and of the grid, (slots,) MW each.
        spilled: (slots,) MW that had to be taken and could not be used.
        curtailed: (slots,) MW of PV that could have been fed in; zero where only its forecast is
            known.
        demand: (slots,) MW asked for.
        shed: (loads, slots) MW not served.
        soc: (units, slots + 1) share of the capacity.
        cost: $ of the span.
    """

    fed: dict[str, Floats]
    intake: dict[str, Floats]
    spilled: Floats
    curtailed: Floats
    demand: Floats
    shed: Floats
    soc: Floats
    cost: float


def feeder(case: Case, scenarios: Scenarios, episode: int, span: slice) -> FeederView:
    """The feeder in the slots `span` of an episode, counted from 0."""
    network = closable(case.network)
    fallible = network.breakpoint | np.isin(network.line_names, scenarios.lines)
    # A rating splits no island, so it may not split a zone.
    unrated = replace(network, rating_mva=np.full(len(network.line_names), np.inf))
    merged, zone_of = merge(unrated, fallible)
    lines_of = [case.network.line(name) for name in merged.line_names]
    up = scenarios.line_up(case.network.line_names)[lines_of, span, episode]

    fleets = device_fleets(case, zone_of).values()

    def has_forming(fleets: Iterable[DeviceFleet]) -> Bools:
        """(zones,) whether a grid-forming device of some fleets stands there."""
        zones = np.zeros(len(merged.bus_names), bool)
        for fleet in fleets:
            zones[fleet.bus[fleet.forming()]] = True
        return zones

    ends = np.stack([merged.from_bus, merged.to_bus])
    forming = has_forming(fleets)
    situation = Situation(case.profile, merged.line_names, ends, up, forming, up.shape[1])
    down = scenarios.down[:, span, episode]
    hit = np.flatnonzero(down.any(axis=1))
    return FeederView(
        zones=zone_names(case.network, zone_of),
        zone_of=zone_of,
        on_grid=has_forming(in_roles(fleets, "exchange")),
        island=(situation.island + 1) * (situation.alive > 0),
        lines=tuple(scenarios.lines[k] for k in hit),
        down=down[hit],
        centre_h=_centres(case, scenarios, episode, span),
    )


def _centres(case: Case, scenarios: Scenarios, episode: int, span: slice) -> tuple[float, ...]:
    if scenarios.centre is None:
        return ()
    first, stop = span.start * case.step_h, span.stop * case.step_h
    midnight = -(case.start.hour + case.start.minute / 60.0)
    centre_h = scenarios.centre[:, episode] * REFERENCE_MIN / 60.0
    peak_h = midnight + 24.0 * np.arange(len(centre_h)) + centre_h
    return tuple(float(h - first) for h in peak_h[(peak_h >= first) & (peak_h < stop)])


def zone_names(network: Network, zone_of: Ints) -> tuple[str, ...]:
    """Names of zones: `2–18, 33` where buses are numbered; the first few buses where many."""
    zones: list[list[str]] = [[] for _ in range(int(zone_of.max()) + 1)]
    for name, zone in zip(network.bus_names, zone_of, strict=True):
        zones[zone].append(name)
    return tuple(_zone_name(names) for names in zones)


def _zone_name(names: list[str]) -> str:
    if all(name.isdecimal() for name in names):
        runs: list[list[int]] = []
        for number in sorted(map(int, names)):
            if runs and number == runs[-1][1] + 1:
                runs[-1][1] = number
            else:
                runs.append([number, number])
        names = [f"{a}" if a == b else f"{a}–{b}" for a, b in runs]
    shown = names[:1]
    while len(shown) < len(names) and len(", ".join([*shown, names[len(shown)]])) <= MAX_LETTERS:
        shown.append(names[len(shown)])
    return ", ".join(shown) + (", ..." if len(shown) < len(names) else "")


def method_view(
    case: Case,
    trajectory: Trajectory,
    feeder_: FeederView,
    episode: int,
    span: slice,
    exact: bool = True,
) -> MethodView:
    """What a method did in the slots `span` of an episode, counted from 0.

    `exact`: the profiles of the case are what came true.
    """
    slots, fleets = span.stop - span.start, device_fleets(case).values()
    storage, shed = trajectory.storage[:, span, episode], trajectory.shed[:, span, episode]

    def flows(fleet: DeviceFleet) -> list[Floats]:
        """(devices, slots) MW fed in by each of its flows: import and export stay apart."""
        if fleet.role == "storage":
            return [storage]
        return [
            sign * trajectory.flow(name)[:, span, episode] for name, sign in fleet.flows.items()
        ]

    def total(fleet: DeviceFleet, sign: float) -> Floats:
        return np.sum([np.maximum(sign * flow, 0.0).sum(0) for flow in flows(fleet)], axis=0)

    takers = in_roles(fleets, "storage", "exchange", "dispatchable", "weather")
    fed = {fleet.title: total(fleet, 1.0) for fleet in style.fleet_order(fleets)}
    intake = {fleet.title: total(fleet, -1.0) for fleet in takers if fleet.intake}
    unused = np.zeros(slots)
    for fleet in in_roles(fleets, "weather"):
        offered = _offered(case, feeder_, fleet, span)
        unused += np.maximum(offered - sum(flows(fleet)), 0.0).sum(0)
    spilled = np.zeros(slots) if trajectory.spill is None else trajectory.spill[span, episode]
    net: Floats = sum(fed.values(), np.zeros(slots)) - sum(intake.values(), np.zeros(slots))
    size = np.array([t.e_mwh for t in case.ess])
    energy = trajectory.energy[:, span.start : span.stop + 1, episode]
    return MethodView(
        fed=fed,
        intake=intake,
        spilled=spilled,
        curtailed=unused if exact else np.zeros(slots),
        demand=net - spilled + shed.sum(0),
        shed=shed,
        soc=energy / size[:, None],
        cost=float(trajectory.cost[span, episode].sum()),
    )


def _offered(case: Case, feeder_: FeederView, fleet: DeviceFleet, span: slice) -> Floats:
    """(plants, slots) MW that the weather offers; nothing in a dead island."""
    zones = feeder_.zone_of[fleet.bus]
    rows = [fed_mw * case.profile(profile)[span] for profile, fed_mw in fleet.expected()]
    return np.array(rows) * (feeder_.island[zones] > 0)


def load_groups(case: Case, feeder_: FeederView, sheds: list[Floats]) -> list[tuple[str, Ints]]:
    """Loads in a few groups, by name: each by itself where few are shed, else by zone.

    Args:
        case: has the loads.
        feeder_: has the zones.
        sheds: (loads, slots) MW of every method drawn; the groups most shed come first.
    """
    loads = case.tables_of(LoadTable)
    total = sum((shed.sum(1) for shed in sheds), np.zeros(len(loads)))
    hit = np.flatnonzero(total > 1e-6)
    if len(hit) <= MAX_GROUPS:
        groups = [(loads[k].name, np.array([k])) for k in hit]
    else:
        zone = np.array([feeder_.zone_of[case.network.bus(t.bus)] for t in loads])
        groups = [(feeder_.zones[z], hit[zone[hit] == z]) for z in np.unique(zone[hit])]
        groups = [(f"{_loads(len(rows))}, {_buses(name)}", rows) for name, rows in groups]
    groups.sort(key=lambda group: -float(total[group[1]].sum()))
    more = groups[MAX_GROUPS:]
    if more:
        groups = [*groups[:MAX_GROUPS], (OTHERS, np.concatenate([rows for _, rows in more]))]
    return groups


def _loads(n: int) -> str:
    return "1 load" if n == 1 else f"{n} loads"


def _buses(zone: str) -> str:
    return f"bus {zone}" if zone.isdecimal() else f"buses {zone}"
