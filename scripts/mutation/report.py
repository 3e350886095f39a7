"""What is kept of every mutant, which ones change nothing, and what is printed in the end."""

from __future__ import annotations

import json
import tomllib
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scripts.mutation.mutants import Mutant
from scripts.mutation.server import Outcome

EQUIVALENT = Path(__file__).with_name("equivalent.toml")
"""Mutants that change nothing, or nothing that a test could see, each with its reason."""


@dataclass(frozen=True)
class Verdict:
    """What is kept of a mutant: one line of the file of results.

    Attributes:
        key: `Mutant.key`.
        kind: random or aimed.
        file: the module.
        line: where the fault is.
        source: the lines concerned.
        faulty: the same lines with the fault.
        status: killed, timeout, survived, unexecuted (no test comes by), or equivalent.
        tests: how many were run at most.
        candidates: how many execute the line.
        seconds: that the trial took.
        reason: which test failed, or why a mutant is equivalent.
    """

    key: str
    kind: str
    file: str
    line: int
    source: str
    faulty: str
    status: str
    tests: int = 0
    candidates: int = 0
    seconds: float = 0.0
    reason: str = ""

    @classmethod
    def of(cls, mutant: Mutant, status: str, **more: Any) -> Verdict:
        place = (mutant.key, mutant.kind, mutant.file, mutant.line, mutant.source, mutant.faulty)
        return cls(*place, status, **more)

    @classmethod
    def of_outcome(cls, mutant: Mutant, outcome: Outcome) -> Verdict:
        failed = [line for line in outcome.log.splitlines() if line.startswith(("FAILED", "ERROR"))]
        return cls.of(
            mutant,
            outcome.status,
            tests=len(outcome.trial.tests),
            candidates=outcome.trial.candidates,
            seconds=round(outcome.seconds, 1),
            reason=failed[0] if failed else "",
        )

    @property
    def lives(self) -> bool:
        """Whether no test noticed it."""
        return self.status in ("survived", "unexecuted")

    def line_of_json(self) -> str:
        """What `read_verdicts` reads."""
        return json.dumps(vars(self), ensure_ascii=False) + "\n"

    def difference(self) -> str:
        """Where the fault is, and what it is."""
        head = f"{self.file}:{self.line} {self.status} [{self.tests}/{self.candidates} tests]"
        return f"{head}\n  - {self.source}\n  + {self.faulty}"


def read_verdicts(path: Path) -> dict[str, Verdict]:
    """The verdicts of a file of results, by key; none where there is no file."""
    if not path.is_file():
        return {}
    lines = path.read_text(encoding="utf-8").splitlines()
    verdicts = [Verdict(**json.loads(line)) for line in lines]
    return {verdict.key: verdict for verdict in verdicts}


def equivalents(path: Path = EQUIVALENT) -> dict[str, str]:
    """The reasons of the mutants that change nothing, by key."""
    entries = tomllib.loads(path.read_text(encoding="utf-8")).get("mutant", [])
    return {
        f"{entry['file']}: {entry['source']} -> {entry['faulty']}": entry["reason"]
        for entry in entries
    }


def table(verdicts: Iterable[Verdict]) -> str:
    """Killed of those that change anything, for every module and in all."""
    counts: dict[str, Counter[str]] = {}
    for verdict in verdicts:
        for row in (verdict.file.removeprefix("resilience/"), "all"):
            counts.setdefault(row, Counter())[verdict.status] += 1
    rows = [f"{'module':44} {'killed':>9} {'rate':>5}  not executed  equivalent"]
    for row in sorted(counts, key=lambda name: (name == "all", name)):
        count = counts[row]
        killed = count["killed"] + count["timeout"]
        total = killed + count["survived"] + count["unexecuted"]
        rate = f"{killed / total:5.0%}" if total else "    -"
        share = f"{killed}/{total}"
        rows.append(
            f"{row:44} {share:>9} {rate}  {count['unexecuted']:12}  {count['equivalent']:10}"
        )
    return "\n".join(rows)
