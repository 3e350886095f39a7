"""Every method on the same episodes: the numbers that a report is made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Floats
from resilience.case import Case
from resilience.dispatch.registry import REFERENCE, names_planning_for
from resilience.evaluation.ac_check import TrajectoryACCheck
from resilience.evaluation.bounds.dual_bound import DualBound
from resilience.evaluation.comparison import BOUND, check_bound
from resilience.evaluation.measures.intervals import MeanInterval
from resilience.evaluation.measures.measures import Measures
from resilience.evaluation.measures.metrics import Adequacy
from resilience.evaluation.paired import days_of, difference
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.case_program import case_cost_scale
from resilience.simulation.trajectory import Trajectory
from resilience.simulation.world import World

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Judged:
    """Every dispatcher on the same episodes; an episode is one scenario over all days.

    Attributes:
        world: case, storms and rules of the comparison.
        trajectories: method to what it did; the clairvoyant is among them.
        measures: method to what is measured of it.
        bound: (episodes,) $, the clairvoyant optimum, which no dispatcher can beat.
        certificates: method to what AC power flow says; None where it was not run.
        forecast_error: how load and PV differ from their forecast, in words.
        comb: $ an episode that nobody without foreknowledge costs less than on average, where only
            the end of a blackout is unknown; None elsewhere.
        dual: the like of any case, where it was asked for.
    """

    world: World = field(repr=False)
    trajectories: Mapping[str, Trajectory] = field(repr=False)
    measures: Mapping[str, Measures] = field(repr=False)
    bound: Floats = field(repr=False)
    certificates: Mapping[str, TrajectoryACCheck] | None = field(default=None, repr=False)
    forecast_error: str = "none"
    comb: float | None = None
    dual: DualBound | None = None

    reference = REFERENCE

    def __post_init__(self) -> None:
        """Refuses methods that beat a bound.

        Raises:
            CertificateError: one does; method, episode, cost and bound are named.
        """
        scale = case_cost_scale(self.case)
        check_bound(self.objective, self.bound, scale, self.world.index)
        if self.dual is not None:
            self.dual.check(self.objective, scale)

    @property
    def case(self) -> Case:
        """The case, over the days of an episode."""
        return self.world.microgrid.case

    @property
    def scenarios(self) -> Scenarios:
        """The storms: an episode is one scenario."""
        return self.world.scenarios

    @property
    def end_value_per_mwh(self) -> float:
        """Worth of the energy left, $/MWh."""
        return self.world.end_value_per_mwh

    @property
    def physics(self) -> str:
        """The physics of everybody, the bound included."""
        return self.world.microgrid.physics

    @property
    def days(self) -> float:
        """Days of an episode."""
        return days_of(self)

    @property
    def objective(self) -> Mapping[str, Floats]:
        """Method to (episodes,) $: cost less the worth of the energy left."""
        return {name: measures.objective for name, measures in self.measures.items()}

    @property
    def adequacy(self) -> Mapping[str, Adequacy]:
        """Method to its reliability indices."""
        return {name: measures.adequacy for name, measures in self.measures.items()}

    @property
    def seconds(self) -> Mapping[str, float]:
        """Method to wall-clock seconds for all of its decisions."""
        return {name: trajectory.seconds for name, trajectory in self.trajectories.items()}

    @property
    def bound_seconds(self) -> float:
        """Wall-clock seconds for the slowest part of the bound."""
        return self.trajectories[BOUND].build_seconds

    def difference(self, name: str, reference: str) -> MeanInterval:
        """What `name` costs more per day than `reference`, on the same episodes, with its interval.

        Ends are NaN where a single episode allows none.
        """
        return difference(self, name, reference)

    def differences(self) -> pd.DataFrame:
        """Any two methods: what the first costs more per day, its interval, and if it is luck.

        An interval is that of its pair alone: of many, one in twenty misses. `carriers` is how many
        day-episodes carry 80 % of the difference; where they are few, `few_events` is True.
        """
        import pandas as pd

        order = sorted(self.objective, key=lambda name: float(np.mean(self.objective[name])))
        rows = []
        for cheaper, name in combinations(order, 2):
            more = self.difference(name, cheaper)
            sure = more.excludes_zero
            ends = {"low": more.low, "high": more.high, "excludes_zero": sure}
            pair = {"method": name, "other": cheaper, "per_day": more.mean, **ends}
            rows.append(pair | {"carriers": more.carriers, "few_events": more.few_events})
        names = ["method", "other", "per_day", "low", "high", "excludes_zero"]
        return pd.DataFrame(rows, columns=[*names, "carriers", "few_events"])

    def value_of_stochastic_solution(self) -> list[dict[str, str | float]]:
        """What planning for one future costs more per day than planning for many.

        Textbooks compare two first decisions; here both plan anew in every slot, and what is
        compared is what they end up paying. A row per pair that was run, with its interval.
        """
        rows: list[dict[str, str | float]] = []
        for deterministic in names_planning_for("one", self.objective):
            for stochastic in names_planning_for("many", self.objective):
                more = self.difference(deterministic, stochastic)
                rows.append(
                    {
                        "deterministic": deterministic,
                        "stochastic": stochastic,
                        "per_day": more.mean,
                        "low": more.low,
                        "high": more.high,
                    }
                )
        return rows
