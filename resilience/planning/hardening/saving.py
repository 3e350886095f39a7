"""A saved choice of what to build: a folder that appears whole or not at all; see `TABLES`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from resilience.case import Case
from resilience.case.write import case_text
from resilience.results import HARDENING, SUMMARY_FILE, replacing, write_readme, write_summary

if TYPE_CHECKING:
    import pandas as pd

SUMS = "a row per set of what is built (nothing, plan, greedy, naive, all)"
TABLES = {
    "options": "a row per option: line and factor, or site, kind and bus of a unit; cost in $, "
    "life_years; fails, the probability that the line is down in a storm as it is; what it saves "
    "alone and beside the plan, in $ a storm, or $ a year where storms come per year; chosen",
    "sets": f"{SUMS}, on storms that the plan has not seen: options built, means of cost in $, "
    "shed_mwh, critical_mwh, critical_h, customer_h, each with its standard error, cvar in $, "
    "and the saving; customer_h: hours without supply of a customer, empty where no load says "
    "how many it has",
    "by_storm": "a row per storm of the catalogue: its share, how many per_year, and $ of one, on "
    "average, with every set built, on storms that the plan has not seen",
    "frontier": "a row per budget in $: spent in $, value and bound of the objective, and what is "
    "built",
    "yearly": f"{SUMS}, in $ a year, on storms that the plan has not seen: what is built, storms, "
    "and what is saved net, with its standard error",
    "draws": "a row per set and storm that was drawn: sample (plan, or new for those that it has "
    "not seen), which storm of the catalogue, probability, cost in $, shed_mwh, critical_mwh, "
    "critical_h, customer_h",
}
"""What is in every table."""


def write_hardening(
    folder: Path, case: Case, tables: Mapping[str, pd.DataFrame], summary: dict[str, Any]
) -> Path:
    """Writes summary.json, a README, the case, and every table as .csv and .parquet.

    Args:
        folder: where to; an earlier one is replaced.
        case: in the steps that were planned for.
        tables: by a name of `TABLES`.
        summary: plain data.

    Raises:
        UsageError: the folder holds something else.
        FileError: the system refuses, as where a disk is full.
    """
    files = {
        SUMMARY_FILE: "what `--json` prints",
        "case.toml": "the case, in the steps planned for",
    }
    files |= {f"{name}.csv, {name}.parquet": TABLES[name] for name in tables}
    with replacing(folder, HARDENING) as target:
        for name, table in tables.items():
            table.to_csv(target / f"{name}.csv")
            table.to_parquet(target / f"{name}.parquet")
        (target / "case.toml").write_text(case_text(case), encoding="utf-8")
        write_readme(target, HARDENING, files)
        write_summary(target, HARDENING, summary)
    return folder
