"""The kinds of devices are listed in one place: everybody else loops over the registry.

A function that names three kinds or more, as attributes (`case.pv`) or as text ("pv", "pv.p"), has
a list of its own, which a new kind of device would be missing from without a word.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import resilience
from resilience.case.schema import DEVICES

PACKAGE = Path(resilience.__file__).parent
HOMES = ("models/components", "case/schema")
ALLOWED = {
    "case/networks/matpower.py": "sorts the rows of a MATPOWER file, which has kinds of its own",
    "case/networks/pandapower_devices.py": "tables of pandapower, which has kinds of its own",
    "case/starter/devices.py": "writes a first case of what network files know",
    "models/simulator/paper.py": "the paper's equations are of its kinds; others are refused",
    "testing/dispatchers.py": "builds a case that has one device of each kind",
    "testing/tiny_cases.py": "builds cases by keys of case files",
}
LIMIT = 3  # kinds from which naming them is a list


def kinds_named(node: ast.AST) -> set[str]:
    """Kinds that a piece of code names as attributes or as the beginning of text."""
    kinds = set()
    for part in ast.walk(node):
        if isinstance(part, ast.Attribute):
            kinds.add(part.attr)
        elif isinstance(part, ast.keyword) and part.arg:
            kinds.add(part.arg)
        elif isinstance(part, ast.Constant) and isinstance(part.value, str):
            kinds.add(part.value.partition(".")[0])
    return kinds & DEVICES.keys()


def pieces(tree: ast.Module) -> Iterator[tuple[str, ast.AST]]:
    """Every function, and every statement outside of functions, with a name for messages."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            yield node.name, node
    for body in (tree.body, *(n.body for n in tree.body if isinstance(n, ast.ClassDef))):
        for node in body:
            if not isinstance(node, ast.FunctionDef | ast.ClassDef):
                yield f"line {node.lineno}", node


def lists(path: Path) -> list[str]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return [
        f"{path.relative_to(PACKAGE)}: {name} names {', '.join(sorted(kinds))}"
        for name, piece in pieces(tree)
        if len(kinds := kinds_named(piece)) >= LIMIT
    ]


def modules() -> list[Path]:
    paths = (path for path in PACKAGE.rglob("*.py"))
    return [p for p in paths if not p.relative_to(PACKAGE).as_posix().startswith(HOMES)]


def test_nobody_lists_the_kinds_of_devices() -> None:
    found = [
        line
        for path in modules()
        if path.relative_to(PACKAGE).as_posix() not in ALLOWED
        for line in lists(path)
    ]
    assert not found, "loop over `fleets` instead:\n" + "\n".join(found)


def test_what_is_excused_still_needs_it() -> None:
    assert [path for path in ALLOWED if not (PACKAGE / path).is_file()] == []
    assert [path for path in ALLOWED if not lists(PACKAGE / path)] == []


def test_a_list_is_seen() -> None:
    code = "def names(case):\n    return [t.name for t in (*case.load, *case.pv, *case.ess)]"
    assert [len(kinds_named(piece)) for _, piece in pieces(ast.parse(code))] == [3]
    assert kinds_named(ast.parse('FLOWS = ("pv.p", "grid.import", "generator.p")')) == {
        "pv", "grid", "generator"
    }  # fmt: skip
