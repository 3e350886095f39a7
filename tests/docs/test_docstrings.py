"""What crosses modules says what it holds: public dataclasses document every field."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "resilience"


def dataclasses() -> Iterator[ast.ClassDef]:
    """Every public dataclass of the package; class names are unique in it."""
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if (
                isinstance(node, ast.ClassDef)
                and not node.name.startswith("_")
                and any("dataclass" in ast.unparse(d) for d in node.decorator_list)
            ):
                yield node


CLASSES = {node.name: node for node in dataclasses()}


def described(name: str) -> str:
    """What a class, and those it extends, say under `Attributes:`."""
    if name not in CLASSES:
        return ""
    _, _, attributes = (ast.get_docstring(CLASSES[name]) or "").partition("Attributes:")
    return "\n".join([attributes, *(described(ast.unparse(base)) for base in CLASSES[name].bases)])


@pytest.mark.parametrize("name", CLASSES)
def test_every_field_is_documented(name: str) -> None:
    fields = [
        item.target.id
        for item in CLASSES[name].body
        if isinstance(item, ast.AnnAssign)
        and isinstance(item.target, ast.Name)
        and not item.target.id.startswith("_")
        and "ClassVar" not in ast.unparse(item.annotation)
    ]
    text = described(name)
    assert [f for f in fields if not re.search(rf"^ +.*\b{f}\b.*:", text, re.MULTILINE)] == []
