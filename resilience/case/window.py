"""The horizon: slots, the times they start at, and their labels."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import cached_property
from math import ceil, floor

from resilience.tolerances import SLOT_TOLERANCE

_MINUTE = timedelta(minutes=1)
DAY_MIN = 24 * 60
FIRST_YEAR, LAST_YEAR = 1700, 2200
"""Of a horizon: what tables of times can hold, and a little less."""


@dataclass(frozen=True)
class Window:
    """Equal slots on a calendar.

    Attributes:
        start: when the first slot begins, local time.
        slots: how many there are.
        step_min: length of each, min.
    """

    start: datetime
    slots: int
    step_min: float

    @property
    def stop(self) -> datetime:
        """End of the last slot."""
        return self.time(self.slots)

    @property
    def longer_than_a_day(self) -> bool:
        """Whether a time of day alone does not name a slot."""
        return self.slots * self.step_min > DAY_MIN

    @cached_property
    def slots_per_day(self) -> int:
        """Slots from midnight to midnight, rounded; 1 where a slot is longer than a day."""
        return max(round(DAY_MIN / self.step_min), 1)

    @cached_property
    def slots_before_start(self) -> int:
        """Slots from midnight to the start of the horizon, rounded."""
        start = self.start.hour * 60 + self.start.minute + self.start.second / 60
        return round(start / self.step_min)

    @property
    def meets_midnight(self) -> bool:
        """Whether slots divide a day and the horizon starts at a multiple of them."""
        start = self.start.hour * 60 + self.start.minute + self.start.second / 60
        per_day, before = DAY_MIN / self.step_min, start / self.step_min
        return all(abs(x - round(x)) <= SLOT_TOLERANCE for x in (per_day, before))

    def slot_of_day(self, t: int) -> int:
        """Slots from midnight to slot `t`."""
        return (self.slots_before_start + t) % self.slots_per_day

    def day_number(self, t: int) -> int:
        """Day of slot `t`, 0 for the one in which the horizon starts."""
        return (self.slots_before_start + t) // self.slots_per_day

    def time(self, t: int) -> datetime:
        """The time at which slot `t` starts."""
        return self.start + timedelta(minutes=t * self.step_min)

    def label(self, t: int) -> str:
        """`14:30` for slot `t`, or `d2 14:30` where the horizon is longer than a day."""
        return self.text(self.time(t))

    def end_label(self, stop: int) -> str:
        """When the slot before `stop` ends: `24:00` at the midnight of an only day."""
        text = self.text(self.time(stop))
        return "24:00" if text.endswith("00:00") and not self.longer_than_a_day else text

    def text(self, when: datetime) -> str:
        """A time as the labels of this horizon write it."""
        clock = f"{when:%H:%M:%S}" if when.second else f"{when:%H:%M}"
        day = (when.date() - self.start.date()).days + 1
        return f"d{day} {clock}" if self.longer_than_a_day else clock

    def span(self, first: datetime, stop: datetime) -> tuple[int, int]:
        """`(first slot, stop slot)` of all slots that `[first, stop)` touches, clipped."""
        step = self.step_min * _MINUTE
        start_slot = floor((first - self.start) / step + SLOT_TOLERANCE)
        stop_slot = ceil((stop - self.start) / step - SLOT_TOLERANCE)
        return max(start_slot, 0), min(stop_slot, self.slots)

    def __str__(self) -> str:
        return f"{self.start:%Y-%m-%d %H:%M} to {self.stop:%Y-%m-%d %H:%M}"
