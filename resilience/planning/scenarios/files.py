"""Saved plans over scenarios, read again."""

from __future__ import annotations

import json
from datetime import datetime
from pathlib import Path
from typing import Any

from resilience.case import Case
from resilience.errors import UsageError
from resilience.files import reading
from resilience.fragility.outages.scenarios import Scenarios
from resilience.models.program.gate import of_file
from resilience.planning.files import Number, check_kinds, common_fields, read_record, read_tables
from resilience.planning.records import Costs
from resilience.planning.scenarios.plan import BANDS, SCENARIOS_FILE, ScenarioPlan
from resilience.planning.scenarios.records import InformationValue, ScenarioStatistics, Unreduced
from resilience.planning.tables import table_units
from resilience.results import SUMMARY_FILE, steady


def holds_scenario_plan(folder: str | Path) -> bool:
    """Whether `ScenarioPlan.save` wrote this folder."""
    path = Path(folder) / SUMMARY_FILE
    if not path.is_file():
        return False
    with reading(path, "summary of a plan"):
        return "common_slots" in json.loads(path.read_text(encoding="utf-8"))


def load_scenario_plan(folder: str | Path) -> ScenarioPlan:
    """Reads a plan that `ScenarioPlan.save` wrote.

    Raises:
        UsageError: the folder holds no such plan, or a damaged one.
        CertificateError: its numbers contradict each other or its tables.
    """
    root = Path(folder)
    with steady(root):
        return _load_scenario_plan(root)


def _load_scenario_plan(root: Path) -> ScenarioPlan:
    from resilience.case import load_case
    from resilience.fragility.outages.files import load_scenarios

    if not holds_scenario_plan(root):
        raise UsageError(
            f"{root} holds no plan over scenarios",
            hint="`resilience solve CASE --method stochastic --out FOLDER` writes one",
        )
    summary = json.loads((root / SUMMARY_FILE).read_text(encoding="utf-8"))
    summary.setdefault("not_modelled", [])  # earlier versions did not say it
    case = load_case(root / "case.toml")
    outages = load_scenarios(root / SCENARIOS_FILE, case)
    with reading(root, "plan over scenarios"), of_file(root):
        return _read_plan(root, summary, case, outages)


KINDS: dict[str, Any] = {
    "expected_operating_cost": Number,
    "expected_terminal_credit": Number,
    "algorithm": str,
    "risk": str,
    "scenarios": int,
    "different": int,
    "seed": int | None,
    "process": str,
    "common_slots": int,
    "half_left_at": datetime | None,
}
"""What stands in `summary.json` beside what every plan has."""


def _read_plan(root: Path, summary: dict[str, Any], case: Case, outages: Scenarios) -> ScenarioPlan:
    import pandas as pd

    check_kinds(summary, KINDS)
    episodes = pd.read_parquet(root / "scenarios.parquet")
    power = pd.read_parquet(root / "recourse.parquet")
    shape = (len(episodes), len(power) // max(len(episodes), 1), power.shape[1])
    return ScenarioPlan(
        **common_fields(summary),
        totals=Costs(
            objective=summary["objective"],
            operating_cost=summary["expected_operating_cost"],
            terminal_credit=summary["expected_terminal_credit"],
        ),
        tables=read_tables(root, {name: name for name in (*table_units(), "staying")}),
        case=case,
        algorithm=summary["algorithm"],
        risk=summary["risk"],
        statistics=read_record(ScenarioStatistics, summary),
        worth=read_record(InformationValue, summary),
        scenarios=summary["scenarios"],
        different=summary["different"],
        seed=summary["seed"],
        process=summary["process"],
        common_slots=summary["common_slots"],
        half_left_at=summary["half_left_at"],
        bands=read_tables(root, {name: f"band_{name}" for name in BANDS}),
        episodes={str(name): episodes[name].to_numpy() for name in episodes},
        recourse=(tuple(power.columns), power.to_numpy().reshape(shape).transpose(2, 1, 0)),
        outages=outages,
        unreduced=Unreduced(**summary["unreduced"]) if "unreduced" in summary else None,
    )
