"""Every notebook of the gallery runs, shows what it shows today, and is a page of the site."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.pages import ROOT

GALLERY = ROOT / "docs" / "gallery"
NAMES = sorted(path.stem for path in GALLERY.glob("*.ipynb"))
LONG = ("policy", "storm")


def test_there_are_four_of_them_and_each_is_in_the_menu() -> None:
    assert NAMES == ["benchmark", "feeder", "policy", "storm"]
    menu = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    assert all(f"gallery/{name}.md" in menu for name in NAMES)


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.slow] if n in LONG else []) for n in NAMES]
)
def test_a_notebook_shows_what_is_stored(name: str) -> None:
    pytest.importorskip("nbclient", reason="notebooks are run by nbclient")
    if name == "policy":
        pytest.importorskip("torch", reason="policies are trained by torch")
    command = [sys.executable, str(ROOT / "scripts" / "notebooks.py"), "--check", name]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr[-3000:]


@pytest.mark.parametrize("name", NAMES)
def test_a_page_has_every_text_and_program_of_its_notebook(name: str) -> None:
    sys.path.insert(0, str(Path(ROOT, "docs", "hooks")))
    try:
        from gallery import page  # type: ignore[import-not-found]
    finally:
        sys.path.pop(0)
    notebook = json.loads((GALLERY / f"{name}.ipynb").read_text(encoding="utf-8"))
    text = page(notebook)
    for cell in notebook["cells"]:
        assert "".join(cell["source"]) in text
        if cell["cell_type"] == "code":
            assert cell["execution_count"]
    assert any(cell.get("outputs") for cell in notebook["cells"])
    assert "<script" not in text
    assert "<style" not in text
    assert ("data:image/png;base64," in text) == (name == "feeder")
