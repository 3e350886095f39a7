"""What somebody knows who saw some lines."""

from __future__ import annotations

import numpy as np

from resilience.arrays import Bools
from resilience.fragility.beliefs.history import LineHistory


def history(
    down: Bools, t: int | None = None, *, centre: int = -1, start: int = 0, day: int = 0
) -> LineHistory:
    """What was seen by slot t of the clock.

    Args:
        down: (lines, slots) where lines are down; what is after slot t is not looked at.
        t: slot of the clock; the last one if omitted.
        centre: told peak, slot of 15 minutes; -1: none.
        start: slot of `down` at which the clock started.
        day: its number.
    """
    now = down.shape[1] - 1 if t is None else start + t
    seen = down[:, : now + 1]
    up = np.column_stack([np.ones(len(seen), bool), ~seen])
    age = np.argmax(up[:, ::-1], axis=1) - 1
    carried = seen[:, start - 1] & seen[:, start] if start else np.zeros(len(seen), bool)
    return LineHistory(now - start, centre, age, seen[:, start:], carried, day)
