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
from resilience.models.network.graph import mismatch
from resilience.models.network.limits import (
    Capacity,
    FlowLimits,
    admittances,
    circulation,
    current_limits,
    lossless_limits,
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
    capacity, earth = _with_earth(network, capacity, buses.v_max_pu)
    factor, driven_pu = with_loops(network, looped, mismatch(network), buses.v_max_pu)
    round_pu = circulation(network, buses.v_max_pu) + driven_pu
    v_sent = buses.v_max_pu[network.from_bus] / network.tap
    if not losses:
        forth, back = lossless_limits(network, capacity)
        forth, back = factor[:, None] * forth, factor[:, None] * back
        for limit in (forth, back):
            limit[:, 0] += LOSSLESS_ROOM * v_sent * round_pu
        return FlowLimits(names, peak, forth, back)
    current = current_limits(network, capacity, buses.v_min_pu, earth)
    current *= factor[:, None]
    current[:, 0] += round_pu
    sent = v_sent[:, None] * current
    return FlowLimits(names, peak, sent, sent, current)


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
