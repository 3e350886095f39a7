"""Deliveries of fuel: the slot in which each can be used, and the profile that they become."""

from __future__ import annotations

from collections.abc import Iterable
from math import ceil

import numpy as np

from resilience.arrays import Floats
from resilience.case.schema import DeliveryTable, TankTable
from resilience.case.window import Window
from resilience.tolerances import SLOT_TOLERANCE


def delivery_slot(delivery: DeliveryTable, window: Window) -> int:
    """The first slot that starts when a delivery is there, or later; it may lie outside."""
    if delivery.time is None:
        minutes = 60.0 * (delivery.hour or 0.0)
    else:
        minutes = (delivery.time - window.start).total_seconds() / 60.0
    return ceil(minutes / window.step_min - SLOT_TOLERANCE)


def delivery_profiles(tanks: Iterable[TankTable], window: Window) -> dict[str, Floats]:
    """The profiles, (slots,) m³ per h, of all tanks with deliveries, under their names.

    What a delivery brings comes at a constant rate over its slot; deliveries outside the horizon
    are left out.
    """
    profiles = {}
    for tank in tanks:
        if tank.delivery_profile is not None:
            amount_m3 = np.zeros(window.slots)
            for delivery in tank.delivery:
                slot = delivery_slot(delivery, window)
                if 0 <= slot < window.slots:
                    amount_m3[slot] += delivery.amount_m3
            rate = amount_m3 * (60.0 / window.step_min)
            rate.setflags(write=False)
            profiles[tank.delivery_profile] = rate
    return profiles
