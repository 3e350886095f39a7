"""What wires are held to: voltages of buses, and what lines may be asked to carry."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Bools, Floats
from resilience.case.profiles import MAX_PU
from resilience.errors import UsageError
from resilience.models.components import Buses, DeviceFleet, bus_capacity
from resilience.models.components.loops import TURN_MAX
from resilience.models.network.circuit import circuit_currents, shares
from resilience.models.network.graph import mismatch
from resilience.models.network.limits import (
    MARGIN,
    SHORT_PU,
    Capacity,
    FlowLimits,
    admittances,
    circulation,
    current_limits,
    lossless_limits,
    short_circuit,
    with_loops,
)
from resilience.tolerances import INPUT_TOLERANCE

if TYPE_CHECKING:
    from resilience.case import Case, Network

LOSSLESS_ROOM = 2.0
"""Without losses a loop is not closed exactly: so often what goes round it."""


def voltages(
    network: Network, fleets: Collection[DeviceFleet], sure: Bools, looped: Bools
) -> Buses:
    """The buses of a network, their voltages where devices hold them.

    Args:
        network: buses and lines.
        fleets: devices, at the buses of the network.
        sure: (buses,) whether a bus is alive for sure.
        looped: (lines,) lines in a loop of closed lines.

    Raises:
        UsageError: two devices hold different voltages at one bus.
    """
    low, high = network.v_min_pu.copy(), network.v_max_pu.copy()
    holder: dict[int, tuple[str, float]] = {}
    for fleet in fleets:
        voltage = fleet.voltage_pu()
        for k in np.flatnonzero(np.isfinite(voltage)):
            bus, device, v_pu = int(fleet.bus[k]), fleet.names[k], float(voltage[k])
            first_device, first_pu = holder.setdefault(bus, (device, v_pu))
            if abs(first_pu - v_pu) > INPUT_TOLERANCE:
                raise UsageError(
                    f"{first_device} and {device} hold {first_pu:g} and {v_pu:g} pu at bus "
                    f"{network.bus_names[bus]}; allowed: one voltage at one bus",
                    hint="give both the same voltage, or a bus each",
                )
            low[bus] = high[bus] = v_pu
    on_loop = np.zeros(len(low), bool)
    on_loop[network.from_bus[looped]] = on_loop[network.to_bus[looped]] = True
    return Buses(
        names=network.bus_names,
        v_min_pu=low,
        v_max_pu=high,
        shunt=network.y_bus_pu,
        sure=sure,
        is_charged=network.is_charged,
        looped=on_loop,
    )


def flow_limits(
    case: Case,
    network: Network,
    fleets: Collection[DeviceFleet],
    buses: Buses | None,
    looped: Bools,
    may_be_out: Bools,
    *,
    losses: bool,
) -> FlowLimits:
    """What lines can be asked to carry.

    Args:
        case: its profiles say how much devices do at most.
        network: buses and lines.
        fleets: devices, at the buses of the network.
        buses: their voltages, if there are any.
        looped: (lines,) lines in a loop of closed lines.
        may_be_out: (lines,) lines that can be out.
        losses: whether currents are limited, too.
    """
    names, capacity = bus_capacity(fleets, len(network.bus_names))
    # A profile that is none of the case's comes from elsewhere, with what a case may state.
    peak = np.array(
        [
            case.profile(name).max() if name is None or name in case.profiles else MAX_PU
            for name in names
        ]
    )
    if buses is None:
        return FlowLimits(names, peak, *lossless_limits(network, capacity))
    v_sent = (buses.v_max_pu[network.from_bus] / network.tap)[:, None]
    capacity, earth = _with_earth(network, capacity, buses.v_max_pu)
    limits = None
    if looped.any():
        limits = _of_circuit(network, capacity, earth, buses, may_be_out, losses=losses)
    proven = limits is not None or not looped.any()
    if losses:
        if limits is None:
            limits = _current_of_sides(network, capacity, earth, buses, looped)
        return FlowLimits(names, peak, v_sent * limits, v_sent * limits, limits, proven)
    if limits is None:
        forth, back = _power_of_sides(network, capacity, buses, looped)
        return FlowLimits(names, peak, forth, back, proven=proven)
    return FlowLimits(names, peak, limits, limits.copy(), proven=_is_plain(network))


def _current_of_sides(
    network: Network, capacity: Capacity, earth: Floats, buses: Buses, looped: Bools
) -> Floats:
    """(lines, profiles) pu, by what devices on either side draw; in loops with room, see there."""
    factor, driven_pu = with_loops(network, looped, mismatch(network), buses.v_max_pu)
    current = current_limits(network, capacity, buses.v_min_pu, earth)
    share, resonant = _shares(network, looped)
    current *= (factor * share)[:, None]
    current[:, 0] += circulation(network, buses.v_max_pu) + driven_pu
    current[resonant] = 0.0
    current[resonant, 0] = MARGIN * short_circuit(network, buses.v_max_pu)[resonant]
    return current


def _power_of_sides(
    network: Network, capacity: Capacity, buses: Buses, looped: Bools
) -> tuple[Floats, Floats]:
    """The same without losses: MVA forth and back."""
    factor, driven_pu = with_loops(network, looped, mismatch(network), buses.v_max_pu)
    v_sent = buses.v_max_pu[network.from_bus] / network.tap
    share, resonant = _shares(network, looped)
    z = np.maximum(np.hypot(network.r_pu, network.x_pu), SHORT_PU)
    forth, back = ((factor * share)[:, None] * x for x in lossless_limits(network, capacity))
    for limit in (forth, back):
        limit[:, 0] += LOSSLESS_ROOM * v_sent * (circulation(network, buses.v_max_pu) + driven_pu)
        limit[resonant] = 0.0
        limit[resonant, 0] = (TURN_MAX / z)[resonant]
    return forth, back


def _shares(network: Network, looped: Bools) -> tuple[Floats, Bools]:
    """(lines,) what lines take of what they and their parallels carry, and where nothing tells it.

    That is so for loops in which resistances or reactances have both signs.
    """
    share, negative = shares(network), np.minimum(network.r_pu, network.x_pu) < 0.0
    resonant = np.isinf(share) | (looped & negative[looped].any())
    return np.where(resonant, 1.0, share), resonant


def _is_plain(network: Network) -> bool:
    """Whether there are no ratios, which part voltages from angles."""
    return bool((network.ratio == 1.0).all())


def _of_circuit(
    network: Network,
    capacity: Capacity,
    earth: Floats,
    buses: Buses,
    may_be_out: Bools,
    *,
    losses: bool,
) -> Floats | None:
    """(lines, profiles) the most that lines of a mesh carry, proven: pu with losses, else MVA.

    Without losses power takes the place of current, which is the same circuit as long as there are
    no ratios. None where it is not known, see `circuit_currents`.
    """
    drawn = capacity.apparent.copy()
    if losses:
        drawn /= buses.v_min_pu[:, None]
    drawn[:, :1] += earth * (1.0 if losses else buses.v_max_pu[:, None])
    limits = circuit_currents(network, may_be_out, drawn, buses.v_max_pu)
    if limits is None:
        return None
    if not losses:
        return MARGIN * (1.0 if _is_plain(network) else LOSSLESS_ROOM) * limits
    by_voltage = np.zeros_like(limits)
    by_voltage[:, 0] = short_circuit(network, buses.v_max_pu)
    return MARGIN * np.where((limits.sum(1) <= by_voltage[:, 0])[:, None], limits, by_voltage)


def _with_earth(network: Network, capacity: Capacity, v_max_pu: Floats) -> tuple[Capacity, Floats]:
    """What devices can do and admittances to earth, and (buses, 1) the current of the latter.

    Their power is constant, the first of the profiles.
    """
    feeds, takes = (y * v_max_pu**2 for y in admittances(network))
    supply, demand = capacity.supply.copy(), capacity.demand.copy()
    supply[:, 0] += feeds
    demand[:, 0] += takes
    earth = (feeds + takes) * math.sqrt(2.0) / v_max_pu  # |y| is sqrt(2) max(|g|, |b|) at most
    return Capacity(supply, demand, capacity.apparent), earth[:, None]
