"""Folders of saved plans: what stands in every one of them, written and read again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

from pydantic import Field, TypeAdapter

from resilience.inputs import checked_path
from resilience.planning.records import Certificate, Horizon
from resilience.planning.tables import SlotTable, table_units
from resilience.results import SUMMARY_FILE, ResultKind, write_readme, write_summary

if TYPE_CHECKING:
    import pandas as pd
    from _typeshed import DataclassInstance

    from resilience.case import Case

Record = TypeVar("Record", bound="DataclassInstance")

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
"""In a summary: no text, and none that JSON cannot hold."""
COMMON_KINDS: dict[str, Any] = {
    "name": str,
    "method": str,
    "physics": Literal["copperplate", "lindistflow", "distflow"],
    "objective": Number,
    "notes": list[str],
    "not_modelled": list[str],
    "start": datetime,
    "step_min": Number,
    "seconds_by_phase": dict[str, Number],
    "relaxed": list[str],
    "audit": dict[str, Number],
    "audit_worst": str,
}
"""What stands in the summary of every plan."""


def check_kinds(summary: Mapping[str, Any], kinds: Mapping[str, Any]) -> None:
    """Refuses a summary in which something is of another kind than was written.

    Args:
        summary: as it was read.
        kinds: of values by key, beside `COMMON_KINDS`.

    Raises:
        KeyError, ValidationError: something is.
    """
    for key, kind in (COMMON_KINDS | {**kinds}).items():
        TypeAdapter(kind).validate_python(summary[key])


def read_record(record: type[Record], summary: Mapping[str, Any]) -> Record:
    """The part of a plan that is a record of a kind, from what `summary` of the plan gave."""
    return record(**{key.name: summary[key.name] for key in fields(record) if key.name in summary})


def common_fields(summary: Mapping[str, Any]) -> dict[str, Any]:
    """What every plan is made of, but for its numbers and tables, from its summary."""
    names = "name", "method", "physics", "notes", "not_modelled", "seconds_by_phase"
    return {
        **{name: summary[name] for name in names},
        "certificate": read_record(Certificate, summary),
        "horizon": Horizon(summary["start"], summary["step_min"]),
    }


def write_plan(
    target: Path,
    kind: ResultKind,
    summary: Mapping[str, Any],
    case: Case | None,
    frames: Mapping[str, pd.DataFrame],
    more: Mapping[str, str],
) -> None:
    """Writes what every plan's folder holds.

    Args:
        target: the folder.
        kind: of the plan.
        summary: what stands in `summary.json`.
        case: the case as solved, if it is known.
        frames: tables by name, written as .parquet and .csv.
        more: what other tables and files hold than those of `table_units`, by name.
    """
    write_summary(target, kind, summary)
    write_readme(target, kind, _meanings(frames, case, more))
    if case is not None:
        from resilience.case import case_text

        (target / "case.toml").write_text(case_text(case), encoding="utf-8")
    for name, frame in frames.items():
        frame.to_parquet(target / f"{name}.parquet")
        frame.to_csv(target / f"{name}.csv", float_format="%.9g")


def _meanings(
    frames: Mapping[str, pd.DataFrame], case: Case | None, more: Mapping[str, str]
) -> dict[str, str]:
    """File to what it holds."""
    units = table_units() | {**more}
    files = {SUMMARY_FILE: "status, costs in $, proven bound and audit: what `--json` prints"}
    if case is not None:
        files["case.toml"] = "the case as it was solved; it loads back"
    tables = {f"{name}.csv, {name}.parquet": units[name] for name in frames if name in units}
    others = {name: meaning for name, meaning in more.items() if name not in frames}
    return files | tables | others


HAS_GAPS = ("voltage", "bus_price")
"""Tables with nothing where buses are dead."""


def read_tables(folder: Path, names: Mapping[str, str]) -> dict[str, SlotTable]:
    """The tables that a plan's folder holds.

    Args:
        folder: where `write_plan` wrote them.
        names: name of a table to that of its file; those without a file are left out.

    Raises:
        ValueError: a table is none: labels twice, or no numbers where there should be.
    """
    import numpy as np
    import pandas as pd

    tables = {}
    for name, stem in names.items():
        path = folder / f"{stem}.parquet"
        if path.is_file():
            frame = pd.read_parquet(checked_path(path))
            values = np.asarray(frame.to_numpy().T, float)
            has_gaps = np.isnan(values).any() and name not in HAS_GAPS
            if has_gaps or np.isinf(values).any() or not frame.columns.is_unique:
                raise ValueError(f"{path.name} has labels twice, or cells that are no numbers")
            tables[name] = SlotTable(tuple(map(str, frame.columns)), values)
    return tables
