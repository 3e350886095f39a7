"""Water values: what one more MWh in storage saves, as the cuts see it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Floats
from resilience.dispatch.sddp.book import Book
from resilience.errors import UsageError

if TYPE_CHECKING:
    from resilience.case import Case

SOC = tuple(k / 20 for k in range(2, 19))


@dataclass(frozen=True)
class WaterValues:
    """What a MWh is worth on a day with a storm.

    Attributes:
        units: names of the storage units; units that behave as one are one.
        buses: where they stand.
        step_h: length of a slot, h.
        soc: (levels,) states of charge, all units being at the same.
        per_mwh: (units, slots, levels) $ per MWh held at the end of a slot.
        about: the case, the centre, and which lines are down, in words.
    """

    units: tuple[str, ...]
    buses: tuple[str, ...]
    step_h: float
    soc: Floats
    per_mwh: Floats
    about: str


def water_values(
    case: Case | str,
    centre: int = -1,
    *,
    down: Sequence[str] = (),
    soc: Sequence[float] = SOC,
    end_value_per_mwh: float | None = None,
    book: Book | None = None,
) -> WaterValues:
    """The slopes of the cuts of one day, on the mean of the days that load and PV are learnt from.

    Args:
        case: a case, its file, or the name of an installed one.
        centre: slot of 15 minutes at which the storm is forecast to peak; -1: unknown.
        down: breakpoints that are down. Where they can hardly be, the mode most alike stands in.
        soc: states of charge; a unit that cannot reach one stands at its limit.
        end_value_per_mwh: worth of energy left at the end; the case's terminal value if omitted.
        book: cut sets; those of the case if omitted.

    Raises:
        UsageError: a line that is no breakpoint, or as `Book`.
    """
    if isinstance(case, str):
        from resilience.case import load_case

        case = load_case(case)
    book = book or Book(case)
    wrong = [name for name in down if name not in book.lines]
    if wrong:
        raise UsageError(
            f"{wrong[0]!r} is no breakpoint of case {case.name!r}; "
            f"allowed: {', '.join(book.lines) or 'none'}",
            hint="only lines marked `breakpoint = true` fail",
        )
    end = case.terminal_value_per_mwh if end_value_per_mwh is None else end_value_per_mwh
    cut_set = book.cut_set(centre, book.ends(end)[0])
    status = np.isin(book.lines, down)
    levels = book.climate.levels.mean(axis=0)
    units = book.fleet.microgrid.case.ess
    size, low, high = (np.array([getattr(u, k) for u in units]) for k in _KEYS)
    slopes = [
        [-cut_set.cuts(t, status).slope(size * np.clip(level, low, high), levels) for level in soc]
        for t in range(cut_set.multistage.slots)
    ]
    words = f"centre {centre}" if centre >= 0 else "centre unknown"
    return WaterValues(
        units=book.fleet.names,
        buses=tuple(unit.bus for unit in units),
        step_h=case.step_h,
        soc=np.array(soc),
        per_mwh=np.array(slopes).transpose(2, 0, 1),
        about=f"{case.name}, {words}, {'down: ' + ', '.join(down) if down else 'all lines up'}",
    )


_KEYS = ("e_mwh", "soc_min", "soc_max")
