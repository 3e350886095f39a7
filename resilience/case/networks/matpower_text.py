"""The text of MATPOWER case files: statements, tables, and the conversions at their end.

Distribution cases of MATPOWER state impedances in ohm and loads in kW and convert them with
MATLAB statements at the end of the file. Those statements are carried out here; a statement that
changes the tables in another way is refused, since reading past it would give a wrong network.
Arithmetic is that of floating point, as in MATLAB.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np

from resilience.arrays import Floats

COLUMNS = {
    "bus": {
        "BUS_I": 0, "BUS_TYPE": 1, "PD": 2, "QD": 3, "GS": 4, "BS": 5, "BASE_KV": 9, "VMAX": 11,
        "VMIN": 12,
    },
    "branch": {
        "F_BUS": 0, "T_BUS": 1, "BR_R": 2, "BR_X": 3, "BR_B": 4, "RATE_A": 5, "TAP": 8, "SHIFT": 9,
        "BR_STATUS": 10, "ANGMIN": 11, "ANGMAX": 12,
    },
    "gen": {
        "GEN_BUS": 0, "PG": 1, "QG": 2, "QMAX": 3, "QMIN": 4, "VG": 5, "GEN_STATUS": 7, "PMAX": 8,
        "PMIN": 9,
    },
    "gencost": {"MODEL": 0, "STARTUP": 1, "SHUTDOWN": 2, "NCOST": 3, "COST": 4},
    "dcline": {"F_BUS": 0, "T_BUS": 1, "BR_STATUS": 2},
}  # fmt: skip
"""Columns that are read or may be named, from 0 (MATPOWER User's Manual, appendix B)."""
_WIDTHS = {"bus": 10, "branch": 11, "gen": 10, "gencost": 5, "dcline": 3}
"""The fewest columns a table can do with."""
_FUNCTIONS = {
    "sqrt": math.sqrt,
    "sin": math.sin,
    "cos": math.cos,
    "acos": math.acos,
    "tan": math.tan,
}
_OPERATORS: dict[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: math.pow,
}
_TABLE = "|".join(COLUMNS)
_CELL = re.compile(rf"mpc\.({_TABLE})\((\d+),\s*(\w+)\)")
_COLUMN = re.compile(
    r"mpc\.(?P<table>\w+)\(:,(?P<target>[^()]+)\)=mpc\.(?P=table)\(:,(?P<source>[^()]+)\)(?P<by>[*/].+)"
)
_CONTROL = re.compile(r"(if|elseif|else|for|while|switch|parfor|try|catch|return|end)\b")
_VERSION_1 = re.compile(r"function\s*\[\s*baseMVA\b")
_MAX_DEPTH = 200  # of brackets in an expression


def read_tables(text: str) -> tuple[dict[str, Floats], list[str]]:
    """The tables of a case file, and the names of those that are not read.

    Returns:
        `bus`, `branch`, `gen`, `gencost` and `dcline`, as far as they are there, as rows of
        numbers, and `baseMVA`, of no dimension; further tables by name.

    Raises:
        ValueError: it is no such file, or holds statements that are not carried out.
    """
    code = _code(text)
    if _VERSION_1.search(code) or re.search(r"mpc\.version\s*=\s*'1'", text):
        raise ValueError("a case of version 1; write it anew with MATPOWER's savecase")
    tables: dict[str, Floats] = {}
    others: list[str] = []
    scalars: dict[str, float] = {}
    for line, statement in _statements(code):
        target, _, value = (text.strip() for text in statement.partition("="))
        matrix = re.fullmatch(rf"mpc\.({_TABLE})", target)
        if _CONTROL.match(statement):
            word = re.split(r"\W", statement)[0]
            if word != "end":
                raise ValueError(f"line {line}: {word!r} is not carried out; write what it gives")
        elif matrix:
            tables[matrix[1]] = _matrix(matrix[1], value, line)
        elif target == "mpc.baseMVA":
            scalars["mpc_baseMVA"] = _number(value, scalars)
            tables["baseMVA"] = np.array(scalars["mpc_baseMVA"])
        elif re.match(rf"mpc\.({_TABLE})\b", target):
            _convert(re.sub(r"\s*([=*/(),:])\s*", r"\1", statement), line, tables, scalars)
        elif re.fullmatch(r"mpc\.\w+", target) and re.match(r"[\[{]\s*[^\s\]}]", value):
            others.append(target.removeprefix("mpc."))
        elif re.fullmatch(r"[A-Za-z]\w*", target) and value:
            # Of no use here, or missed where it is used.
            with suppress(ValueError, SyntaxError, ArithmeticError):
                scalars[target] = _number(_fill(value, tables), scalars)
    return tables, others


def read_words(text: str, name: str) -> list[str]:
    """The strings of a column `mpc.NAME = {'ng'; 'solar'; ...};`; none where there is no such."""
    strings = re.search(rf"\bmpc\.{name}\s*=\s*\{{([^}}]*)\}}", _code(text, r"\1"))
    return re.findall(r"'([^'\n]*)'", strings[1]) if strings else []


def _code(text: str, strings: str = "''") -> str:
    """The text without comments; every line stays where it is.

    Args:
        text: of the file.
        strings: what stands in place of a string, which is the group 1.
    """
    lines, depth = [], 0
    for line in text.splitlines():
        mark = line.strip()
        depth += mark == "%{"
        bare = re.sub(r"('[^'\n]*')|%.*", lambda m: m.expand(strings) if m[1] else "", line)
        lines.append("" if depth else bare)
        depth -= mark == "%}" and depth > 0
    # A continued statement stands on one line; what follows it keeps its number.
    return re.sub(r"\.\.\.[^\n]*\n", " \v", "\n".join(lines))


def _statements(code: str) -> Iterator[tuple[int, str]]:
    """Statements and the lines they begin on; matrices stay in one piece."""
    for match in re.finditer(r"[^;\n\[{]*(?:(?:\[[^\]]*\]|\{[^}]*\})[^;\n\[{]*)*", code):
        statement = match[0].replace("\v", " ").strip()
        if statement:
            start = match.start() + len(match[0]) - len(match[0].lstrip())
            yield len(re.findall(r"[\n\v]", code[:start])) + 1, statement


def _matrix(name: str, text: str, line: int) -> Floats:
    rows = [
        re.split(r"[\s,]+", row.strip().strip(","))
        for row in re.split(r"[;\n]", text.strip().strip("[]").replace("\v", " "))
    ]
    numbers = [[_number(cell, {}) for cell in row] for row in rows if row != [""]]
    width = max(map(len, numbers), default=_WIDTHS[name])
    for k, row in enumerate(numbers, start=1):
        short = name != "gencost" and len(row) != width
        if short or len(row) < _WIDTHS[name]:
            allowed = width if short else f"{_WIDTHS[name]} or more"
            raise ValueError(
                f"mpc.{name} from line {line}, row {k}: {len(row)} columns in place of {allowed}"
            )
    return np.array([row + [0.0] * (width - len(row)) for row in numbers]).reshape(-1, width)


def _fill(text: str, tables: dict[str, Floats]) -> str:
    """An expression with numbers in place of single cells, as in `mpc.bus(1, BASE_KV)`."""

    def cell(match: re.Match[str]) -> str:
        table, row, column = match.groups()
        return repr(float(tables[table][int(row) - 1, _column(table, column)]))

    return _CELL.sub(cell, text).replace("mpc.baseMVA", "mpc_baseMVA")


def _column(table: str, name: str) -> int:
    return int(name) - 1 if name.isdigit() else COLUMNS[table][name]


def _convert(
    statement: str, line: int, tables: dict[str, Floats], scalars: dict[str, float]
) -> None:
    """Carries out `mpc.T(:, columns) = mpc.T(:, columns) * number`, or `/ number`."""
    match = _COLUMN.fullmatch(statement)
    if match is None or match["table"] not in tables:
        raise ValueError(f"line {line}: statement not understood: {statement}")
    table = tables[match["table"]]
    target, source = (
        [_column(match["table"], name) for name in re.findall(r"\w+", match[side])]
        for side in ("target", "source")
    )
    table[:, target] = table[:, source] * _factor(match["by"], scalars)


def _factor(text: str, scalars: dict[str, float]) -> float:
    """The factor that `* a / b ...` amounts to; a sum is refused."""
    product = node = _parsed(f"1{text}")
    while isinstance(node, ast.BinOp):
        if not isinstance(node.op, ast.Mult | ast.Div):
            raise ValueError(f"expression not understood: {text}")
        node = node.left
    return _value(product, scalars)


def _parsed(text: str) -> ast.expr:
    if text.count("(") > _MAX_DEPTH or len(re.findall(r"[-+^]", text)) > _MAX_DEPTH:
        raise ValueError(f"expression too long: {text[:40]} ...")
    return ast.parse(text.strip().replace("^", "**"), mode="eval").body


def _number(text: str, scalars: dict[str, float]) -> float:
    try:
        return float(text)
    except ValueError:
        return float(_value(_parsed(text), scalars))


def _value(node: ast.expr, scalars: dict[str, float]) -> float:
    match node:
        case ast.Constant(value=int() | float() as number):
            return float(number)
        case ast.Name(id=name) if name in scalars:
            return scalars[name]
        case ast.UnaryOp(op=ast.USub(), operand=inner):
            return -_value(inner, scalars)
        case ast.BinOp(left=first, op=op, right=second) if type(op) in _OPERATORS:
            return float(_OPERATORS[type(op)](_value(first, scalars), _value(second, scalars)))
        case ast.Call(func=ast.Name(id=name), args=[inner]) if name in _FUNCTIONS:
            return _FUNCTIONS[name](_value(inner, scalars))
    raise ValueError(f"expression not understood: {ast.unparse(node)}")
