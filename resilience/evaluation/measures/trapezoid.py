r"""How performance falls and comes back: the resilience trapezoid and triangle.

One function for operational performance (`metrics.served_ratio`: load served) and infrastructure
performance (`lines_up_ratio`: lines up), both R(t), (slots, members), 1 when all is well:

$$ \Phi = \frac{R_{pd} - R_0}{t_{ee} - t_{oe}}, \quad \Lambda = R_0 - R_{pd}, \quad
   E = t_{or} - t_{ee}, \quad \Pi = \frac{R_0 - R_{pd}}{T_{or} - t_{or}}, \quad
   \text{Area} = \int R \, dt $$

with R falling from R_0 to R_pd between t_oe and t_ee, and rising again between t_or and T_or.
Without a drop Φ = Λ = E = 0 and Π is undefined (NaN); never restored: Π = 0, `restored` False.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.errors import UsageError
from resilience.evaluation.measures.metrics import check_step
from resilience.tolerances import PERFORMANCE_TOLERANCE


@dataclass(frozen=True, eq=False)
class Trapezoid:
    """Resilience trapezoid of every member; all arrays are (members,). See `trapezoid`.

    Attributes:
        phi_per_h: Φ, how fast performance drops (≤ 0).
        lambda_share: Λ, how low it drops (≥ 0).
        e_h: E, how long it stays at its lowest before restoration begins.
        pi_per_h: Π, how promptly it recovers (≥ 0); NaN without a drop, 0 where never restored.
        area_h: integral of performance over the whole horizon.
        onset_h: start of the first slot of the drop; NaN without one.
        dropped: False where performance never leaves its normal level.
        restored: False where the horizon ends before performance is back to normal.
    """

    phi_per_h: Floats
    lambda_share: Floats
    e_h: Floats
    pi_per_h: Floats
    area_h: Floats
    onset_h: Floats
    dropped: Bools
    restored: Bools


@dataclass(frozen=True, eq=False)
class Triangle:
    """Resilience triangle of Bruneau; arrays are (members,).

    Attributes:
        loss_h: integral of 1 - R over the horizon.
        resilience_share: 1 - loss / horizon: 1 where nothing is lost.
    """

    loss_h: Floats
    resilience_share: Floats


def lines_up_ratio(up: Bools) -> Floats:
    """(slots, members) infrastructure performance: share of the lines that are up.

    `up` (lines, slots, members) lists the lines that are in service without a storm.
    """
    if len(up) == 0:
        return np.ones(up.shape[1:])
    return np.asarray(np.mean(up, axis=0), float)


def trapezoid(performance: Floats, dt_h: float, normal: float = 1.0) -> Trapezoid:
    """Resilience trapezoid (Panteli et al. 2017) of `performance` (slots, members).

    The deepest drop of a member is measured, the first of equals: from the last normal slot before
    it to the first normal slot after it. Performance is constant in a slot, so a change between two
    slots is taken to last one slot: n steps down take n slots. Φ and Π are therefore no finer than
    the step; Λ, E and the area do not depend on it.

    Args:
        performance: (slots, members) R(t), as `served_ratio` or `lines_up_ratio` give it.
        dt_h: hours per slot.
        normal: level before the event, R_0.

    Raises:
        UsageError: an array without slots or with NaN, a step that is not positive.
    """
    performance = _levels(performance, dt_h)
    slot = np.arange(len(performance))[:, None]
    is_normal = performance >= normal - PERFORMANCE_TOLERANCE
    low = performance.min(axis=0)
    dropped, drop = ~is_normal.all(axis=0), normal - low
    at_low = performance <= low + PERFORMANCE_TOLERANCE
    bottom = _first(at_low)
    first = np.where(is_normal & (slot < bottom), slot + 1, 0).max(axis=0)
    after = is_normal & (slot > bottom)
    restored = after.any(axis=0)
    back = np.where(restored, _first(after), len(performance))
    last = np.where(at_low & (slot < back), slot, -1).max(axis=0)
    fall_h, rise_h = dt_h * (bottom - first + 1), dt_h * np.maximum(back - last, 1)
    return Trapezoid(
        phi_per_h=np.where(dropped, -drop / fall_h, 0.0),
        lambda_share=np.where(dropped, drop, 0.0),
        e_h=np.where(dropped, dt_h * (last + 1 - bottom), 0.0),
        pi_per_h=np.where(dropped, np.where(restored, drop / rise_h, 0.0), np.nan),
        area_h=dt_h * performance.sum(axis=0),
        onset_h=np.where(dropped, dt_h * first, np.nan),
        dropped=np.asarray(dropped),
        restored=np.asarray(restored | ~dropped),
    )


def triangle(performance: Floats, dt_h: float) -> Triangle:
    """Resilience triangle (Bruneau et al. 2003) of `performance` (slots, members), normal = 1.

    Raises:
        UsageError: an array without slots or with NaN, a step that is not positive.
    """
    lost = 1.0 - _levels(performance, dt_h)
    return Triangle(loss_h=dt_h * lost.sum(axis=0), resilience_share=1.0 - lost.mean(axis=0))


def _levels(performance: Floats, dt_h: float) -> Floats:
    check_step(dt_h)
    performance = np.asarray(performance, float)
    if performance.ndim != 2 or len(performance) == 0:
        raise UsageError(
            f"performance has the shape {performance.shape}; allowed: (slots, members)",
            hint="put the members last, also a single one: performance[:, None]",
        )
    if not np.isfinite(performance).all():
        raise UsageError(
            "performance is not a number in some slots; allowed: finite levels",
            hint="leave failed members out",
        )
    return performance


def _first(flags: Bools) -> Ints:
    """First slot of (slots, members) that is True; 0 where none is."""
    return np.asarray(flags.argmax(axis=0), np.intp)
