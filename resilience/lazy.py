"""Public names of a package that are imported when they are first used."""

from __future__ import annotations

import ast
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any


def lazy_names(package: str) -> Callable[[str], Any]:
    """The `__getattr__` of a package whose names stand in its `if TYPE_CHECKING:` block.

    Type checkers read that block, and so does this when a name is first used: the names and the
    modules that they come from are written once.

    Args:
        package: `__name__` of the package.
    """
    modules: dict[str, str] = {}

    def imported(name: str) -> Any:
        if not modules:
            modules.update(modules_of_names(package))
        if name not in modules:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(modules[name]), name)

    return imported


def modules_of_names(package: str) -> dict[str, str]:
    """Name to module of what a package imports for type checkers only."""
    source = Path(str(sys.modules[package].__file__)).read_text(encoding="utf-8")
    blocks = [
        node.body
        for node in ast.parse(source).body
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
    ]
    return {
        alias.name: str(statement.module)
        for block in blocks
        for statement in block
        if isinstance(statement, ast.ImportFrom)
        for alias in statement.names
    }
