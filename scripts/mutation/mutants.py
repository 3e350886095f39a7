"""Small faults in a module: at random, as a slip of the hand, or aimed, as something left out.

A mutant replaces one expression or statement of the source by another text, so that all else keeps
its place, and the difference can be read. Messages, annotations and decorators are left alone.
"""

from __future__ import annotations

import ast
import hashlib
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Literal

Kind = Literal["random", "aimed"]

OPERATORS: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}
COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.Gt),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.Lt),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
PAIRS = [
    ("min", "max"),
    ("minimum", "maximum"),
    ("fmin", "fmax"),
    ("argmin", "argmax"),
    ("any", "all"),
    ("floor", "ceil"),
    ("zeros", "ones"),
]
TWINS = {"sum": "max", **dict(PAIRS), **{second: first for first, second in PAIRS}}
"""Functions, and what is called in their place."""
ASSERTED = {"strict", "encoding"}
"""Arguments that hold what is so anyway, here and on a machine set up otherwise."""
CUTS = {"min", "max", "minimum", "maximum", "fmin", "fmax", "clip", "abs"}
"""Functions that often return one of their arguments."""
TEXT = {"annotation", "returns", "decorator_list", "type_params", "format_spec"}
"""Fields of a node that say what is meant, and do nothing."""


def _name(call: ast.Call) -> str:
    match call.func:
        case ast.Name(id=name) | ast.Attribute(attr=name):
            return name
    return ""


def _renamed(call: ast.Call, name: str) -> ast.Call:
    function = call.func
    if isinstance(function, ast.Attribute):
        return ast.Call(ast.Attribute(function.value, name, ast.Load()), call.args, call.keywords)
    return ast.Call(ast.Name(name, ast.Load()), call.args, call.keywords)


def slips(node: ast.AST) -> Iterator[ast.AST]:
    """What a slip of the hand would write instead of a node."""
    match node:
        case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATORS:
            yield ast.BinOp(left, OPERATORS[type(op)](), right)
        case ast.Compare(left=left, ops=[op], comparators=comparators):
            for other in COMPARISONS[type(op)]:
                yield ast.Compare(left, [other()], comparators)
        case ast.BoolOp(op=op, values=values):
            yield ast.BoolOp(ast.Or() if isinstance(op, ast.And) else ast.And(), values)
        case ast.UnaryOp(op=ast.USub() | ast.Not() | ast.Invert(), operand=operand):
            yield operand
        case ast.Constant(value=bool() | int() | float() as value):
            yield ast.Constant(_near(value))
        case ast.Call() if _name(node) in TWINS:
            yield _renamed(node, TWINS[_name(node)])
        case ast.Break() | ast.Continue():
            yield ast.Continue() if isinstance(node, ast.Break) else ast.Break()


def _near(value: float) -> float:
    """Another number of the same type."""
    if isinstance(value, bool):
        return not value
    return value + 1 if isinstance(value, int) else float(f"{1.1 * value or 1.0:.12g}")


def omissions(node: ast.AST) -> Iterator[ast.AST]:
    """A node with one of its parts left out; guards and named arguments are in `mutants`."""
    match node:
        case ast.BinOp():
            yield from _operands(node)
        case ast.BoolOp(op=op, values=values):
            for k in range(len(values)):
                others = values[:k] + values[k + 1 :]
                yield ast.BoolOp(op, others) if len(others) > 1 else others[0]
        case ast.IfExp(body=body, orelse=orelse):
            yield from (body, orelse)
        case ast.Call(args=[_, _, *_]) if _name(node) in CUTS:
            yield from (arg for arg in node.args if not isinstance(arg, ast.Starred))
        case ast.Call(args=[argument]) if _name(node) == "abs":
            yield argument
        case ast.ListComp() | ast.SetComp() | ast.GeneratorExp():
            yield from (type(node)(node.elt, loops) for loops in _unfiltered(node.generators))
        case ast.DictComp(key=key, value=value, generators=loops):
            yield from (ast.DictComp(key, value, fewer) for fewer in _unfiltered(loops))
        case ast.AugAssign() | ast.Expr(value=ast.Call()):
            yield ast.Pass()


def _operands(node: ast.BinOp) -> Iterator[ast.expr]:
    """A sum without one of its terms, a product without one of its factors."""
    match node.op:
        case ast.Add() | ast.Mult() | ast.BitAnd() | ast.BitOr():
            yield from (node.left, node.right)
        case ast.Sub():
            yield from (node.left, ast.UnaryOp(ast.USub(), node.right))
        case ast.Div() | ast.Pow() | ast.Mod():
            yield node.left


def _unfiltered(loops: list[ast.comprehension]) -> Iterator[list[ast.comprehension]]:
    """The loops of a comprehension, each time without one of their conditions."""
    for k, loop in enumerate(loops):
        for condition in loop.ifs:
            ifs = [other for other in loop.ifs if other is not condition]
            bare = ast.comprehension(loop.target, loop.iter, ifs, loop.is_async)
            yield [*loops[:k], bare, *loops[k + 1 :]]


def _guard(node: ast.AST) -> ast.expr | None:
    """The condition of an `if` that leaves the function or the round of a loop."""
    leaves = ast.Raise | ast.Return | ast.Continue | ast.Break
    if isinstance(node, ast.If) and not node.orelse and isinstance(node.body[-1], leaves):
        return node.test
    return None


