"""The leaderboard's page shows every row of its file, the nearest to the bound first."""

from __future__ import annotations

import csv
import importlib.util
from pathlib import Path
from types import ModuleType

DOCS = Path(__file__).parents[2] / "docs"


def hook() -> ModuleType:
    spec = importlib.util.spec_from_file_location("leaderboard", DOCS / "hooks" / "leaderboard.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_row_is_shown_in_order() -> None:
    shown = hook().tables()
    with (DOCS / "leaderboard.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    lines = [line for line in shown.splitlines() if line.startswith("| ") and "%" not in line]
    assert len(lines) == len(rows)
    for section in shown.split("### ")[1:]:
        cells = [line.split(" | ") for line in section.splitlines() if line.endswith("` |")]
        medians = [float(cell[3]) for cell in cells]
        assert medians == sorted(medians)


def test_the_page_has_a_place_for_it() -> None:
    page = (DOCS / "concepts" / "leaderboard.md").read_text(encoding="utf-8")
    assert page.count(hook().MARK) == 1
