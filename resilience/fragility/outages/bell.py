r"""The paper's outage process: a bell of hazard over the day.

On each day the hazard peaks in a random slot $c$,

$$ p_t = p_\text{max} \exp\left(-\frac{(t - c)^2}{2 \sigma^2}\right), $$

in every slot a line that has not failed yet fails with probability $p_t$, and is back after 12 to
15 slots, all lengths equally likely. Lengths may be lognormal instead, as times of restoration are:
their median is the geometric mean of the shortest and the longest, which lie two standard
deviations from it, and none is beyond them. Other breakpoints have the same bell, shifted by up to
3 slots. What the paper leaves open is a setting here, with a default. Its draw per slot depends on
the step: halving the slot doubles the number of draws. With `rate` the same bell is a rate of
failures per reference slot of 15 minutes, $-\ln(1 - p_t)$, integrated over the slot, and the step
does not matter.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.special import ndtr, ndtri

from resilience.arrays import Floats, Ints
from resilience.case.schema.tables import MAX_SIGMA_SLOTS
from resilience.errors import UsageError
from resilience.tolerances import SLOT_TOLERANCE

if TYPE_CHECKING:
    from resilience.case import Case

REFERENCE_MIN = 15.0  # the paper's slot
REFERENCE_SLOTS = 96  # of a day
DURATION_LAWS = ("uniform", "lognormal")
END_DEVIATIONS = 2.0  # from the median to the shortest and the longest of lognormal lengths
LENGTHS = 50  # that stand for lognormal ones, equally likely


@dataclass(frozen=True)
class Bell:
    """The paper's outage process and its ambiguities. Slots here are slots of 15 minutes.

    Attributes:
        probability: of an outage of a line on a day whose bell is not cut off by midnight.
        height: of the bell, as a probability per slot; replaces `probability` if given.
        sigma_slots: width of the bell.
        duration_slots: shortest and longest outage, both included.
        duration_law: of the lengths between them: uniform or lognormal.
        shift_slots: breakpoints other than the first peak up to so many slots earlier or later.
        shared_shift: all of them are shifted alike.
        common_draw: all lines use the same random number in a slot (comonotone), not one each.
        refail: a line that is back may fail again on the same day.
        wrap: the bell goes round: what midnight cuts off appears at the other end of the day.
        overnight: an outage runs on past midnight; otherwise it ends with its day.
        centres: the slots of the day in which the hazard may peak, equally likely; all if empty.
        centre_error_slots: the centre is forecast with an error of up to so many slots.
        rate: integrate the bell as a rate per hour, so that the step does not matter.

    Raises:
        UsageError: a value out of range; all of them are listed.
    """

    probability: float = 0.8
    height: float | None = None
    sigma_slots: float = 4.0
    duration_slots: tuple[int, int] = (12, 15)
    duration_law: str = "uniform"
    shift_slots: int = 3
    shared_shift: bool = False
    common_draw: bool = False
    refail: bool = False
    wrap: bool = False
    overnight: bool = True
    centres: tuple[int, ...] = ()
    centre_error_slots: int = 0
    rate: bool = False

    def __post_init__(self) -> None:
        short, long = self.duration_slots
        last, widths = REFERENCE_SLOTS - 1, f"above 0, to {MAX_SIGMA_SLOTS}"
        rules: tuple[tuple[str, bool, str], ...] = (
            ("probability", 0.0 <= self.probability < 1.0, "0 up to, but not, 1"),
            ("height", 0.0 <= (self.height or 0.0) < 1.0, "0 up to, but not, 1"),
            ("sigma_slots", 0.0 < self.sigma_slots <= MAX_SIGMA_SLOTS, widths),
            ("duration_slots", 0 < short <= long, "0 < shortest <= longest"),
            ("duration_law", self.duration_law in DURATION_LAWS, " or ".join(DURATION_LAWS)),
            ("shift_slots", self.shift_slots >= 0, "0 or more"),
            ("centres", all(0 <= c <= last for c in self.centres), f"slots 0 to {last}"),
            ("centre_error_slots", self.centre_error_slots >= 0, "0 or more"),
        )
        wrong = [f"{k} {getattr(self, k)}; allowed: {ok}" for k, good, ok in rules if not good]
        if wrong:
            is_percent = any(1.0 < share <= 100.0 for share in (self.probability, self.height or 0))
            usual = "0.8 and 4 slots are the usual probability and width"
            raise UsageError(
                "outage process: " + "; ".join(wrong),
                hint=f"probably percent; divide by 100; {usual}" if is_percent else usual,
            )
        _ = self.p_max

    def __str__(self) -> str:
        """What happens, in words: `bell of hazard each day, 80 % that a line fails, ...`."""
        short, long = (slots * REFERENCE_MIN / 60.0 for slots in self.duration_slots)
        peaks = [f"{c * REFERENCE_MIN / 60.0:g}" for c in self.centres]
        chance = (
            f"{100.0 * self.probability:g} % that a line fails"
            if self.height is None
            else f"{100.0 * self.height:g} % per slot at its peak"
        )
        alike = ", all alike" if self.shared_shift else ""
        shift = f"further lines up to {self.shift_slots * REFERENCE_MIN:g} min apart{alike}"
        error = f"peak forecast to within {self.centre_error_slots * REFERENCE_MIN:g} min"
        parts = (
            (True, chance),
            (True, f"sigma {self.sigma_slots * REFERENCE_MIN:g} min"),
            (bool(peaks), f"peak {' or '.join(peaks)} h after midnight"),
            (True, f"down for {f'{short:g} to {long:g}' if short < long else f'{long:g}'} h"),
            (self.duration_law != "uniform", f"{self.duration_law} lengths"),
            (self.shift_slots > 0, shift),
            (self.common_draw, "one draw for all lines"),
            (self.refail, "lines may fail again"),
            (self.wrap, "the bell goes round midnight"),
            (not self.overnight, "outages end at midnight"),
            (self.centre_error_slots > 0, error),
            (self.rate, "the bell is a rate"),
        )
        return ", ".join(["bell of hazard each day", *(words for holds, words in parts if holds)])

    @cached_property
    def p_max(self) -> float:
        """Height of the bell: probability per slot of 15 minutes at its centre."""
        if self.height is not None or self.probability == 0.0:
            return self.height or 0.0
        step = min(1.0, self.sigma_slots / 8) if self.rate else 1.0
        reach = np.ceil(8 * self.sigma_slots / step) + 1
        shape = np.exp(-((np.arange(-reach, reach + 1) * step / self.sigma_slots) ** 2) / 2)
        target = -np.log1p(-self.probability)

        def excess(survived: float) -> float:
            """The bell whose height is 1 - exp(-survived), which may be arbitrarily close to 1."""
            return float(-step * np.log1p(np.expm1(-survived) * shape).sum() - target)

        # The centre alone reaches the target at `target / step`. A rate close to certainty in one
        # slot has a peak like a logarithm's, which no quadrature meets: up to 0.99 then.
        limit = min(target / step, 4.6 if self.rate else 36.0) * (1.0 + 1e-12)
        if excess(limit) < 0.0:
            raise UsageError(
                f"outage process: probability {self.probability} cannot be reached by a bell of "
                f"sigma_slots {self.sigma_slots}",
                hint="widen the bell",
            )
        return float(-np.expm1(-brentq(excess, 0.0, limit, xtol=1e-14)))

    def slot_probability(
        self,
        centre: ArrayLike,
        step_min: float = REFERENCE_MIN,
        slots: int | None = None,
    ) -> Floats:
        """(..., slots) probability that a line which is up fails in a slot of the day.

        Args:
            centre: (...) slot of 15 minutes in whose middle the hazard peaks.
            step_min: length of a slot, minutes.
            slots: slots of the day; all if omitted.
        """
        ratio = step_min / REFERENCE_MIN
        begin = np.arange(round(REFERENCE_SLOTS / ratio) if slots is None else slots) * ratio
        away = begin - np.asarray(centre, float)[..., None] - 0.5
        if not self.rate:
            return self._height(away + ratio / 2)
        nodes, weights = np.polynomial.legendre.leggauss(4 + int(8 * ratio / self.sigma_slots))
        hazard = -np.log1p(-self._height(away[..., None] + ratio * (nodes + 1) / 2))
        return -np.expm1(-(hazard @ weights) * ratio / 2)

    def day_probability(
        self,
        centre: ArrayLike,
        step_min: float = REFERENCE_MIN,
        slots: int | None = None,
    ) -> Floats:
        """(...) probability of an outage on a day; the arguments are those of a slot."""
        survival = np.log1p(-self.slot_probability(centre, step_min, slots))
        return np.asarray(-np.expm1(survival.sum(axis=-1)))

    def lengths(self, step_min: float) -> Ints:
        """(lengths,) slots of `step_min` minutes that an outage may last, equally likely, rising.

        As everywhere in a case, a slot that an outage touches at all is down.
        """
        slots = self._reference_lengths * (REFERENCE_MIN / step_min)
        return np.ceil(slots - SLOT_TOLERANCE).astype(np.intp)

    @cached_property
    def _reference_lengths(self) -> Floats:
        """(lengths,) slots of 15 minutes, equally likely: all of them, or quantiles of the law."""
        shortest, longest = self.duration_slots
        if self.duration_law == "uniform":
            return np.arange(shortest, longest + 1, dtype=float)
        low, high = ndtr([-END_DEVIATIONS, END_DEVIATIONS])
        share = low + (high - low) * (np.arange(LENGTHS) + 0.5) / LENGTHS
        middle = 0.5 + ndtri(share) / (2.0 * END_DEVIATIONS)
        return np.asarray(shortest * (longest / shortest) ** middle)

    def centre_slots(self) -> Ints:
        """Slots of 15 minutes in which the hazard may peak."""
        return np.array(self.centres or range(REFERENCE_SLOTS), np.intp)

    def _height(self, away: Floats) -> Floats:
        if self.wrap:
            half = REFERENCE_SLOTS / 2
            away = (away + half) % REFERENCE_SLOTS - half
        return self.p_max * np.exp(-((away / self.sigma_slots) ** 2) / 2)


class BellSettings(TypedDict, total=False):
    """Fields of `Bell` to replace; those that are None stay as they are."""

    probability: float | None
    height: float | None
    sigma_slots: float | None
    duration_slots: tuple[int, int] | None
    duration_law: str | None
    shift_slots: int | None
    shared_shift: bool | None
    common_draw: bool | None
    refail: bool | None
    wrap: bool | None
    overnight: bool | None
    centres: tuple[int, ...] | None
    centre_error_slots: int | None
    rate: bool | None


def case_bell(case: Case, **changes: Unpack[BellSettings]) -> Bell:
    """The bell of a case, as its table `[outage]` says, with some settings replaced.

    Args:
        case: the case.
        changes: fields of `Bell`; those that are None stay as they are.

    Raises:
        UsageError: a value out of range.
    """
    settings = {key: value for key, value in changes.items() if value is not None}
    if "probability" in settings:
        settings.setdefault("height", None)
    return Bell(**(dict(case.outage) | settings))
