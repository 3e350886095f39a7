"""A year of storms: what is built, spread over its life, beside what storms cost meanwhile."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from resilience.arrays import Floats
from resilience.case.schema import PlanTable
from resilience.planning.hardening.program import Option


@dataclass(frozen=True)
class Years:
    """How often storms come, and what money costs.

    Attributes:
        storms_per_year: how many, like that of the case or those of its catalogue.
        interest_rate: a year.
    """

    storms_per_year: float
    interest_rate: float

    @classmethod
    def of_plan(cls, plan: PlanTable | None) -> Years | None:
        """What a case says; None where it does not say how often storms come."""
        if plan is None or not (plan.storm or plan.storms_per_year):
            return None
        per_year = sum(entry.per_year for entry in plan.storm)
        return cls(plan.storms_per_year or per_year, plan.interest_rate)

    def annual_cost(self, options: Sequence[Option]) -> Floats:
        """(options,) $ a year for each that is built, in equal payments over its life."""
        cost = np.array([option.cost for option in options])
        life_years = np.array([option.life_years for option in options])
        return cost * capital_recovery(life_years, self.interest_rate)


def capital_recovery(life_years: npt.ArrayLike, interest_rate: float) -> Floats:
    r"""Share of what was spent that is paid back every year, $r / (1 - (1 + r)^{-n})$.

    The annuity of engineering economics; without interest it is 1 / n.
    """
    life = np.asarray(life_years, float)
    if not interest_rate:
        return np.asarray(1.0 / life)
    return np.asarray(interest_rate / -np.expm1(-life * np.log1p(interest_rate)))
