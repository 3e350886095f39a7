"""What learners train on: a batch of episodes, each with a day, a storm and errors of its own.

All of it is drawn up front from `[seed, TRAINING_STREAM, number]`, a stream that no comparison
uses, on days that no comparison tests. Training sees an episode through the same `Observation` as
a dispatcher that acts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from resilience.arrays import Bools, Floats, Ints
from resilience.case import Case
from resilience.case.days import training
from resilience.errors import UsageError
from resilience.fragility.draw import sample_case
from resilience.fragility.outages.scenarios import Scenarios
from resilience.simulation.forecast import ForecastError, forecast_names, sample_outlook
from resilience.simulation.observation import Forecast, Observation
from resilience.simulation.setting import Setting
from resilience.simulation.slots import Slot, Slots
from resilience.simulation.world import World, microgrid_with_fallible_lines

TRAINING_STREAM = 2
LEAST_SLOTS_AHEAD = 8  # the paper's window, which may be longer than a day of long slots
STORMS = 6000  # drawn once; a batch takes some of them
VALIDATION_DAYS = 8  # the last of the training days, on which policies are chosen
VALIDATION_STORMS = 8


@dataclass(frozen=True, eq=False)
class Episodes:
    """A batch of episodes of equal length.

    Attributes:
        setting: the microgrid over the slots of an episode, and what is told.
        values: by name, (slots of all days,) what is forecast of every profile day ahead.
        first: (batch,) slot of `values` in which each episode begins.
        scenarios: the storm of each.
        error: by name, (slots, batch) relative forecast errors; empty without any.
    """

    setting: Setting
    values: dict[str | None, Floats]
    first: Ints
    scenarios: Scenarios
    error: dict[str, Floats]

    @property
    def n(self) -> int:
        """Number of episodes."""
        return len(self.first)

    @property
    def slots(self) -> int:
        """Slots of an episode."""
        return self.setting.case.slots

    @cached_property
    def line_up(self) -> Bools:
        """(elements of the case, slots, batch) False where a line or unit is down."""
        return self.scenarios.status(self.setting.case.elements)

    @property
    def has_energy_islands(self) -> bool:
        """Whether it depends on the energy stored which islands are alive."""
        return self.setting.microgrid.energised is not None

    def slot(self, t: int, energy: Floats | None = None) -> Slot:
        """Data and islands of slot t in every episode, as `World.slot` has them."""
        return self._slots[t] if energy is None else self._slots.with_energy(t, energy)

    def observation(self, t: int, energy: Floats) -> Observation:
        """What an operator sees in slot t with this much stored, (units, batch) MWh."""
        slot = self.slot(t, energy)
        up, centre = self.line_up[:, t], self._centre(t)
        return Observation(t, energy, up, slot.island, centre, self._forecast(t), slot.stacked)

    @cached_property
    def _slots(self) -> Slots:
        setting = self.setting
        return Slots(setting.microgrid, setting.simulator, self.line_up, self._true)

    def _centre(self, t: int) -> Ints:
        centre, day = self.scenarios.centre, self.setting.case.window.day_number(t)
        if centre is None or day >= len(centre) or not self.setting.known_centre:
            return np.full(self.n, -1)
        return centre[day]

    @cached_property
    def _day_ahead(self) -> dict[str | None, Floats]:
        """By name, (slots, batch) what was forecast, a day beyond the episode; after the last day
        of all, its end.
        """
        beyond = max(self.setting.case.window.slots_per_day, LEAST_SLOTS_AHEAD)
        ahead = np.arange(self.slots + beyond)[:, None]
        return {
            name: values[np.minimum(self.first + ahead, len(values) - 1)]
            for name, values in self.values.items()
        }

    def _expected(self, name: str | None, slots: Ints) -> Floats:
        """(len(slots), batch) what was forecast the day before."""
        return np.take(self._day_ahead[name], slots, axis=0)

    def _true(self, name: str | None, slots: Ints) -> Floats:
        values = self._expected(name, slots)
        if name not in self.error:
            return values
        return np.maximum(values * (1.0 + self.error[name][slots]), 0.0)

    def _forecast(self, now: int) -> Forecast:
        def expected(name: str | None, slots: Ints) -> Floats:
            values = self._expected(name, slots)
            rho = self.setting.error_correlation
            if name not in self.error or rho is None:
                return values
            fading = rho ** np.maximum(slots - now, 0)
            return np.maximum(values * (1.0 + fading[:, None] * self.error[name][now]), 0.0)

        return expected


class EpisodeSampler:
    """Draws batches of episodes from the training days of a case.

    Args:
        case: the case.
        days: days of an episode; a case with a storm or a blackout keeps its horizon.
        seed: of every draw.
        forecast_error: how load and PV differ from their forecast; None: not at all.
        known_centre: operators are told where the day's hazard is forecast to peak.
        end_value_per_mwh: worth of energy left; the case's terminal value if omitted.
        storms: how many outage paths are drawn, from which batches are taken.
    """

    def __init__(
        self,
        case: Case,
        *,
        days: int = 1,
        seed: int = 0,
        forecast_error: ForecastError | None = None,
        known_centre: bool = True,
        end_value_per_mwh: float | None = None,
        storms: int = STORMS,
    ) -> None:
        self.case, self.seed, self.error = training(case), seed, forecast_error
        per_day = self.case.window.slots_per_day
        slots = self.case.slots if case.is_dated else days * per_day
        validation_slots = 0 if case.is_dated else self._validation_days() * per_day
        self.starts = np.arange(0, self.case.slots - validation_slots - slots + 1, per_day)
        if not len(self.starts):
            raise UsageError(
                f"episodes of {days} days; allowed: up to "
                f"{(self.case.slots - validation_slots) // per_day}, the days for training",
                hint="the last training days are for validation, the last quarter for tests",
            )
        episode = self.case.replace(slots=slots)
        self.storms = sample_case(episode, storms, _seed(seed, 0))
        microgrid = microgrid_with_fallible_lines(episode, self.storms, "copperplate")
        world = World.build(
            microgrid,
            self.storms.chosen([0]),
            end_value_per_mwh=end_value_per_mwh,
            known_centre=known_centre,
        )
        self.setting = world.setting
        self.values = {name: self.case.profile(name) for name in (None, *self.case.profiles)}

    def _validation_days(self) -> int:
        """The last training days, on which nothing is learned."""
        return min(VALIDATION_DAYS, self.case.slots // self.case.window.slots_per_day // 4)

    def validation_world(self) -> World:
        """Days and storms on which policies are chosen: those of no batch, and of no test."""
        case, seed = self.case, _seed(0, 1)
        if not self.case.is_dated:
            days = max(self._validation_days(), 1)
            slots = days * case.window.slots_per_day
            first = case.window.time(case.slots - slots)
            case = case.replace(start=first, slots=slots)
        storms = sample_case(case, VALIDATION_STORMS, seed)
        error, outlook = self.error, None
        if error is not None:
            outlook = sample_outlook(case, error, storms.n, _seed(0, 2))
        return World.build(
            microgrid_with_fallible_lines(case, storms, "copperplate"),
            storms,
            end_value_per_mwh=self.setting.end_value_per_mwh,
            outlook=outlook,
            known_centre=self.setting.known_centre,
        )

    def draw(self, n: int, number: int) -> Episodes:
        """Batch `number` of n episodes; it depends on nothing but the seed and these."""
        rng = np.random.default_rng([self.seed, TRAINING_STREAM, number + 1])
        storm = rng.integers(self.storms.n, size=n)
        first = rng.choice(self.starts, size=n)
        return self.episodes(first, self.storms.chosen(storm), rng)

    def episodes(self, first: Ints, scenarios: Scenarios, rng: np.random.Generator) -> Episodes:
        """Episodes that begin in the slots `first` (n,) of the training days."""
        n, case = len(first), self.setting.case
        errors: dict[str, Floats] = {}
        correlation = None
        if self.error is not None:
            names = forecast_names(case)
            drawn = self.error.errors(len(names), case.slots, n, rng, case.step_min)
            errors = dict(zip(names, drawn, strict=True))
            correlation = self.error.correlation_of(case.step_min)
        setting = replace(self.setting, numbers=np.arange(n), error_correlation=correlation)
        return Episodes(setting, self.values, first, scenarios, errors)


def _seed(seed: int, number: int) -> int:
    return int(np.random.SeedSequence([seed, TRAINING_STREAM, number]).generate_state(1)[0])
