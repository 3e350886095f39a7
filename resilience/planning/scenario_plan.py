"""A plan over scenarios: what to do now, until scenarios part, and what follows in each of them.

A saved one is a folder that appears whole or not at all:

    summary.json      costs, bound, values, audit, ...: what `--json` prints
    case.toml         the case as solved; loads back
    outages.npz       the scenarios
    NAME.parquet/csv  the schedule of the common slots, one table per quantity
    band_NAME.*       mean and 5 to 95 % band of stored energy and shedding over all scenarios
    scenarios.*       a row per scenario
    recourse.parquet  power of every device in every slot of every scenario
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resilience.arrays import Floats
from resilience.errors import UsageError
from resilience.files import replacing
from resilience.planning.tables import UNITS, SlotTable

if TYPE_CHECKING:
    import pandas as pd

    from resilience.case import Case
    from resilience.fragility.outages.scenarios import Scenarios

BANDS = {
    "energy": "MWh stored at the end of the slot, all units together",
    "shed": "MW, all loads together",
}
"""What there is a band of over scenarios, by the columns mean, low and high (5 and 95 %)."""
LOW, HIGH = 0.05, 0.95
MARK = "outages.npz"
_DATA = ("tables", "bands", "episodes", "recourse", "outages", "case")


@dataclass(frozen=True)
class ScenarioPlan:
    """The common schedule, the recourse of every scenario, and what both are worth.

    Attributes:
        algorithm: how it was found, in words.
        risk: the objective over scenarios, in words.
        objective: of `risk`, $; costs are operating cost less terminal credit.
        expected_cost, cvar_95_cost, worst_cost: of the scenarios, $.
        bound: proven lower bound on the objective, $.
        gap: (objective - bound) / |objective|.
        bound_of: what the bound is a bound of.
        clairvoyant_cost: `risk` of the costs if every scenario were known beforehand, $.
        mean_value_cost: `risk` of the costs with the plan for mean data, $; None where undefined.
        value_of_stochastic_solution: what the plan for the mean costs more, $.
        value_of_perfect_information: what knowing the scenario beforehand would save, $.
        expected_shed_mwh, shed_probability: of a scenario.
        scenarios, different: number of scenarios, and of different ones among them.
        common_slots: length of the common schedule.
        half_left_at: when the probability of still following it first is below a half.
        relaxed: facts of the model that the plan need not satisfy, in words.
        audit: worst scaled violation per row, bound and structure, over all scenarios.
        tables: the schedule of the common slots; see `tables.UNITS`. `staying` is the
            probability of being in the common schedule still.
        bands: see `BANDS`, tables over all slots.
        episodes: (scenarios,) arrays: probability, leaves_slot, cost, operating_cost,
            terminal_credit, shed_mwh, end_energy_mwh, clairvoyant_cost.
        recourse: power fed in, (devices, slots, scenarios) MW, as `UNITS["power"]`.
    """

    name: str
    method: str
    physics: str
    algorithm: str
    status: str
    risk: str
    objective: float
    expected_cost: float
    cvar_95_cost: float
    worst_cost: float
    bound: float
    gap: float
    bound_of: str
    clairvoyant_cost: float
    mean_value_cost: float | None
    value_of_stochastic_solution: float | None
    value_of_perfect_information: float
    expected_operating_cost: float
    expected_terminal_credit: float
    expected_shed_mwh: float
    shed_probability: float
    scenarios: int
    different: int
    seed: int | None
    process: str
    common_slots: int
    half_left_at: str | None
    relaxed: list[str]
    notes: list[str]
    audit: dict[str, float]
    audit_worst: str
    start: str
    step_min: float
    seconds: float = 0.0
    seconds_by_phase: dict[str, float] = field(default_factory=dict)
    tables: Mapping[str, SlotTable] = field(default_factory=dict, repr=False)
    bands: Mapping[str, SlotTable] = field(default_factory=dict, repr=False)
    episodes: Mapping[str, Floats] = field(default_factory=dict, repr=False)
    recourse: tuple[tuple[str, ...], Floats] = field(
        default=((), np.empty((0, 0, 0))), repr=False, compare=False
    )
    outages: Scenarios | None = field(default=None, repr=False, compare=False)
    case: Case | None = field(default=None, repr=False, compare=False)

    def times(self, slots: int) -> list[datetime]:
        """Start of each of the first slots."""
        first = datetime.fromisoformat(self.start)
        return [first + timedelta(minutes=self.step_min * t) for t in range(slots)]

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
        found = {**self.tables, **{f"band_{k}": table for k, table in self.bands.items()}}
        if name not in found:
            raise UsageError(
                f"the plan has no table {name!r}; it has {', '.join(found)}, scenarios, recourse",
                hint="voltages need lindistflow",
            )
        table = found[name]
        index = pd.DatetimeIndex(self.times(table.values.shape[1]), name="time")
        return pd.DataFrame(table.values.T, index=index, columns=list(table.labels))

    def _recourse_frame(self) -> pd.DataFrame:
        import pandas as pd

        labels, power = self.recourse
        _, slots, n = power.shape
        index = pd.MultiIndex.from_product(
            [range(n), self.times(slots)], names=["scenario", "time"]
        )
        flat = power.transpose(2, 1, 0).reshape(n * slots, len(labels))
        return pd.DataFrame(flat, index=index, columns=list(labels))

    def summary(self) -> dict[str, Any]:
        """Everything but the tables, as plain data."""
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name not in _DATA}

    def save(self, folder: str | Path) -> Path:
        """Writes the plan; an earlier result in the folder is replaced, anything else is refused.

        Raises:
            UsageError: the folder holds something that is no earlier result.
        """
        with replacing(Path(folder), "summary.json") as target:
            text = json.dumps(self.summary(), indent=2, allow_nan=False)
            (target / "summary.json").write_text(text + "\n", encoding="utf-8")
            if self.case is not None:
                from resilience.case import case_text

                (target / "case.toml").write_text(case_text(self.case), encoding="utf-8")
            if self.outages is not None:
                self.outages.save(target / MARK)
            for name in (*self.tables, *(f"band_{k}" for k in self.bands), "scenarios"):
                frame = self.frame(name)
                frame.to_parquet(target / f"{name}.parquet")
                frame.to_csv(target / f"{name}.csv", float_format="%.9g")
            self.frame("recourse").to_parquet(target / "recourse.parquet")
        return Path(folder)


def holds_scenario_plan(folder: str | Path) -> bool:
    """Whether `ScenarioPlan.save` wrote this folder."""
    path = Path(folder) / "summary.json"
    return path.is_file() and "common_slots" in json.loads(path.read_text(encoding="utf-8"))


def load_scenario_plan(folder: str | Path) -> ScenarioPlan:
    """Reads a plan that `ScenarioPlan.save` wrote.

    Raises:
        UsageError: the folder holds no such plan.
    """
    import pandas as pd

    from resilience.case import load_case
    from resilience.fragility.outages.files import load_scenarios

    root = Path(folder)
    if not holds_scenario_plan(root):
        raise UsageError(
            f"{root} holds no plan over scenarios",
            hint="`resilience solve CASE --method stochastic --out FOLDER` writes one",
        )

    def table(name: str) -> SlotTable:
        frame = pd.read_parquet(root / f"{name}.parquet")
        return SlotTable(tuple(frame.columns), np.asarray(frame.to_numpy().T, float))

    def there(names: list[str], prefix: str = "") -> dict[str, SlotTable]:
        return {k: table(prefix + k) for k in names if (root / f"{prefix}{k}.parquet").is_file()}

    case = load_case(root / "case.toml")
    episodes = pd.read_parquet(root / "scenarios.parquet")
    power = pd.read_parquet(root / "recourse.parquet")
    shape = (len(episodes), len(power) // max(len(episodes), 1), power.shape[1])
    return ScenarioPlan(
        **json.loads((root / "summary.json").read_text(encoding="utf-8")),
        tables=there([*UNITS, "staying"]),
        bands=there(list(BANDS), "band_"),
        episodes={str(name): episodes[name].to_numpy() for name in episodes},
        recourse=(tuple(power.columns), power.to_numpy().reshape(shape).transpose(2, 1, 0)),
        outages=load_scenarios(root / MARK, case),
        case=case,
    )
