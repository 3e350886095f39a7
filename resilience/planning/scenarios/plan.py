"""A plan over scenarios: what to do now, until scenarios part, and what follows in each of them.

A saved one is a folder that appears whole or not at all:

    summary.json      costs, bound, values, audit, ...: what `--json` prints, and `kind`
    case.toml         the case as solved; loads back
    outages.npz       the scenarios
    NAME.parquet/csv  the schedule of the common slots, one table per quantity
    band_NAME.*       mean and 5 to 95 % band of stored energy and shedding over all scenarios
    scenarios.*       a row per scenario
    recourse.parquet  power of every device in every slot of every scenario
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from resilience.arrays import Floats
from resilience.errors import CertificateError, UsageError
from resilience.models.program import gate
from resilience.models.program.risk import Risk
from resilience.planning.files import write_plan
from resilience.planning.records import (
    CertifiedPlan,
)
from resilience.planning.scenarios.records import InformationValue, ScenarioStatistics, Unreduced
from resilience.planning.tables import SlotTable
from resilience.results import SCENARIO_PLAN, replacing

if TYPE_CHECKING:
    import pandas as pd

    from resilience.fragility.outages.scenarios import Scenarios
from resilience.fragility.outages.weights import effective_number

BANDS = {
    "energy": "MWh stored at the end of the slot, all units together",
    "shed": "MW, all loads together",
}
"""What there is a band of over scenarios, by the columns mean, low and high (5 and 95 %)."""
BAND_QUANTILES = (0.05, 0.95)
SCENARIOS_FILE = "outages.npz"
FILES = {
    "staying": "probability of being in the common schedule still",
    **{f"band_{name}": f"{unit}: mean, low and high (5 and 95 %)" for name, unit in BANDS.items()},
    "scenarios": "a row per scenario: probability, slot in which it leaves the common schedule, "
    "$ that it costs, MWh shed and left, $ had it been known",
    SCENARIOS_FILE: "the scenarios: which line or unit is out when, and how likely that is",
    "recourse.parquet": "MW fed in by every device, a row per scenario and slot",
}
"""What a folder holds beside the tables of the common schedule."""


@dataclass(frozen=True, kw_only=True, repr=False)
class ScenarioPlan(CertifiedPlan):
    """The common schedule, the recourse of every scenario, and what both are worth.

    What every plan has is documented in `records.CertifiedPlan`; `tables` is the schedule of the
    common slots, and in it `staying` the probability of being in the common schedule still.

    Attributes:
        algorithm: how it was found, in words.
        risk: the objective over scenarios, in words.
        statistics: what happens over the scenarios.
        worth: what planning so, and what knowing more, is worth.
        scenarios: number of scenarios.
        different: number of different ones among them.
        seed: of the draw; None where nothing was drawn.
        process: what the scenarios were drawn from, in words.
        common_slots: length of the common schedule, slots.
        half_left_at: when the probability of still following it first is below a half, ISO 8601;
            None where that never is.
        bands: see `BANDS`, tables over all slots.
        episodes: (scenarios,) arrays: probability, leaves_slot, cost, operating_cost,
            terminal_credit, shed_mwh, end_energy_mwh, clairvoyant_cost.
        recourse: names of the devices, and the power they feed in, (devices, slots, scenarios)
            MW, as `table_units()["power"]`.
        outages: the scenarios; None where they were not kept.
        unreduced: what the common schedule costs over all scenarios that these few stand for; None
            where they stand for themselves.
    """

    summary_keys: ClassVar[tuple[str, ...]] = (
        "name",
        "method",
        "physics",
        "algorithm",
        "status",
        "risk",
        "objective",
        "expected_cost",
        "cvar_95_cost",
        "worst_cost",
        "bound",
        "gap",
        "bound_of",
        "clairvoyant_cost",
        "mean_value_cost",
        "value_of_stochastic_solution",
        "value_of_perfect_information",
        "expected_operating_cost",
        "expected_terminal_credit",
        "expected_shed_mwh",
        "shed_probability",
        "scenarios",
        "different",
        "seed",
        "process",
        "common_slots",
        "half_left_at",
        "relaxed",
        "notes",
        "not_modelled",
        "audit",
        "audit_worst",
        "start",
        "step_min",
        "seconds",
        "seconds_by_phase",
    )

    algorithm: str
    risk: str
    statistics: ScenarioStatistics
    worth: InformationValue
    scenarios: int
    different: int
    seed: int | None
    process: str
    common_slots: int
    half_left_at: str | None
    bands: Mapping[str, SlotTable] = field(repr=False)
    episodes: Mapping[str, Floats] = field(repr=False)
    recourse: tuple[tuple[str, ...], Floats] = field(repr=False, compare=False)
    outages: Scenarios | None = field(repr=False, compare=False)
    unreduced: Unreduced | None = None

    def summary(self) -> dict[str, Any]:
        """Everything but the tables, as plain data; `unreduced` only where there is something."""
        summary = super().summary()
        return (
            summary if self.unreduced is None else summary | {"unreduced": asdict(self.unreduced)}
        )

    @property
    def represented(self) -> int | None:
        """Number of scenarios that these few stand for; None where they stand for themselves."""
        many = None if self.outages is None else self.outages.represents
        return None if many is None else many.n

    def check_objective(self, scale: float) -> None:
        """See `CertifiedPlan.check_objective`: the risk of the costs of its scenarios, none of
        which is below what it costs with its outages known.
        """
        cost, probability = (np.asarray(self.episodes[key]) for key in ("cost", "probability"))
        expected = float(probability @ cost)
        room = gate.rounding(expected, scale)
        gate.check_costs(self.expected_cost, {"scenarios": expected}, scale)
        parts = self.expected_operating_cost, -self.expected_terminal_credit
        gate.check_costs(expected, dict(zip(("operating", "credit"), parts, strict=True)), scale)
        averse = self.risk != str(Risk())
        within = expected - room <= self.objective <= float(cost.max()) + room
        if not (within if averse else abs(self.objective - expected) <= room):
            raise CertificateError(
                f"the objective is {self.objective:.9g} $, but {self.risk} over its scenarios is "
                f"not: they cost {expected:.9g} $ on average, {cost.max():.9g} $ at most",
                hint=gate.HINT,
            )
        clairvoyant = np.asarray(self.episodes.get("clairvoyant_cost", np.full(len(cost), -np.inf)))
        for with_hindsight, spent in [
            (self.clairvoyant_cost, self.objective),
            *zip(clairvoyant.tolist(), cost.tolist(), strict=True),
        ]:
            gate.gap(spent, with_hindsight, scale)
        gate.check_costs(
            self.value_of_perfect_information,
            {"objective": self.objective, "clairvoyant": -self.clairvoyant_cost},
            max(scale, abs(self.objective)),
        )

    @property
    def bound(self) -> float:
        """Proven lower bound on the objective, $; -inf where there is none."""
        bound = self.certificate.bound
        return -math.inf if bound is None else bound

    @property
    def gap(self) -> float:
        """(objective - bound) / |objective|; inf without a bound."""
        gap = self.certificate.gap
        return math.inf if gap is None else gap

    @property
    def expected_operating_cost(self) -> float:
        """Mean by probability, $."""
        return self.totals.operating_cost

    @property
    def expected_terminal_credit(self) -> float:
        """Mean worth of the energy left at the end, $."""
        return self.totals.terminal_credit

    @property
    def expected_cost(self) -> float:
        """Mean of operating cost less terminal credit, $."""
        return self.statistics.expected_cost

    @property
    def cvar_95_cost(self) -> float:
        """Mean cost of the worst 5 % of the scenarios, $."""
        return self.statistics.cvar_95_cost

    @property
    def worst_cost(self) -> float:
        """Cost of the dearest scenario, $."""
        return self.statistics.worst_cost

    @property
    def expected_shed_mwh(self) -> float:
        """Mean energy not served, MWh."""
        return self.statistics.expected_shed_mwh

    @property
    def shed_probability(self) -> float:
        """Probability of shedding anything at all."""
        return self.statistics.shed_probability

    @property
    def effective_scenarios(self) -> float:
        """How many equally likely scenarios the weighted ones are worth."""
        return effective_number(self.episodes["probability"])

    @property
    def clairvoyant_cost(self) -> float:
        """Risk of the costs if every scenario were known beforehand, $."""
        return self.worth.clairvoyant_cost

    @property
    def mean_value_cost(self) -> float | None:
        """Risk of the costs with the plan for mean data, $; None where undefined."""
        return self.worth.mean_value_cost

    @property
    def value_of_stochastic_solution(self) -> float | None:
        """What the plan for the mean costs more, $; None where undefined."""
        return self.worth.value_of_stochastic_solution

    @property
    def value_of_perfect_information(self) -> float:
        """What knowing the scenario beforehand would save, $."""
        return self.worth.value_of_perfect_information

    def times(self, slots: int) -> list[datetime]:
        """Start of each of the first slots."""
        return self.horizon.times(slots)

    def frame(self, name: str) -> pd.DataFrame:
        """A table of the common schedule, or `band_energy`, `band_shed`, `scenarios`, `recourse`.

        Raises:
            UsageError: the plan has no such table.
        """
        import pandas as pd

        if name == "scenarios":
            rows = pd.DataFrame(dict(self.episodes))
            return rows.rename_axis("scenario")
        if name == "recourse":
            return self._recourse_frame()
        tables = {**self.tables, **{f"band_{k}": table for k, table in self.bands.items()}}
        if name not in tables:
            raise UsageError(
                f"the plan has no table {name!r}; it has {', '.join(tables)}, scenarios, recourse",
                hint="voltages need lindistflow",
            )
        return self.horizon.frame(tables[name])

    def _recourse_frame(self) -> pd.DataFrame:
        import pandas as pd

        labels, power = self.recourse
        _, slots, n = power.shape
        index = pd.MultiIndex.from_product(
            [range(n), self.times(slots)], names=["scenario", "time"]
        )
        flat = power.transpose(2, 1, 0).reshape(n * slots, len(labels))
        return pd.DataFrame(flat, index=index, columns=list(labels))

    def save(self, folder: str | Path) -> Path:
        """Writes the plan; an earlier one over scenarios is replaced, anything else is refused.

        Raises:
            UsageError: the folder holds something that is no earlier plan over scenarios.
            FileError: the system refuses, as where a disk is full.
        """
        names = (*self.tables, *(f"band_{k}" for k in self.bands), "scenarios")
        with replacing(Path(folder), SCENARIO_PLAN) as target:
            frames = {name: self.frame(name) for name in names}
            write_plan(target, SCENARIO_PLAN, self.summary(), self.case, frames, FILES)
            if self.outages is not None:
                self.outages.save(target / SCENARIOS_FILE)
            self.frame("recourse").to_parquet(target / "recourse.parquet")
        return Path(folder)
