"""Reading scenarios from .npz and .csv files; `scenarios.py` says what is in them.

A CSV file made elsewhere need not have the column weight: all scenarios are equally likely then.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resilience.case.outages import LINE_OR_UNIT, element_hint
from resilience.errors import CaseError, Mistake, UsageError, shortened
from resilience.files import reading
from resilience.fragility.outages.scenarios import COLUMNS, Scenarios, check_suffix
from resilience.inputs import MissingFileError, checked_path, read_table

if TYPE_CHECKING:
    from resilience.case import Case

MAX_SCENARIOS = 1_000_000  # beyond, a number is a slip
MAX_WEIGHT = 1e12
HINTS = {
    "scenario": "scenarios count from 0",
    "first": "slots count from 0",
    "stop": "stop is the first slot in which the line or unit is back",
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
    try:
        file = checked_path(path)
    except MissingFileError:
        raise UsageError(
            f"scenario file {path} does not exist", hint="`resilience scenarios CASE` writes one"
        ) from None
    if path.suffix == ".csv":
        return _CSV(path, case).scenarios()
    scenarios = _read_npz(file)
    unknown = [line for line in scenarios.lines if not _is_element(line, case)]
    if unknown:
        raise UsageError(
            f"{path}: line {shortened(repr(unknown[0]))} is not in case {case.name!r}",
            hint=element_hint(unknown[0], case.network, case.units),
        )
    if scenarios.slots != case.slots:
        raise UsageError(
            f"{path}: scenarios of {scenarios.slots} slots; allowed: {case.slots}, as the case",
            hint="draw them again for this horizon",
        )
    return scenarios


def _is_element(name: str, case: Case) -> bool:
    """Whether a line of the case has this name, or a unit that may be out of order."""
    return case.network.has_line(name) or name in case.units


def _read_npz(path: Path) -> Scenarios:
    """Reads a .npz file; see `scenarios.py` for what is in it."""
    with reading(path, "scenarios"), path.open("rb") as opened, np.load(opened) as file:
        facts = _facts(file, "")
        everything = _facts(file, "all_") if "all_about" in file else None
    try:
        scenarios = Scenarios(*facts)
        if everything is not None:
            scenarios = replace(scenarios, represents=Scenarios(*everything))
        return scenarios
    except UsageError as error:
        raise UsageError(f"{path}: {error.message}", hint=error.hint) from None


def _facts(file: Mapping[str, Any], prefix: str) -> tuple[Any, ...]:
    """The fields of scenarios, from the arrays of a file whose names begin with `prefix`."""
    about = json.loads(str(file[f"{prefix}about"]))
    down, probability = file[f"{prefix}down"], file[f"{prefix}probability"]
    shape = tuple(int(n) for n in file[f"{prefix}shape"])
    centre = file.get(f"{prefix}centre", None)
    _check_kinds(about, shape, down, probability)
    bits = np.unpackbits(down, count=math.prod(shape)).reshape(shape).astype(bool)
    return tuple(about["lines"]), bits, probability, centre, about["seed"], about["process"]


def _check_kinds(
    about: Mapping[str, Any], shape: tuple[int, ...], down: np.ndarray, probability: np.ndarray
) -> None:
    """Refuses arrays and facts that `Scenarios.save` never writes, before they are unpacked.

    Raises:
        ValueError: they are of another kind or size.
    """
    if not (all(isinstance(line, str) for line in about["lines"])):
        raise ValueError("names of lines are text")
    if not isinstance(about["seed"], int | None) or not isinstance(about["process"], str):
        raise ValueError("the seed is a whole number, the process is text")
    if down.dtype != np.uint8 or probability.dtype.kind != "f":
        raise ValueError("outages are packed bits, probabilities are numbers")
    if len(shape) != 3 or min(shape) < 0 or (math.prod(shape) + 7) // 8 != down.size:
        raise ValueError(f"{down.size} bytes of outages of the shape {shape}")


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
        self.table = read_table(self.path, is_padded=True)
        columns = self.table.columns
        missing = [c for c in COLUMNS if c not in columns]
        if not missing:
            for number, row in zip(self.table.numbers, self.table.records(), strict=True):
                self.read(f"row {number}", {key: row.get(key, "") for key in (*COLUMNS, "weight")})
        if missing:
            heading = shortened(", ".join(columns)) or "no columns"
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
            if not _is_element(line, self.case):
                hint = element_hint(line, self.case.network, self.case.units)
                self.wrong(where, "line", shortened(repr(line)), LINE_OR_UNIT, hint)
            if len(self.mistakes) == before:
                self.events.append((scenario, line, first, stop))
        self.highest = max(self.highest, scenario)

    def whole_number(self, where: str, key: str, row: dict[str, str], span: tuple[int, int]) -> int:
        """The number under `key`; the lowest allowed where it is wrong."""
        low, high = span
        text = row[key]
        if text.isascii() and text.isdigit() and len(text) < 20 and low <= int(text) <= high:
            return int(text)
        self.wrong(
            where, key, shortened(repr(text)), f"a whole number, {low} to {high}", HINTS[key]
        )
        return low

    def weigh(self, where: str, scenario: int, text: str) -> None:
        """Takes the weight of a scenario, 1 where there is none."""
        stated = self.table.number(text or "1")
        weight = -1.0 if stated is None else stated
        if not 0.0 <= weight <= MAX_WEIGHT:
            self.wrong(
                where, "weight", shortened(repr(text)), "a number, 0 or more", HINTS["weight"]
            )
        elif self.weights.setdefault(scenario, weight) != weight:
            allowed = f"{self.weights[scenario]:g}, as in an earlier row of scenario {scenario}"
            self.wrong(where, "weight", shortened(repr(text)), allowed, "a scenario has one weight")

    def wrong(self, where: str, key: str, value: str, allowed: str, hint: str) -> None:
        """Notes a mistake."""
        self.mistakes.append(Mistake(str(self.path), where, key, value, allowed, hint))

    def arrays(self) -> Scenarios:
        """Scenarios of the rows read; weights are divided by their sum."""
        failed = {line for _, line, _, _ in self.events}
        names = dict.fromkeys([*self.case.network.line_names, *self.case.units])
        lines = tuple(name for name in names if name in failed)
        down = np.zeros((len(lines), self.case.slots, self.highest + 1), bool)
        for scenario, line, first, stop in self.events:
            down[lines.index(line), first:stop, scenario] = True
        weight = np.array([self.weights.get(k, 1.0) for k in range(self.highest + 1)])
        if not weight.sum():
            raise UsageError(f"{self.path}: all weights are 0", hint=HINTS["weight"])
        probability = weight / weight.sum()
        return Scenarios(lines, down, probability, process=f"file {self.path.name}")
