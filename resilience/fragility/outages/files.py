"""Reading scenarios from .npz and .csv files; `scenarios.py` says what is in them.

A CSV file made elsewhere need not have the column weight: all scenarios are equally likely then.
"""

from __future__ import annotations

import csv
import json
import math
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from resilience.arrays import Floats
from resilience.errors import CaseError, Mistake, UsageError
from resilience.fragility.outages.scenarios import COLUMNS, Scenarios, check_suffix

if TYPE_CHECKING:
    from resilience.case import Case

MAX_SCENARIOS = 1_000_000  # beyond, a number is a slip
HINTS = {
    "scenario": "scenarios count from 0",
    "first": "slots count from 0",
    "stop": "stop is the first slot in which the line is back",
    "weight": "leave it out where all scenarios are equally likely",
}


def load_scenarios(path: str | Path, case: Case) -> Scenarios:
    """Reads what `Scenarios.save` wrote, or a CSV file made elsewhere.

    Raises:
        CaseError: rows of a CSV file with mistakes; all of them are listed.
        UsageError: the file does not exist, cannot be read, or does not fit the case.
    """
    path = Path(path)
    check_suffix(path)
    if not path.is_file():
        raise UsageError(
            f"scenario file {path} does not exist", hint="`resilience scenarios CASE` writes one"
        )
    if path.suffix == ".csv":
        return _CSV(path, case).scenarios()
    scenarios = _read_npz(path)
    unknown = [line for line in scenarios.lines if not case.network.has_line(line)]
    if unknown:
        raise UsageError(
            f"{path.name}: line {unknown[0]!r} is not in case {case.name!r}",
            hint=case.network.line_hint(unknown[0]),
        )
    if scenarios.slots != case.slots:
        raise UsageError(
            f"{path.name}: scenarios of {scenarios.slots} slots; "
            f"allowed: {case.slots}, as the case",
            hint="draw them again for this horizon",
        )
    return scenarios


def _read_npz(path: Path) -> Scenarios:
    """Reads a .npz file; see `scenarios.py` for what is in it."""
    try:
        with np.load(path) as file:
            about = json.loads(str(file["about"]))
            shape = tuple(file["shape"])
            down = np.unpackbits(file["down"], count=int(np.prod(shape))).reshape(shape)
            centre = file.get("centre", None)
            probability: Floats = file["probability"]
    except (zipfile.BadZipFile, EOFError, KeyError, ValueError) as error:
        raise UsageError(
            f"{path.name} holds no scenarios", hint="`resilience scenarios CASE` writes such files"
        ) from error
    lines, seed, process = tuple(about["lines"]), about["seed"], about["process"]
    return Scenarios(lines, down.astype(bool), probability, centre, seed, process)


class _CSV:
    """One CSV file being read; `mistakes` gathers its mistakes."""

    def __init__(self, path: Path, case: Case) -> None:
        self.path, self.case = path, case
        self.mistakes: list[Mistake] = []
        self.events: list[tuple[int, str, int, int]] = []
        self.weights: dict[int, float] = {}
        self.highest = -1

    def scenarios(self) -> Scenarios:
        """Reads every row, then makes the arrays."""
        with self.path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file)
            columns = reader.fieldnames or ()
            missing = [c for c in COLUMNS if c not in columns]
            for row in () if missing else reader:
                values = {key: (row.get(key) or "").strip() for key in (*COLUMNS, "weight")}
                self.read(f"row {reader.line_num}", values)
        if missing:
            heading = ", ".join(columns) or "no columns"
            hint = "the first row of the file names the columns"
            self.wrong("header", missing[0], heading, ", ".join(COLUMNS), hint)
        elif self.highest < 0 and not self.mistakes:
            self.wrong("rows", "", "none", "a row per outage", "0,,, is a scenario without outage")
        if self.mistakes:
            raise CaseError(self.mistakes)
        return self.arrays()

    def read(self, where: str, row: dict[str, str]) -> None:
        """Takes one row, or says what is wrong with it."""
        before, slots = len(self.mistakes), self.case.slots
        scenario = self.whole_number(where, "scenario", row, (0, MAX_SCENARIOS))
        self.weigh(where, scenario, row["weight"])
        if any(row[key] for key in ("line", "first", "stop")):
            first = self.whole_number(where, "first", row, (0, slots - 1))
            stop = self.whole_number(where, "stop", row, (first + 1, slots))
            line = row["line"]
            if not self.case.network.has_line(line):
                hint = self.case.network.line_hint(line)
                self.wrong(where, "line", repr(line), "a line of the network", hint)
            if len(self.mistakes) == before:
                self.events.append((scenario, line, first, stop))
        self.highest = max(self.highest, scenario)

    def whole_number(self, where: str, key: str, row: dict[str, str], span: tuple[int, int]) -> int:
        """The number under `key`; the lowest allowed where it is wrong."""
        low, high = span
        text = row[key]
        if text.isascii() and text.isdigit() and low <= int(text) <= high:
            return int(text)
        self.wrong(where, key, repr(text), f"a whole number, {low} to {high}", HINTS[key])
        return low

    def weigh(self, where: str, scenario: int, text: str) -> None:
        """Takes the weight of a scenario, 1 where there is none."""
        try:
            weight = float(text or 1.0)
        except ValueError:
            weight = -1.0
        if not 0.0 <= weight < math.inf:
            self.wrong(where, "weight", repr(text), "a number, 0 or more", HINTS["weight"])
        elif self.weights.setdefault(scenario, weight) != weight:
            allowed = f"{self.weights[scenario]:g}, as in an earlier row of scenario {scenario}"
            self.wrong(where, "weight", repr(text), allowed, "a scenario has one weight")

    def wrong(self, where: str, key: str, value: str, allowed: str, hint: str) -> None:
        """Notes a mistake."""
        self.mistakes.append(Mistake(str(self.path), where, key, value, allowed, hint))

    def arrays(self) -> Scenarios:
        """Scenarios of the rows read; weights are divided by their sum."""
        failed = {line for _, line, _, _ in self.events}
        lines = tuple(line for line in self.case.network.line_names if line in failed)
        down = np.zeros((len(lines), self.case.slots, self.highest + 1), bool)
        for scenario, line, first, stop in self.events:
            down[lines.index(line), first:stop, scenario] = True
        weight = np.array([self.weights.get(k, 1.0) for k in range(self.highest + 1)])
        if not weight.sum():
            raise UsageError(f"{self.path.name}: all weights are 0", hint=HINTS["weight"])
        probability = weight / weight.sum()
        return Scenarios(lines, down, probability, process=f"file {self.path.name}")
