r"""Resilience metrics of trajectories: who was not served, how much and for how long.

Pure functions on arrays with the members (scenarios, episodes) on the last axis. Powers are MW,
means over a slot of `dt_h` hours, so that

$$ \text{ENS} = \sum_{l,t} P^\text{shed}_{l,t} \, \Delta t, \qquad
   R(t) = 1 - \frac{\sum_l P^\text{shed}_{l,t}}{\sum_l P^\text{demand}_{l,t}} $$

Where nothing is demanded, everything is served: R = 1. What R(t) says of the way down and back is
in `trapezoid`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resilience.arrays import Bools, Floats
from resilience.errors import UsageError
from resilience.models.program.risk_measures import weights
from resilience.tolerances import SHED_TOLERANCE_MW


@dataclass(frozen=True, eq=False)
class Service:
    """What every member (scenario, episode) had to go without; all arrays are (members,).

    Attributes:
        ens_mwh: energy not served.
        weighted_ens_mwh: the same, each load's energy times its priority.
        shed_mw_slots: sum of the MW shed over the slots: the paper's "MW"; depends on the step.
        shed_h: hours in which anything is shed (its mean is the LOLE).
        shed_slot_share: share of the slots in which anything is shed.
        served_share: energy served / energy demanded.
        critical_served_share: the same of the critical loads.
        first_critical_shed_h: hours until a critical load is first shed; inf: never.
    """

    ens_mwh: Floats
    weighted_ens_mwh: Floats
    shed_mw_slots: Floats
    shed_h: Floats
    shed_slot_share: Floats
    served_share: Floats
    critical_served_share: Floats
    first_critical_shed_h: Floats


@dataclass(frozen=True)
class Adequacy:
    """Expectations over the members.

    Attributes:
        eens_mwh: expected energy not served.
        weighted_eens_mwh: the same, each load's energy times its priority.
        shed_mw_slots: expected sum of the MW shed over the slots.
        lole_h: loss of load expectation: expected hours with shedding.
        lolp_slots: loss of load probability, as the expected share of the slots with shedding.
        lolp_members: the same, as the probability that a member sheds at all.
        served_share: expected energy served / expected energy demanded.
        critical_served_share: the same of the critical loads.
        p_critical_served: probability that no critical load is ever shed.
    """

    eens_mwh: float
    weighted_eens_mwh: float
    shed_mw_slots: float
    lole_h: float
    lolp_slots: float
    lolp_members: float
    served_share: float
    critical_served_share: float
    p_critical_served: float


@dataclass(frozen=True, eq=False)
class InterruptionIndices:
    """Interruption indices by load (IEEE 1366), over the horizon; arrays are (members,).

    Attributes:
        asifi: MW interrupted / MW connected: interruptions of the average MW.
        asidi_h: MW-hours of interruption / MW connected: hours without supply of the average MW.
    """

    asifi: Floats
    asidi_h: Floats


def service(
    demand: Floats,
    shed: Floats,
    dt_h: float,
    *,
    critical: Bools | None = None,
    priority: Floats | None = None,
) -> Service:
    """What every member had to go without.

    Args:
        demand: (loads, slots, members) MW; the last axis may be 1 where all members demand alike.
        shed: (loads, slots, members) MW, of the demand.
        dt_h: hours per slot.
        critical: (loads,) True for critical loads; None: all are.
        priority: (loads,) weights of the energy not served; None: 1.

    Raises:
        UsageError: shapes that do not fit, shed outside 0 to demand (or NaN), a step that is not
            positive.
    """
    demand, shed = _checked(demand, shed, dt_h)
    loads, slots, _ = shed.shape
    mask = _per_load("critical", np.ones(loads) if critical is None else critical, loads) > 0
    weight = _per_load("priority", np.ones(loads) if priority is None else priority, loads)
    mw_slots = shed.sum(axis=1)
    hours = dt_h * _sheds(shed).sum(axis=0)
    return Service(
        ens_mwh=dt_h * mw_slots.sum(axis=0),
        weighted_ens_mwh=dt_h * (weight @ mw_slots),
        shed_mw_slots=mw_slots.sum(axis=0),
        shed_h=hours,
        shed_slot_share=hours / (slots * dt_h),
        served_share=_share(demand, shed, (0, 1)),
        critical_served_share=_share(demand[mask], shed[mask], (0, 1)),
        first_critical_shed_h=time_to_first_shed(shed[mask], dt_h),
    )


def adequacy(
    demand: Floats,
    shed: Floats,
    dt_h: float,
    *,
    critical: Bools | None = None,
    priority: Floats | None = None,
    probability: Floats | None = None,
) -> Adequacy:
    """Expectations over the members, of `probability` (members,); None: all equally likely.

    The other arguments and the errors are those of `service`; also raised for probabilities that
    are negative or do not add up to 1.
    """
    members = service(demand, shed, dt_h, critical=critical, priority=priority)
    p = weights(probability, len(members.ens_mwh))
    demand = np.broadcast_to(demand, np.shape(shed))
    mask = np.ones(len(shed), bool) if critical is None else np.asarray(critical, bool)
    return Adequacy(
        eens_mwh=float(p @ members.ens_mwh),
        weighted_eens_mwh=float(p @ members.weighted_ens_mwh),
        shed_mw_slots=float(p @ members.shed_mw_slots),
        lole_h=float(p @ members.shed_h),
        lolp_slots=float(p @ members.shed_slot_share),
        lolp_members=float(p @ (members.shed_h > 0)),
        served_share=float(_share(demand * p, shed * p, None)),
        critical_served_share=float(_share((demand * p)[mask], (shed * p)[mask], None)),
        p_critical_served=survival(members.first_critical_shed_h, np.inf, p),
    )


def time_to_first_shed(shed: Floats, dt_h: float, start: int = 0) -> Floats:
    """Hours from the begin of slot `start` to that of the first slot that sheds; inf: never.

    Give `shed` (loads, slots, members) MW of the critical loads only.
    """
    sheds = _sheds(shed[:, start:])
    return np.where(sheds.any(axis=0), dt_h * _first(sheds), np.inf)


def survival(first_shed_h: Floats, hours: float, probability: Floats | None = None) -> float:
    """Probability that nothing is shed for `hours` hours; inf: for the whole horizon.

    `first_shed_h` (members,) is the answer of `time_to_first_shed`.
    """
    return float(weights(probability, len(first_shed_h)) @ (first_shed_h >= hours))


def served_ratio(demand: Floats, shed: Floats) -> Floats:
    """(slots, members) operational performance R(t): MW served / MW demanded; 1 without demand."""
    demand, shed = _checked(demand, shed, 1.0)
    return _share(demand, shed, 0)


def interruption_indices(
    demand: Floats, shed: Floats, dt_h: float, connected_mw: Floats | None = None
) -> InterruptionIndices:
    """ASIFI and ASIDI over the horizon; arguments and errors as for `service`.

    A load shed in part is interrupted in part: with the share shed / demand of its connected MW.
    Each MW that goes from served to interrupted counts as one interruption; a load that demands
    nothing is not interrupted.

    Args:
        demand: (loads, slots, members) MW.
        shed: (loads, slots, members) MW.
        dt_h: hours per slot.
        connected_mw: (loads,) connected load; None: the peak of the load's demand.
    """
    demand, shed = _checked(demand, shed, dt_h)
    peak = demand.max(axis=(1, 2)) if connected_mw is None else connected_mw
    connected = _per_load("connected_mw", peak, len(shed))
    lost = np.where(shed > SHED_TOLERANCE_MW, shed, 0.0)
    out = 1.0 - _share(demand, lost, ())
    newly = np.maximum(np.diff(out, axis=1, prepend=0.0), 0.0)
    total = max(float(connected.sum()), np.finfo(float).tiny)
    return InterruptionIndices(
        asifi=connected @ newly.sum(axis=1) / total,
        asidi_h=dt_h * (connected @ out.sum(axis=1)) / total,
    )


def paper_resilience(
    shed: Floats, shed_cost_per_mwh: Floats, dt_h: float, priority: Floats | None = None
) -> Floats:
    """(members,) the paper's R (eq. 9), in $: minus the cost of what is shed.

    The paper gives R up to a factor and without a sum over time; here it is the sum over loads
    (priority × price × MWh shed), so that -R is the shed cost of the objective.
    """
    check_step(dt_h)
    loads = len(shed)
    price = _per_load("shed_cost_per_mwh", shed_cost_per_mwh, loads)
    weight = _per_load("priority", np.ones(loads) if priority is None else priority, loads)
    return np.asarray(-dt_h * ((weight * price) @ shed.sum(axis=1)), float)


def _checked(demand: Floats, shed: Floats, dt_h: float) -> tuple[Floats, Floats]:
    """Demand and shed of one shape (loads, slots, members)."""
    demand, shed = np.asarray(demand, float), np.asarray(shed, float)
    fits = demand.ndim == shed.ndim == 3 and demand.shape[:2] == shed.shape[:2]
    if not fits or demand.shape[2] not in (1, shed.shape[2]) or shed.shape[1] == 0:
        raise UsageError(
            f"demand has the shape {demand.shape}, shed {shed.shape}; "
            "allowed: (loads, slots, members) for both, at least one slot",
            hint="put the members last, also a single one: shed[..., None]",
        )
    check_step(dt_h)
    inside = (shed >= -SHED_TOLERANCE_MW) & (shed <= demand + SHED_TOLERANCE_MW)  # False for NaN
    if not inside.all():
        first = tuple(int(k) for k in np.argwhere(~inside)[0])
        raise UsageError(f"shed{list(first)} is {shed[first]:g} MW; allowed: 0 to the demand")
    return np.broadcast_to(demand, shed.shape), shed


def check_step(dt_h: float) -> None:
    """Raises UsageError for a step that is not positive."""
    if not dt_h > 0:
        raise UsageError(f"dt_h is {dt_h:g}; allowed: more than 0 hours")


def _per_load(name: str, per_load: ArrayLike, loads: int) -> np.ndarray:
    values = np.asarray(per_load)
    if values.shape != (loads,):
        raise UsageError(f"{name} has the shape {values.shape}; allowed: ({loads},), one per load")
    return values


def _sheds(shed: Floats) -> Bools:
    """(slots, members) True where any load is shed."""
    return np.asarray((shed > SHED_TOLERANCE_MW).any(axis=0), bool)


def _first(flags: Bools) -> NDArray[np.intp]:
    """First slot of (slots, members) that is True; 0 where none is."""
    if len(flags) == 0:
        return np.zeros(flags.shape[1], np.intp)
    return np.asarray(flags.argmax(axis=0), np.intp)


def _share(demand: Floats, shed: Floats, axis: int | tuple[int, ...] | None) -> Floats:
    """Served / demanded, summed over the axes; 1 where nothing is demanded."""
    total, lost = np.sum(demand, axis=axis), np.sum(shed, axis=axis)
    nothing = total <= 0
    return np.asarray(np.where(nothing, 1.0, 1.0 - lost / np.where(nothing, 1.0, total)), float)
