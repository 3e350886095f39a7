"""What a solve returns: a plan with its certificate, tables to compute with, and files.

A saved plan is a folder that appears whole or not at all:

    summary.json   status, costs, bound, audit, ...: what `--json` prints
    case.toml      the case as solved; loads back
    NAME.parquet, NAME.csv   one table per quantity, a row per slot, a column per device or bus
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resilience.arrays import Floats
from resilience.errors import UsageError

if TYPE_CHECKING:
    import pandas as pd

    from resilience.case import Case

UNITS = {
    "power": "MW fed in; storage: discharging positive; load: negative",
    "reactive": "Mvar fed in",
    "energy": "MWh stored at the end of the slot",
    "soc": "share of the capacity stored at the end of the slot",
    "demand": "MW",
    "shed": "MW",
    "pv_available": "MW",
    "voltage": "pu",
    "line_power": "MW at the sending end",
    "line_reactive": "Mvar at the sending end",
    "line_closed": "1 where the line can carry power",
    "island": "number of the island a bus belongs to; 0 is dead",
    "on": "1 where a generator runs",
    "variables": "every variable of the model, as `ess.charge[ess1]`, in its own unit",
}
"""Every table that a plan may have, and what it holds."""


@dataclass(frozen=True)
class Table:
    """Values (columns, slots) of one quantity, a label per column."""

    labels: tuple[str, ...]
    values: Floats

    def __getitem__(self, label: str) -> Floats:
        """(slots,) the values of one label."""
        return self.values[self.labels.index(label)]


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
    tables: Mapping[str, Table] = field(default_factory=dict, repr=False)
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


def outage_texts(case: Case) -> list[str]:
    """`6-26@14:00-17:30`, as `--outages` takes it, for every outage of the case."""
    window = case.window

    def end(slot: int) -> str:
        text = window.text(window.time(slot))
        if not text.endswith("00:00"):
            return text
        return window.label(slot - 1)[: -len("00:00")] + "24:00"

    return [f"{o.line}@{window.label(o.first)}-{end(o.stop)}" for o in case.outages]


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
            tables[name] = Table(tuple(frame.columns), np.asarray(frame.to_numpy().T, float))
    case = None
    if (root / "case.toml").is_file():
        from resilience.case import load_case

        case = load_case(root / "case.toml")
    return Plan(**summary, tables=tables, case=case)


def check_replaceable(folder: Path, mark: str, keep: str = "") -> list[str]:
    """Names of what is in a folder that `replacing` may replace.

    Raises:
        UsageError: it is a file, or holds something that is no earlier result.
    """
    if folder.exists() and not folder.is_dir():
        raise UsageError(f"{folder} is a file", hint="name a folder")
    there = [path.name for path in folder.iterdir()] if folder.is_dir() else []
    if set(there) - {keep} and mark not in there:
        raise UsageError(
            f"{folder} is not empty and holds no earlier result", hint="name a new folder"
        )
    return there


@contextmanager
def replacing(folder: Path, mark: str, keep: str = "") -> Iterator[Path]:
    """A new folder that takes the place of `folder` when the block ends well.

    An existing folder is replaced only if it is empty or holds the file `mark`; its sub-folder
    `keep` does not count, and moves on to the new one.
    """
    there = check_replaceable(folder, mark, keep)
    folder.parent.mkdir(parents=True, exist_ok=True)
    fresh = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    try:
        yield fresh
        fresh.chmod(0o755)
        if folder.exists():
            old = Path(tempfile.mkdtemp(prefix=f".{folder.name}-old-", dir=folder.parent))
            os.replace(folder, old / "was")
            os.replace(fresh, folder)
            if keep and keep in there:
                os.replace(old / "was" / keep, folder / keep)
            shutil.rmtree(old)
        else:
            os.replace(fresh, folder)
    except BaseException:
        shutil.rmtree(fresh, ignore_errors=True)
        raise


@contextmanager
def replacing_file(path: Path) -> Iterator[Path]:
    """A new file, called as `path`, that takes its place when the block ends well."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".new-", dir=path.parent) as folder:
        fresh = Path(folder) / path.name
        yield fresh
        os.replace(fresh, path)


__all__ = ["UNITS", "Plan", "Table", "load_plan", "outage_texts", "replacing", "replacing_file"]
