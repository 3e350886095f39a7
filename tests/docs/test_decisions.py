"""The records of decisions: numbered without gaps, dated, and all in the index."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.docs.pages import ROOT

FOLDER = ROOT / "docs" / "decisions"
RECORDS = sorted(FOLDER.glob("[0-9]*.md"))
HEAD = re.compile(
    r"# (\d+)\. (.+)\n\n\*\*Status\.\*\* (Accepted|Superseded|Void)\b.*\. "
    r"\*\*Date\.\*\* (\d{4}-\d{2}-\d{2})\.\n\n"
)
ROW = re.compile(r"(?m)^\| (\d+) \| \[(.+)\]\((.+)\) \| (\w+) \| ([\d-]+) \| [^|]+ \|$")


@pytest.mark.parametrize("path", RECORDS, ids=lambda path: path.stem)
def test_a_record_has_number_status_date_and_its_three_parts(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    head = HEAD.match(text)
    assert head is not None
    assert int(head[1]) == int(path.name[:4])
    for part in ("Context", "Decision", "Consequence"):
        assert f"**{part}.**" in text


def test_the_index_says_what_the_records_say() -> None:
    rows = [row.groups() for row in ROW.finditer((FOLDER / "index.md").read_text("utf-8"))]
    heads = [(HEAD.match(path.read_text("utf-8")), path.name) for path in RECORDS]
    records = [(h[1], h[2], name, h[3], h[4]) for h, name in heads if h is not None]
    assert rows == records
