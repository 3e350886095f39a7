r"""What a day may be like, learnt from days that nothing is tested on.

A day is a mixture: its load is $\theta_1$ times the mean working day plus $\theta_2$ times the mean
day off, its PV $\theta_3$ times the mean day's. These levels are fitted to the forecast of the day
by non-negative least squares, in MW, and stay what they are until midnight. What a slot has beside
that is noise: a few factors per slot, the means of equal groups of the training days in the order
of their net load there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.models.components import device_fleets

if TYPE_CHECKING:
    from resilience.case import Case


@dataclass(frozen=True)
class Days:
    """Days of the past by profile.

    Attributes:
        names: of the profiles that loads and PV follow.
        size: (profiles,) MW that one per unit is: demand positive, PV negative.
        values: (days, profiles, slots) per unit.
        off: (days,) True on Saturdays and Sundays.
    """

    names: tuple[str, ...]
    size: Floats
    values: Floats
    off: Bools


def past_days(case: Case) -> Days:
    """Days to learn from: those before the test days, or the case's own where it has no file.

    Days are whole and begin at midnight; a case that is shorter than a day is one day of its own.
    """
    from resilience.case.days import TEST_SHARE, profile_times

    per_day, times = case.window.slots_per_day, profile_times(case)
    if times is not None:
        days = len(times) // per_day
        first = times[0].astype("datetime64[s]").item()
        training_days = max(days - math.ceil(TEST_SHARE * days), 1)
        case = case.replace(start=first, slots=training_days * per_day, outages=())
    return _cut_into_days(case, per_day)


def _cut_into_days(case: Case, per_day: int) -> Days:
    size: dict[str, float] = {}
    for fleet in device_fleets(case).values():
        for profile, fed_mw in fleet.expected():
            if profile is not None:
                size[profile] = size.get(profile, 0.0) - fed_mw
    offset = case.window.slots_before_start
    count = -(-(offset + case.slots) // per_day)
    series = np.full((len(size), count * per_day), np.nan)
    for row, name in zip(series, size, strict=True):
        row[offset : offset + case.slots] = case.profile(name)
    values = series.reshape(len(size), count, per_day).swapaxes(0, 1)
    first = np.datetime64(case.start.date())
    off = ~np.is_busday(first + np.arange(count))
    return Days(tuple(size), np.array(list(size.values())), _filled(values), off)


def _filled(values: Floats) -> Floats:
    """Slots that no day knows get the mean of those that are known."""
    is_known = ~np.isnan(values)
    count, total = is_known.sum(axis=0), np.where(is_known, values, 0.0).sum(axis=0)
    mean = total.sum(axis=1, keepdims=True) / np.maximum(count.sum(axis=1, keepdims=True), 1)
    by_slot = np.where(count > 0, total / np.maximum(count, 1), mean)
    return np.where(is_known, values, by_slot)


@dataclass(frozen=True)
class Climate:
    """The mixture and the noise.

    Attributes:
        names: of the profiles of loads and PV.
        basis: (levels, profiles, slots) per unit at one unit of every level.
        noise: (outcomes, profiles, slots) factors of what the levels say, equally likely.
        size: (profiles,) MW that one per unit is.
        levels: (days, levels) of the days that it was learnt from.
    """

    names: tuple[str, ...]
    basis: Floats
    noise: Floats
    size: Floats
    levels: Floats

    def fitted(self, values: Floats, slots: Ints) -> Floats:
        """(levels,) of a day of which (profiles, len(slots)) is known or forecast."""
        return _fit(self.basis[:, :, slots], self.size, values)

    def profile(self, name: str, t: int, outcome: int) -> Floats:
        """(levels,) per unit of a profile in slot t that one unit of every level adds."""
        k = self.names.index(name)
        return self.basis[:, k, t] * self.noise[outcome, k, t]


def fitted_climate(days: Days, outcomes: int) -> Climate:
    """The mixture that fits the days, and `outcomes` equally likely factors for every slot."""
    basis = _basis(days)
    levels = np.array([_fit(basis, days.size, day) for day in days.values])
    fit = np.tensordot(levels, basis, 1)
    residual_mw = np.tensordot(days.values - fit, days.size, ([1], [0]))
    order = np.argsort(residual_mw, axis=0, kind="stable")
    noise = np.ones((outcomes, *days.values.shape[1:]))
    for factor, chosen in zip(noise, np.array_split(order, outcomes), strict=True):
        group = chosen[:, None, :]
        actual = np.take_along_axis(days.values, group, axis=0).sum(axis=0)
        fitted = np.take_along_axis(fit, group, axis=0).sum(axis=0)
        np.divide(actual, fitted, out=factor, where=fitted > 0.0)
    return Climate(days.names, basis, noise, days.size, levels)


def _basis(days: Days) -> Floats:
    """Mean working day, mean day off (where there are both), and mean day of the sun."""
    load, sun = days.size >= 0.0, days.size < 0.0
    kinds = [kind for kind in (~days.off, days.off) if kind.any()]
    means = [days.values[kind].mean(axis=0) * load[:, None] for kind in kinds if load.any()]
    if sun.any():
        means.append(days.values.mean(axis=0) * sun[:, None])
    return np.array(means).reshape(len(means), *days.values.shape[1:])


def _fit(basis: Floats, size: Floats, values: Floats) -> Floats:
    """Non-negative least squares of (profiles, slots) on (levels, profiles, slots), in MW."""
    from scipy.optimize import nnls

    weight = np.abs(size)[:, None]
    design = (basis * weight).reshape(len(basis), -1).T
    if not design.size:
        return np.ones(len(basis))
    both = np.column_stack([design, (values * weight).ravel()])
    triangle = np.asarray(np.linalg.qr(both, mode="r"))
    return nnls(triangle[:, :-1], triangle[:, -1])[0]
