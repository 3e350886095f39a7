from collections.abc import Callable
from pathlib import Path

import pytest

from tests.unit.case.valid import VALID

CaseFile = Callable[..., Path]


@pytest.fixture
def case_file(tmp_path: Path) -> CaseFile:
    """Write a case file; pairs of texts replace parts of the valid case above."""

    def write(*changes: tuple[str, str], text: str = VALID, name: str = "case.toml") -> Path:
        for old, new in changes:
            assert text.count(old) >= 1, f"{old!r} is not in the case"
            text = text.replace(old, new, 1)
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return write
