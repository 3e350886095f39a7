"""Where reference data lie that are not part of the repository; tests skip without them.

The folder `shared` beside the repository, or beside a folder above it, or what the environment
variable RESILIENCE_SHARED says.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest


def shared(*parts: str) -> Path:
    """The path of a file or folder of reference data. Skips the test where there is none."""
    said = os.environ.get("RESILIENCE_SHARED")
    above = Path(__file__).resolve().parents[2:4]
    roots = [Path(said)] if said else [folder / "shared" for folder in above]
    for root in roots:
        if (root / Path(*parts)).exists():
            return root / Path(*parts)
    pytest.skip(f"{'/'.join(parts)} is not in {' or '.join(map(str, roots))}")
