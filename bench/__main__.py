"""Measures everything and prints one table; exit code 1 if a target is missed.

python -m bench              everything but quality
python -m bench build day    some of it, by the names below
python -m bench quality      how well dispatchers decide, about half an hour
"""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Callable, Iterator
from importlib.metadata import version

from rich.console import Console
from rich.table import Table

from bench.dispatchers import deciding, quality
from bench.ground import ground
from bench.growth import growing
from bench.hazard import hazards
from bench.judging import judging
from bench.learning import learning
from bench.linear import building, resolving
from bench.peer import peers
from bench.plans import day, help_text, main_job
from bench.powerflow import flows
from bench.row import Row
from bench.sddp import training
from bench.simulator import stepping
from bench.stochastic import programs
from bench.trees import trees
from bench.wind import fields

PARTS: dict[str, Callable[[], Iterator[Row]]] = {
    "help": help_text,
    "build": building,
    "resolve": resolving,
    "day": day,
    "main": main_job,
    "growth": growing,
    "flows": flows,
    "simulator": stepping,
    "peer": peers,
    "dispatch": deciding,
    "ground": ground,
    "learning": learning,
    "sddp": training,
    "judging": judging,
    "quality": quality,
    "stochastic": programs,
    "trees": trees,
    "wind": fields,
    "hazard": hazards,
}
ONLY_BY_NAME = ("quality",)
LIBRARIES = (
    "highspy",
    "pyomo",
    "clarabel",
    "casadi",
    "numpy",
    "scipy",
    "power-grid-model",
)


def main(chosen: list[str]) -> int:
    unknown = set(chosen) - set(PARTS)
    if unknown:
        print(f"error: no part {sorted(unknown)}; allowed: {', '.join(PARTS)}", file=sys.stderr)
        return 2
    progress, rows = Console(stderr=True), []
    for name in chosen or [name for name in PARTS if name not in ONLY_BY_NAME]:
        with progress.status(f"measuring: {name}"):
            rows += list(PARTS[name]())
    Console(width=None if sys.stdout.isatty() else 160).print(table(rows))
    return int(any(row.met is False for row in rows))


def table(rows: list[Row]) -> Table:
    printed = Table(caption=machine(), caption_justify="left", title="resilience: speed and memory")
    for heading in ("what", "measured", "target", "met", "note"):
        printed.add_column(heading, justify="right" if heading == "measured" else "left")
    words = {True: "[green]yes[/]", False: "[red]no[/]", None: ""}
    for row in rows:
        printed.add_row(row.name, row.measured, row.target, words[row.met], row.note)
    return printed


def machine() -> str:
    libraries = ", ".join(f"{name} {version(name)}" for name in LIBRARIES)
    return (
        f"{os.cpu_count()} cores, {platform.system()} {platform.machine()}, "
        f"Python {platform.python_version()}; {libraries}. Ratios are of medians taken in turns "
        "within this run; seconds are those of this machine."
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
