r"""Forecast errors: what load and PV turn out to be, given what was forecast.

$$ x_t = \max(0, \hat x_t (1 + e_t)), \qquad
   e_t = \rho e_{t-1} + \sigma \sqrt{1 - \rho^2}\, w_t, \qquad w_t \sim N(0, 1) $$

The standard deviation of $e_t$ is $\sigma$ in every slot. A share $c$ of its variance is common to
all profiles of the feeder, the weather's part:
$w_t = \sqrt{c}\, w_t^\text{all} + \sqrt{1 - c}\, w_t^\text{own}$. $\rho = 0$ is the paper:
independent errors. The day-ahead forecast of German load in July and August 2022 (ENTSO-E) has
$\sigma$ = 2.5 % and, from one quarter of an hour to the next, $\rho$ = 0.97: errors last for hours.
A feeder errs by more than a nation, in which errors of places cancel.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Floats, Ints
from resilience.errors import UsageError, check_range
from resilience.fragility.outages.bell import REFERENCE_MIN
from resilience.models.components import device_fleets

if TYPE_CHECKING:
    from resilience.case import Case

MEASURED_SIGMA = 0.025
MEASURED_CORRELATION = 0.97
FEEDER_SIGMA = 0.1  # of a feeder, a few thousand customers instead of a nation
FEEDER_COMMON = 0.7


@dataclass(frozen=True)
class ForecastError:
    """Errors relative to the forecast.

    Attributes:
        sigma: standard deviation, per unit of the forecast.
        correlation: between one slot of 15 minutes and the next; 0: the paper's Gaussian.
        common: share of the variance that all profiles have in common; 0: each errs by itself.

    Raises:
        UsageError: a value out of range.
    """

    sigma: float = MEASURED_SIGMA
    correlation: float = MEASURED_CORRELATION
    common: float = 0.0

    def __post_init__(self) -> None:
        check_range("sigma", self.sigma, 0.0, 1.0, hint="0.025 is measured")
        hint = "0 is the paper's, 0.97 is measured"
        check_range("correlation", self.correlation, 0.0, 1.0, hint=hint, below=True)
        check_range("common share", self.common, 0.0, 1.0, hint="0.7 is usual for a feeder")

    def __str__(self) -> str:
        """How reports call it."""
        common = f", {self.common:.0%} common" if self.common else ""
        return f"sigma {self.sigma:g}, correlation {self.correlation:g}{common}"

    def correlation_of(self, step_min: float) -> float:
        """The correlation between a slot of this length, minutes, and the next."""
        return float(self.correlation ** (step_min / REFERENCE_MIN))

    def errors(
        self,
        profiles: int,
        slots: int,
        n: int,
        rng: np.random.Generator,
        step_min: float = REFERENCE_MIN,
    ) -> Floats:
        """(profiles, slots, scenarios) relative errors.

        Scenarios have a stream each, spawned from `rng`, so that a longer horizon or more
        scenarios begin alike.

        Args:
            profiles: how many.
            slots: how many.
            n: scenarios.
            rng: a fresh one for draws that can be repeated.
            step_min: length of a slot, minutes; the correlation is scaled to it.
        """
        rho = self.correlation_of(step_min)
        errors = np.empty((profiles, slots, n))
        for k, stream in enumerate(rng.spawn(n)):
            # Slot by slot, what all have in common last, so that a longer horizon begins alike.
            w = stream.standard_normal((slots, profiles + (self.common > 0.0))).T
            errors[:, :, k] = w[:profiles]
            if self.common > 0.0:
                own_share, shared = np.sqrt([1.0 - self.common, self.common])
                errors[:, :, k] = own_share * w[:profiles] + shared * w[-1]
        errors[:, 1:] *= np.sqrt(1.0 - rho**2)
        for t in range(1, slots):
            errors[:, t] += rho * errors[:, t - 1]
        errors *= self.sigma
        return errors

    def sample(
        self,
        forecast: Floats,
        n: int,
        rng: np.random.Generator,
        step_min: float = REFERENCE_MIN,
    ) -> Floats:
        """(profiles, slots, scenarios) what comes true, per unit and never below 0.

        Args:
            forecast: (profiles, slots) per unit of the device's peak.
            n: how many scenarios.
            rng: as in `errors`.
            step_min: length of a slot, minutes.
        """
        profiles, slots = forecast.shape
        error = self.errors(profiles, slots, n, rng, step_min)
        return np.maximum(forecast[:, :, None] * (1.0 + error), 0.0)


def forecast_names(case: Case) -> tuple[str, ...]:
    """Names of the profiles that loads and PV follow; what nothing but a price follows is known."""
    fleets = device_fleets(case).values()
    names = (name for fleet in fleets for name, _ in fleet.expected())
    return tuple(dict.fromkeys(name for name in names if name is not None))


def sample_profiles(
    case: Case, error: ForecastError, n: int, rng: np.random.Generator
) -> tuple[tuple[str, ...], Floats]:
    """Names of the profiles of loads and PV, and what comes true: (profiles, slots, scenarios).

    Prices are not forecast: a profile that no load and no PV follows is left out.
    """
    names = forecast_names(case)
    forecast = np.array([case.profiles[name] for name in names]).reshape(len(names), case.slots)
    return names, error.sample(forecast, n, rng, case.step_min)


@dataclass(frozen=True, eq=False)
class Outlook:
    r"""What comes true of load and PV in every scenario, and what is expected as time goes by.

    Whoever forecasts knows the present error and how errors fade, so that at slot $t$ the profile
    of slot $s \ge t$ is expected to be $\hat x_s (1 + \rho^{s - t} e_t)$, exact at $s = t$.

    Attributes:
        names: the profiles that are forecast; all others are known.
        error: (profiles, slots, scenarios) relative errors, see `ForecastError.errors`.
        correlation: of the errors, from one slot to the next.
        law: of the errors, as operators know it; None: nobody expects any beyond the present one.
    """

    names: tuple[str, ...]
    error: Floats
    correlation: float
    law: ForecastError | None = None

    def true(self, name: str | None, values: Floats, slots: Ints) -> Floats:
        """(len(slots), scenarios) what comes true of `values` (len(slots),), forecast for them."""
        if name not in self.names:
            return np.repeat(values[:, None], self.error.shape[2], axis=1)
        error = self.error[self.names.index(name), slots]
        return np.maximum(values[:, None] * (1.0 + error), 0.0)

    def expected(self, name: str | None, values: Floats, slots: Ints, now: int) -> Floats:
        """(len(slots), scenarios) what is expected of them at slot `now`, the first of `slots`."""
        if name not in self.names:
            return self.true(name, values, slots)
        fading = self.correlation ** np.maximum(slots - now, 0)
        error = fading[:, None] * self.error[self.names.index(name), now]
        return np.maximum(values[:, None] * (1.0 + error), 0.0)


def sample_outlook(case: Case, error: ForecastError, n: int, seed: int) -> Outlook:
    """Errors of every profile that loads and PV follow, drawn up front for `n` scenarios."""
    names = forecast_names(case)
    rng = np.random.default_rng(seed)
    errors = error.errors(len(names), case.slots, n, rng, case.step_min)
    return Outlook(names, errors, error.correlation_of(case.step_min), error)


def lasting_outlook(case: Case, load: float, pv: float, n: int) -> Outlook:
    """Load and PV that are off their forecast by the same share in every slot, unexpectedly.

    Whoever forecasts observes what is off now and goes on expecting the forecast.

    Args:
        case: the case.
        load: of every load, per unit of its forecast: 0.15 is 15 % more.
        pv: of every PV plant, likewise.
        n: scenarios, all alike.

    Raises:
        UsageError: a load or plant without a profile, or both on the same one.
    """
    share: dict[str, float] = {}
    for kind, tables, off in (("load", case.load, load), ("pv", case.pv, pv)):
        for table in tables:
            name = table.profile
            if name is None or share.setdefault(name, off) != off:
                problem = "no profile" if name is None else f"profile {name!r} of load and PV"
                raise UsageError(
                    f"{kind} {table.name} of case {case.name} follows {problem}; allowed: profiles "
                    "of loads apart from those of PV",
                    hint="forecast errors are those of profiles",
                )
    names = forecast_names(case)
    error = np.array([share[name] for name in names]).reshape(-1, 1, 1)
    return Outlook(names, np.broadcast_to(error, (len(names), case.slots, n)).copy(), 0.0)
