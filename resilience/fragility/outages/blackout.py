r"""A blackout: lines that are lost together, and come back together after a time nobody knows.

The hours $D$ until they are back have a law: fixed, uniform, lognormal or exponential, as those of
repairs. What it puts beyond the longest blackout ends then, $\min\{D, D_\text{max}\}$. A slot in
which the lines are down at all is down, and every blackout has one slot or more:

$$ P(\text{it lasts } n \text{ slots}) = F(n \Delta) - F((n - 1) \Delta), \qquad n > 1 $$

What runs on beyond the horizon counts as lasting to its end.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtr

from resilience.arrays import Floats
from resilience.case.schema import LAW_PARAMETERS, BlackoutTable
from resilience.errors import UsageError
from resilience.fragility.outages.breakpoints import breakpoints
from resilience.fragility.outages.scenarios import Scenarios
from resilience.tolerances import SLOT_TOLERANCE

if TYPE_CHECKING:
    from resilience.case import Case


def _lognormal(h: Floats, median: float, sigma: float) -> Floats:
    with np.errstate(divide="ignore"):
        return ndtr(np.log(h / median) / sigma) if sigma > 0.0 else _fixed(h, median)


def _uniform(h: Floats, low: float, high: float) -> Floats:
    return np.clip((h - low) / (high - low), 0.0, 1.0) if high > low else _fixed(h, low)


def _fixed(h: Floats, hours: float) -> Floats:
    return (h >= hours).astype(float)


CUMULATIVE: dict[str, Callable[..., Floats]] = {
    "fixed": _fixed,
    "uniform": _uniform,
    "lognormal": _lognormal,
    "exponential": lambda h, mean: -np.expm1(-h / mean),
}
"""P(D <= h) of hours h and the parameters of the law, which are those of `LAW_PARAMETERS`."""


@dataclass(frozen=True, eq=False)
class Blackout:
    """Lines lost together over the horizon of a case.

    Attributes:
        lines: their names.
        first: slot in which they are lost.
        chance: (slots from there to the end of the horizon,) probability that it lasts 1, 2, ...
            slots; the last one holds all that runs on.
        process: in words.
    """

    lines: tuple[str, ...]
    first: int
    chance: Floats
    process: str

    @property
    def slots(self) -> int:
        """Slots of the horizon."""
        return self.first + len(self.chance)

    def scenarios(self, lengths: np.ndarray, probability: Floats, seed: int | None) -> Scenarios:
        """Outage paths (n,) of so many slots each, with their probabilities."""
        slot = np.arange(self.slots)[:, None]
        down = (slot >= self.first) & (slot < self.first + lengths)
        every = np.repeat(down[None], len(self.lines), axis=0)
        return Scenarios(self.lines, every, probability, seed=seed, process=self.process)

    def sample(self, n: int, seed: int) -> Scenarios:
        """`n` equally likely outage paths; more of the same seed begin alike.

        Raises:
            UsageError: no scenario, or a negative seed.
        """
        if n < 1 or seed < 0:
            raise UsageError(
                f"{n} scenarios, seed {seed}; allowed: 1 or more, seed 0 or more",
                hint="a blackout has as many ends as slots; 32 draws are the usual number",
            )
        u = np.random.default_rng([seed]).random(n)
        lengths = 1 + np.searchsorted(np.cumsum(self.chance)[:-1], u, side="right")
        return self.scenarios(lengths, np.full(n, 1.0 / n), seed)

    def every_end(self) -> Scenarios:
        """All outage paths there can be, each with its probability: nothing is sampled."""
        lengths = 1 + np.flatnonzero(self.chance > 0.0)
        return self.scenarios(lengths, self.chance[lengths - 1], None)


def case_blackout(case: Case) -> Blackout:
    """The blackout of a case, as its table `[blackout]` says.

    Raises:
        UsageError: the case has none, or it names no line and the case has no breakpoint.
    """
    table = case.blackout
    if table is None:
        raise UsageError(
            f"case {case.name!r} has no [blackout]",
            hint='add one: lines = ["1-2"], hours = [24, 0.8]',
        )
    first = 0 if table.start is None else case.window.span(table.start, case.window.stop)[0]
    lines = table.lines or breakpoints(case)
    return Blackout(lines, first, _chance(table, case, first), _process(table, case, first, lines))


def _chance(table: BlackoutTable, case: Case, first: int) -> Floats:
    """(slots from the first to the last,) probability of every length."""
    ends_h = case.step_h * np.arange(1, case.slots - first + 1)
    at_most = CUMULATIVE[table.law](ends_h + SLOT_TOLERANCE * case.step_h, *table.hours)
    if table.longest_h is not None:
        at_most = np.where(ends_h >= table.longest_h - SLOT_TOLERANCE * case.step_h, 1.0, at_most)
    at_most[-1] = 1.0
    return np.diff(at_most, prepend=0.0)


def _process(table: BlackoutTable, case: Case, first: int, lines: tuple[str, ...]) -> str:
    names = LAW_PARAMETERS[table.law]
    hours = ", ".join(f"{n} {h:g}" for n, h in zip(names, table.hours, strict=True))
    longest = "" if table.longest_h is None else f", {table.longest_h:g} at the longest"
    start = f"{case.window.time(first):%Y-%m-%d %H:%M}"
    return f"blackout, {', '.join(lines)} lost at {start}, {table.law} hours ({hours}){longest}"
