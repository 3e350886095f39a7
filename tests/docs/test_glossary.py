"""The glossary: every name that it gives exists, and no term stands in it twice."""

from __future__ import annotations

import re
from importlib import import_module
from operator import attrgetter

import pytest

from tests.docs.pages import ROOT

ROW = re.compile(r"^\| ([^|]+) \| [^|]+ \| (`[^|]+`) \|$", re.MULTILINE)
TEXT = (ROOT / "docs" / "reference" / "glossary.md").read_text(encoding="utf-8")
ROWS = [(term.strip(), names) for term, names in ROW.findall(TEXT)]
CARRIERS = sorted({name for _, names in ROWS for name in re.findall(r"`([\w.]+)`", names)})


def test_every_term_stands_once() -> None:
    terms = [term for term, _ in ROWS]
    assert len(terms) > 50
    assert len(terms) == len(set(terms))


@pytest.mark.parametrize("name", CARRIERS)
def test_what_carries_a_term_exists(name: str) -> None:
    words = name.split(".")
    for k in range(len(words), 0, -1):
        try:
            module = import_module(".".join(["resilience", *words[:k]]))
        except ModuleNotFoundError:
            continue
        rest = ".".join(words[k:])
        assert not rest or has(module, rest), f"{name}: no {rest} in {module.__name__}"
        return
    pytest.fail(f"{name}: no such module")


def has(module: object, path: str) -> bool:
    """Whether a module has an attribute, or a dataclass in it a field, of that path."""
    owner, _, last = path.rpartition(".")
    home = attrgetter(owner)(module) if owner else module
    return hasattr(home, last) or last in getattr(home, "__annotations__", {})
