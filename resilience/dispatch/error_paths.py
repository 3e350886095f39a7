r"""How load and PV may come to differ from what is forecast, path by path of a fan.

The present error is known and fades as the forecast says; what it may gain until slot $t + h$ is

$$ \nu_h = \rho\, \nu_{h-1} + \sigma \sqrt{1 - \rho^2}\, w_h, \qquad \nu_0 = 0 $$

of what was forecast, with the numbers $w$ of `simulation/forecast.py`, common share included. Paths
are antithetic: to every path there is one with all errors turned round, so that their mean is what
is expected.
"""

from __future__ import annotations

import numpy as np

from resilience.arrays import Floats
from resilience.simulation.forecast import forecast_names
from resilience.simulation.setting import Setting


class ErrorPaths:
    """Errors to come, the same numbers in every slot of an episode, others in every episode.

    Args:
        setting: what the forecast's errors are, and over which horizon.
        paths: how many.
        seed: of the numbers.
    """

    def __init__(self, setting: Setting, paths: int, seed: int) -> None:
        self.case, self.paths, self.seed = setting.case, paths, seed
        self.law, self.names = setting.error_law, forecast_names(setting.case)
        self._drawn: tuple[int, Floats] = (-1, np.empty(0))

    def ahead(self, number: int, t: int, slots: int) -> dict[str | None, Floats]:
        """What may be added to each profile in slot t and those after it, (slots, paths) each.

        Per unit of the device's peak, as the profile; nothing where forecasts are exact.

        Args:
            number: of the episode.
            t: slot of the horizon.
            slots: how many.
        """
        law = self.law
        if law is None:
            return {}
        rho = law.correlation_of(self.case.step_min)
        fresh = law.sigma * np.sqrt(1.0 - rho**2) * self._numbers(number, law.common)
        last = self.case.slots - 1
        gained = np.zeros((slots, len(self.names), self.paths))
        for h in range(1, slots):
            gained[h] = rho * gained[h - 1] + fresh[min(t + h, last)]
        within = np.minimum(t + np.arange(slots), last)
        return {
            name: self.case.profile(name)[within, None] * gained[:, k]
            for k, name in enumerate(self.names)
        }

    def _numbers(self, number: int, common: float) -> Floats:
        """(slots, profiles, paths) standard normal numbers of an episode, antithetic in pairs."""
        if self._drawn[0] != number:
            rng = np.random.default_rng([self.seed, number, 1])
            half, n = (self.paths + 1) // 2, len(self.names)
            w = rng.standard_normal((self.case.slots, n + 1, half))
            own_share, shared = np.sqrt([1.0 - common, common])
            w = own_share * w[:, :n] + shared * w[:, n:]
            self._drawn = number, np.concatenate([w, -w], axis=2)[:, :, : self.paths]
        return self._drawn[1]