@dataclass(frozen=True)
class Signatures:
    """Which arguments a package's own functions can do without.

    Attributes:
        names: of all functions and classes.
        optional: for each name, the arguments and fields that have a default.
    """

    names: frozenset[str]
    optional: dict[str, set[str]]

    @classmethod
    def of(cls, trees: Iterable[ast.Module]) -> Signatures:
        optional: dict[str, set[str]] = defaultdict(set)
        for tree in trees:
            for node in ast.walk(tree):
                if isinstance(node, ast.FunctionDef):
                    args = node.args
                    own = [arg.arg for arg in args.posonlyargs + args.args]
                    optional[node.name] |= set(own[len(own) - len(args.defaults) :])
                    pairs = zip(args.kwonlyargs, args.kw_defaults, strict=True)
                    optional[node.name] |= {arg.arg for arg, default in pairs if default}
                elif isinstance(node, ast.ClassDef):
                    optional[node.name] |= {
                        entry.target.id
                        for entry in node.body
                        if isinstance(entry, ast.AnnAssign)
                        and entry.value
                        and isinstance(entry.target, ast.Name)
                    }
        return cls(frozenset(optional), dict(optional))

    def without_an_argument(self, node: ast.AST) -> Iterator[ast.AST]:
        """A call, each time without one of the named arguments that it can do without."""
        if not isinstance(node, ast.Call):
            return
        for keyword in node.keywords:
            known = _name(node) in self.names
            if keyword.arg is None or keyword.arg in ASSERTED:
                continue
            if not known or keyword.arg in self.optional[_name(node)]:
                others = [other for other in node.keywords if other is not keyword]
                yield ast.Call(node.func, node.args, others)


@dataclass(frozen=True)
class Mutant:
    """One fault in one module.

    Attributes:
        file: path below the root of the repository.
        kind: a slip at random, or aimed at one part.
        line: first line of what is replaced, from 1.
        last_line: its last line.
        start: where the replaced text begins in the file, in bytes.
        stop: where it ends.
        text: what stands there instead.
        source: the lines concerned, with single spaces.
        faulty: the same lines with the fault.
        in_function: whether it runs when a function is called, not when the module is imported.
    """

    file: str
    kind: Kind
    line: int
    last_line: int
    start: int
    stop: int
    text: str
    source: str
    faulty: str
    in_function: bool

    @property
    def key(self) -> str:
        """What names it as long as its lines read the same, wherever they stand in the file."""
        return f"{self.file}: {self.source} -> {self.faulty}"

    def rank(self, seed: int) -> str:
        """Its place in the order of a seed; other changes of the file do not move it."""
        return hashlib.sha256(f"{seed}:{self.key}".encode()).hexdigest()

    def applied(self, module: bytes) -> bytes:
        """The module with the fault in it."""
        return module[: self.start] + self.text.encode() + module[self.stop :]


def _sites(node: ast.AST, in_function: bool = False) -> Iterator[tuple[ast.AST, bool]]:
    """Every node that does something, and whether a function must be called for it."""
    yield node, in_function
    for field, value in ast.iter_fields(node):
        if field in TEXT:
            continue
        called = in_function or (isinstance(node, ast.FunctionDef) and field == "body")
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and not _says(child, called):
                yield from _sites(child, called)


def _says(node: ast.AST, in_function: bool) -> bool:
    """Whether a node is a message, a type, a path, or an announcement of progress."""
    if isinstance(node, ast.BinOp):
        is_type = isinstance(node.op, ast.BitOr) and not in_function
        is_path = isinstance(node.op, ast.Div) and _is_string(node.right)
        return is_type or is_path
    if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
        return True
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
        return ast.unparse(node.value.func).startswith("progress.")
    return isinstance(node, ast.Raise | ast.JoinedStr)


def _is_string(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def _written(node: ast.AST) -> str:
    """A node as text that can stand where an operand may."""
    compound = ast.BinOp | ast.BoolOp | ast.Compare | ast.UnaryOp | ast.IfExp | ast.Lambda
    text = ast.unparse(node)
    return f"({text})" if isinstance(node, compound) else text


def mutants(root: Path, file: str, signatures: Signatures) -> list[Mutant]:
    """All mutants of a module, random and aimed."""
    module = (root / file).read_bytes()
    starts = list(accumulate(map(len, module.splitlines(keepends=True)), initial=0))

    def mutant(kind: Kind, node: ast.expr | ast.stmt, text: str, in_function: bool) -> Mutant:
        last = node.end_lineno or node.lineno
        head, tail = starts[node.lineno - 1], starts[last]
        start = head + node.col_offset
        stop = starts[last - 1] + (node.end_col_offset or 0)
        source = _spaced(module[head:tail])
        faulty = _spaced(module[head:start] + text.encode() + module[stop:tail])
        places = (node.lineno, last, start, stop)
        return Mutant(file, kind, *places, text, source, faulty, in_function)

    kinds: list[tuple[Kind, Callable[[ast.AST], Iterator[ast.AST]]]] = [
        ("random", slips),
        ("aimed", omissions),
        ("aimed", signatures.without_an_argument),
    ]
    made = []
    for node, in_function in _sites(ast.parse(module)):
        for kind, changes in kinds:
            for changed in changes(node):
                assert isinstance(node, ast.expr | ast.stmt)
                made.append(mutant(kind, node, _written(changed), in_function))
        if (condition := _guard(node)) is not None:
            made.append(mutant("aimed", condition, "False", in_function))
    return list({one.key: one for one in made if one.source != one.faulty}.values())


def _spaced(lines: bytes) -> str:
    return " ".join(lines.decode().split())
