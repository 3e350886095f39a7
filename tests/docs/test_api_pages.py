"""The reference of the Python interface: every public name has its place, and only one."""

from __future__ import annotations

import re
from collections import Counter
from importlib import import_module

import pytest

from tests.docs.pages import ROOT

PAGES = sorted((ROOT / "docs" / "reference" / "api").glob("*.md"))
ENTRIES = Counter(
    name
    for page in PAGES
    for name in re.findall(r"(?m)^::: (\S+)$", page.read_text(encoding="utf-8"))
)


@pytest.mark.parametrize("package", ["resilience", "resilience.fragility", "resilience.testing"])
def test_every_public_name_is_on_one_page(package: str) -> None:
    names = import_module(package).__all__
    assert {name: ENTRIES[f"{package}.{name}"] for name in names} == dict.fromkeys(names, 1)


@pytest.mark.parametrize("name", ENTRIES)
def test_what_the_pages_name_exists_and_has_a_docstring(name: str) -> None:
    module, _, last = name.rpartition(".")
    thing = getattr(import_module(module), last)
    assert isinstance(thing, dict) or thing.__doc__
