"""Finished parts of long work as JSON files: what is damaged, or was changed, counts as missing."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from resilience.files import replacing_file
from resilience.progress import notice


def save_part(path: Path, values: object) -> None:
    """Writes plain data and its SHA-256, whole or not at all.

    Raises:
        FileError: the system refuses.
    """
    text = json.dumps({"sha256": _digest(values), "part": values}, indent=2, allow_nan=False)
    with replacing_file(path) as fresh:
        fresh.write_text(text + "\n", encoding="utf-8")


def load_part(path: Path) -> Any:
    """What `save_part` wrote; None where there is nothing, or something else by now."""
    if not path.is_file():
        return None
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))
        if stored["sha256"] == _digest(stored["part"]):
            return stored["part"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        pass
    notice(f"{path} is damaged or was changed, and is made anew")
    return None


def _digest(values: object) -> str:
    return hashlib.sha256(json.dumps(values).encode()).hexdigest()
