"""Checks that names say what they hold; run by scripts/check.

    python scripts/names.py [ROOT] [--lower]

The words under [tool.names.limits] of pyproject.toml say nothing about the thing they are bound
to. How often each may still be bound in the package stands beside it, and only ever falls: a count
above its limit is an error with its places, and so is one below it, until the limit is lowered
(`--lower` does that). Two more rules have no limit: a class name means one thing in the whole
package, and a value that is returned at once needs no name for its type (`x: T = ...; return x`).
"""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from itertools import pairwise
from pathlib import Path

HINT = "name the thing: `plan`, `duals`, `line_names`, `stored_mwh`; see docs/reference/glossary.md"
Places = Mapping[str, list[str]]


def bindings(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Every name that is bound, with its line: variables, attributes, arguments, definitions."""
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name, ctx=ast.Store()) | ast.Attribute(attr=name, ctx=ast.Store()):
                yield name, node.lineno
            case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.Lambda():
                yield from _defined(node)
            case ast.ClassDef(name=name):
                yield name, node.lineno
            case ast.alias(asname=str(name)) | ast.ExceptHandler(name=str(name)):
                yield name, node.lineno
            case ast.MatchAs(name=str(name)) | ast.MatchStar(name=str(name)):
                yield name, node.lineno


def _defined(
    node: ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda,
) -> Iterator[tuple[str, int]]:
    """A function's own name and its arguments; `other` of a dunder is Python's word."""
    function = "" if isinstance(node, ast.Lambda) else node.name
    if function:
        yield function, node.lineno
    dunder = function.startswith("__") and function.endswith("__")
    for argument in ast.walk(node.args):
        if isinstance(argument, ast.arg) and not (dunder and argument.arg == "other"):
            yield argument.arg, argument.lineno


def shims(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Names that are annotated, assigned, and returned in the very next statement."""
    for node in ast.walk(tree):
        for body in ("body", "orelse", "finalbody"):
            statements = getattr(node, body, None)
            if not isinstance(statements, list):
                continue
            for first, second in pairwise(statements):
                match first, second:
                    case (
                        ast.AnnAssign(target=ast.Name(id=name), value=ast.expr()),
                        ast.Return(value=ast.Name(id=returned)),
                    ) if name == returned:
                        yield name, first.lineno


def binding_places(trees: Mapping[str, ast.Module], words: Iterable[str]) -> Places:
    """Where each of some words is bound, as `file:line`."""
    places: dict[str, list[str]] = {word: [] for word in words}
    for file, tree in trees.items():
        for name, line in bindings(tree):
            if name in places:
                places[name].append(f"{file}:{line}")
    return places


def class_places(trees: Mapping[str, ast.Module]) -> Places:
    """Where each class of a module's top level is defined."""
    places = defaultdict(list)
    for file, tree in trees.items():
        for node in tree.body:
            if isinstance(node, ast.ClassDef):
                places[node.name].append(f"{file}:{node.lineno}")
    return places


def violations(trees: Mapping[str, ast.Module], limits: Mapping[str, int]) -> Iterator[str]:
    """What breaks a rule, one text each."""
    for word, places in binding_places(trees, limits).items():
        limit = limits[word]
        if len(places) > limit:
            lines = "\n".join(f"  {place}" for place in places)
            yield f"{word!r} is bound {len(places)} times; allowed: {limit}\n{lines}\nhint: {HINT}"
        elif len(places) < limit:
            yield f"{word!r} is bound {len(places)} times; lower the limit to {len(places)}"
    for name, places in class_places(trees).items():
        if len(places) > 1:
            yield f"class {name} is defined in {', '.join(places)}; allowed: one meaning per name"
    for file, tree in trees.items():
        for name, line in shims(tree):
            yield f"{file}:{line}: `{name}` is returned at once\nhint: return the expression"


def read_package(root: Path) -> dict[str, ast.Module]:
    """The syntax tree of every module of the package, by its path from `root`."""
    return {
        path.relative_to(root).as_posix(): ast.parse(path.read_text(encoding="utf-8"))
        for path in sorted((root / "resilience").rglob("*.py"))
    }


def read_limits(project: Path) -> dict[str, int]:
    """How often each word may be bound."""
    document = tomllib.loads(project.read_text(encoding="utf-8"))
    return {word: int(limit) for word, limit in document["tool"]["names"]["limits"].items()}


def lower_limits(project: Path, trees: Mapping[str, ast.Module]) -> None:
    """Writes counts into pyproject.toml where they are below their limits."""
    text = project.read_text(encoding="utf-8")
    for word, places in binding_places(trees, limits := read_limits(project)).items():
        if len(places) < limits[word]:
            entry = re.compile(rf"(?m)^{word} = {limits[word]}$")
            text = entry.sub(f"{word} = {len(places)}", text)
    project.write_text(text, encoding="utf-8")


def main(arguments: list[str]) -> int:
    """Prints what breaks a rule; returns the exit code."""
    roots = [Path(word) for word in arguments if not word.startswith("--")]
    root = roots[0] if roots else Path(__file__).parents[1]
    project, trees = root / "pyproject.toml", read_package(root)
    if "--lower" in arguments:
        lower_limits(project, trees)
    broken = list(violations(trees, read_limits(project)))
    for text in broken:
        print(f"error: {text}", file=sys.stderr)
    if not broken:
        print(f"Names: {len(trees)} files, no word above its limit")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
