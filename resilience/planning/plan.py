"""What a solve returns: a plan with its certificate, tables to compute with, and files.

A saved plan is a folder that appears whole or not at all:

    summary.json   status, costs, bound, audit, ...: what `--json` prints
    case.toml      the case as solved; loads back
    NAME.parquet, NAME.csv   one table per quantity, a row per slot, a column per device or bus
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resilience.errors import UsageError
from resilience.files import replacing
from resilience.planning.tables import UNITS, SlotTable

if TYPE_CHECKING:
    import pandas as pd

    from resilience.case import Case


@dataclass(frozen=True)
class Plan:
    """A dispatch plan, its certificate, and where its costs and its shedding come from.

    Attributes:
        objective: operating cost less terminal credit, $.
        bound: proven lower bound on the objective, $; None where there is none.
        gap: (objective - bound) / |objective|.
        bound_of: the physics that the bound is valid for.
        relaxed: facts of the model that the plan need not satisfy, in words.
        audit: worst scaled violation per row, bound and structure.
        costs: $ per term.
        energy_mwh: the energy balance.
        shed_by_load: MWh per load, and why it could not be served: {load: {reason: MWh}}.
        outages: the outages assumed, which the plan knows in advance.
        seconds_by_phase: how long each phase took.
        tables: see `UNITS`.
    """

    name: str
    method: str
    physics: str
    status: str
    objective: float
    operating_cost: float
    terminal_credit: float
    bound: float | None
    gap: float | None
    bound_of: str
    relaxed: list[str]
    notes: list[str]
    audit: dict[str, float]
    audit_worst: str
    costs: dict[str, float]
    energy_mwh: dict[str, float]
    shed_mwh: float
    shed_by_load: dict[str, dict[str, float]]
    outages: list[str]
    start: str
    step_min: float
    seconds: float
    seconds_by_phase: dict[str, float]
    tables: Mapping[str, SlotTable] = field(default_factory=dict, repr=False)
    case: Case | None = field(default=None, repr=False, compare=False)

    @property
    def times(self) -> list[datetime]:
        """Start of every slot."""
        slots = next(iter(self.tables.values())).values.shape[1]
        first = datetime.fromisoformat(self.start)
        return [first + timedelta(minutes=self.step_min * t) for t in range(slots)]

    def frame(self, name: str) -> pd.DataFrame:
        """One table as a DataFrame indexed by time; see `UNITS` for names and units.

        Raises:
            UsageError: the plan has no such table.
        """
        import pandas as pd

        if name not in self.tables:
            raise UsageError(
                f"the plan has no table {name!r}; it has {', '.join(self.tables)}",
                hint="voltages and reactive power need lindistflow or distflow",
            )
        table = self.tables[name]
        index = pd.DatetimeIndex(self.times, name="time")
        return pd.DataFrame(table.values.T, index=index, columns=list(table.labels))

    def summary(self) -> dict[str, Any]:
        """Everything but the tables, as plain data."""
        kept = [f.name for f in fields(self) if f.name not in ("tables", "case")]
        return {key: getattr(self, key) for key in kept}

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
            for name in self.tables:
                frame = self.frame(name)
                frame.to_parquet(target / f"{name}.parquet")
                frame.to_csv(target / f"{name}.csv", float_format="%.9g")
        return Path(folder)


def load_plan(folder: str | Path) -> Plan:
    """Reads a plan that `Plan.save` wrote.

    Raises:
        UsageError: the folder holds no plan.
    """
    import pandas as pd

    root = Path(folder)
    if not (root / "summary.json").is_file():
        raise UsageError(
            f"{root} holds no result: there is no summary.json in it",
            hint="name the folder that `solve --out` wrote; a hazard is drawn by `hazard --plot`",
        )
    summary = json.loads((root / "summary.json").read_text(encoding="utf-8"))
    if summary.keys() != {f.name for f in fields(Plan)} - {"tables", "case"}:
        raise UsageError(
            f"{root} holds another kind of result than a plan",
            hint="load_scenario_plan reads plans over scenarios",
        )
    tables = {}
    for name in UNITS:
        if (root / f"{name}.parquet").is_file():
            frame = pd.read_parquet(root / f"{name}.parquet")
            tables[name] = SlotTable(tuple(frame.columns), np.asarray(frame.to_numpy().T, float))
    case = None
    if (root / "case.toml").is_file():
        from resilience.case import load_case

        case = load_case(root / "case.toml")
    return Plan(**summary, tables=tables, case=case)
