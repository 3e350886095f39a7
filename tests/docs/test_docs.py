"""Every command and program in the documentation runs, and prints what the page says it prints."""

import os
import re
import subprocess
import sys
from html import escape
from pathlib import Path

import pytest

from resilience.case.schema import case_schema
from tests.docs.pages import ROOT, Step, blocks, run, shortened

DOCS = ROOT / "docs"
WRITTEN = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(DOCS.rglob("*.md"))]
PAGES = (
    "guide/first-feeder",
    "guide/storm-tomorrow",
    "guide/typhoon",
    "guide/operate",
    "guide/harden",
    "concepts/model",
    "concepts/exactness",
    "concepts/methods",
    "concepts/wind",
    "concepts/scenarios",
    "concepts/fragility",
    "concepts/dispatchers",
    "concepts/stochastic",
    "concepts/sddp",
    "concepts/evaluation",
    "concepts/survival",
    "reference/api/cases",
    "reference/api/testing",
)
COMPONENTS = (ROOT / "resilience" / "models" / "components").glob("*.py")
GENERATED = {
    DOCS / "reference" / f"{name}.md"
    for name in ("case", "symbols", "cli", *(f"components/{path.stem}" for path in COMPONENTS))
}
LINK = re.compile(r"\]\(([^)\s]+)\)")
DECIMAL = re.compile(r"\d+\.\d+")
OBJECTIVE = re.compile(r"(?m)^objective (\S+) \$")


@pytest.mark.parametrize("page", PAGES)
def test_commands_and_programs(page: str, tmp_path: Path) -> None:
    for step in run(DOCS / f"{page}.md", tmp_path):
        fails = step.pasted is not None and step.pasted.body.startswith("error:")
        assert step.code == fails, f"{step.source}\n{step.printed}"
        if step.pasted is not None:
            assert_same(step, step.pasted.body)


def assert_same(step: Step, pasted: str) -> None:
    """What costs money agrees to 1e-3 (to the gap asked for), decimals to their last place (ties
    are rounded either way), everything else to the letter."""
    costs = [OBJECTIVE.search(text) for text in (step.printed, pasted)]
    if costs[0] and costs[1]:
        assert float(costs[0][1]) == pytest.approx(float(costs[1][1]), rel=1e-3), step.source
    elif "--json" not in step.source:
        printed = shortened(step.printed, pasted)
        decimals = DECIMAL.findall(printed), DECIMAL.findall(pasted)
        assert DECIMAL.sub("#", printed) == DECIMAL.sub("#", pasted), step.source
        for number, other in zip(*decimals, strict=True):
            place = 10.0 ** -len(number.partition(".")[2])
            assert abs(float(number) - float(other)) < 1.5 * place, step.source


@pytest.mark.parametrize("page", WRITTEN, ids=lambda page: page.stem)
def test_links_lead_somewhere(page: Path) -> None:
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        path = target.partition("#")[0]
        if not path or "://" in path:
            continue
        found = (page.parent / path).resolve()
        assert found.exists() or found in GENERATED, target


@pytest.mark.parametrize("page", WRITTEN, ids=lambda page: page.stem)
def test_code_is_shown_as_code(page: Path) -> None:
    """A fence with more behind it than a language and a title is shown as running text."""
    fences = re.findall(r"(?m)^ *```(.+)$", page.read_text(encoding="utf-8"))
    assert [f for f in fences if not re.fullmatch(r'\w+( title="[^"]+")?', f)] == []


def test_home_page_has_the_commands_of_the_readme() -> None:
    commands = [
        {b.body for b in blocks(path.read_text(encoding="utf-8")) if "python3 -m" in b.body}
        for path in (ROOT / "README.md", DOCS / "index.md")
    ]
    assert commands[0] == commands[1]
    assert len(commands[0]) == 2


@pytest.mark.slow
def test_site_builds_without_a_warning(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")],
        cwd=ROOT,
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    home = (tmp_path / "site" / "index.html").read_text(encoding="utf-8")
    assert not re.findall(r'<(?:script|link)[^>]+(?:src|href)="https?:', home)
    reference = (tmp_path / "site" / "reference" / "case" / "index.html").read_text("utf-8")
    for table in case_schema()["$defs"].values():
        name = re.match(r"`(\[.*?\]+)`", table.get("description", ""))
        if name is not None and table["properties"] and "<kind>" not in name[1]:
            assert f">{escape(name[1])}<" in reference, name[1]
