"""Runs the notebooks of the gallery, and stores what they show.

python scripts/notebooks.py feeder storm     # these, in place; all of them without a name
python scripts/notebooks.py --check feeder   # fails where a text is another one than stored
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient

ROOT = Path(__file__).parents[1]
GALLERY = ROOT / "docs" / "gallery"
TIMEOUT_S = 600
SECONDS = re.compile(r"\d+(\.\d+)? s\b")


def main(arguments: list[str]) -> int:
    """Runs the notebooks that are named; 1 where one shows something else than it did."""
    os.environ["PYTHONPATH"] = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    os.environ["PYTHONWARNINGS"] = "ignore"
    names = [name for name in arguments if name != "--check"]
    names = names or sorted(path.stem for path in GALLERY.glob("*.ipynb"))
    changed = []
    for name in names:
        path = GALLERY / f"{name}.ipynb"
        notebook = nbformat.read(path, as_version=4)  # type: ignore[no-untyped-call]
        before = texts(notebook)
        with tempfile.TemporaryDirectory() as folder:
            client = NotebookClient(
                notebook,
                timeout=TIMEOUT_S,
                kernel_name="python3",
                resources={"metadata": {"path": folder}},
                record_timing=False,
            )
            client.execute()
        for cell in notebook.cells:
            cell.metadata = {}
            if cell.cell_type == "code":
                cell.outputs = [x for x in cell.outputs if x.get("name") != "stderr"]
        if "--check" not in arguments:
            nbformat.write(notebook, path)  # type: ignore[no-untyped-call]
        elif texts(notebook) != before:
            changed.append(name)
            print(f"{name}: stored\n{before}\nnow\n{texts(notebook)}")
    return int(bool(changed))


def texts(notebook: Any) -> list[str]:
    """What the cells print and show, without seconds."""
    shown = []
    for cell in notebook.cells:
        for output in cell.get("outputs", []):
            data = output.get("data", {})
            if output.get("name") != "stderr" and "image/png" not in data:
                shown.append(SECONDS.sub("", output.get("text", data.get("text/plain", ""))))
    return shown


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
