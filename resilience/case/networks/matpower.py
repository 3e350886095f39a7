"""MATPOWER case files (`.m`, format version 2) as feeders.

Distribution cases of MATPOWER state impedances in ohm and loads in kW and convert them with
MATLAB statements at the end of the file. Those statements are carried out here; a statement that
changes the tables in another way is refused, since reading past it would give a wrong network.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np

from resilience.arrays import Floats
from resilience.case.networks.feeder import (
    Branch,
    Feeder,
    FeederError,
    SourceDevice,
    make_network,
    unique_names,
)

_COLUMNS = {
    "bus": {"BUS_I": 0, "BUS_TYPE": 1, "PD": 2, "QD": 3, "GS": 4, "BS": 5, "BASE_KV": 9},
    "branch": {
        "F_BUS": 0,
        "T_BUS": 1,
        "BR_R": 2,
        "BR_X": 3,
        "BR_B": 4,
        "RATE_A": 5,
        "BR_STATUS": 10,
    },
    "gen": {"GEN_BUS": 0, "PG": 1, "QG": 2, "VG": 5, "GEN_STATUS": 7, "PMAX": 8, "PMIN": 9},
}
_REFERENCE, _ISOLATED = 3, 4
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
    ast.Pow: operator.pow,
}
_CELL = re.compile(r"mpc\.(bus|branch|gen)\((\d+),\s*(\w+)\)")
_COLUMN = re.compile(
    r"mpc\.(?P<table>\w+)\(:,(?P<target>[^()]+)\)=mpc\.(?P=table)\(:,(?P<source>[^()]+)\)(?P<by>[*/].+)"
)


def feeder_from_matpower(path: Path) -> Feeder:
    """The network of a MATPOWER case file, with its loads and generators.

    Raises:
        FeederError: it is no such file, or holds statements that are not understood.
    """
    try:
        tables = _read(path.read_text(encoding="utf-8", errors="replace"))
        return _feeder(tables)
    except (ValueError, ArithmeticError, LookupError, SyntaxError) as error:
        hint = "mpc.baseMVA, mpc.bus and mpc.branch are needed, as MATPOWER's savecase writes them"
        raise FeederError(
            "file", f"{path.name}: {error}", "a MATPOWER case, version 2", hint
        ) from None


def _statements(text: str) -> Iterator[str]:
    """Statements without comments and continuation marks; matrices stay in one piece."""
    lines = (re.sub(r"%.*", "", re.sub(r"'[^'\n]*'", "''", line)) for line in text.splitlines())
    joined = re.sub(r"\.\.\.[^\n]*\n", " ", "\n".join(lines))
    for match in re.finditer(r"[^;\n\[{]*(?:(?:\[[^\]]*\]|\{[^}]*\})[^;\n\[{]*)*", joined):
        statement = match[0].strip()
        if statement:
            yield statement


def _read(text: str) -> dict[str, Floats]:
    """The tables `bus`, `branch` and `gen`, as rows of numbers, and `baseMVA`, of no dimension."""
    tables: dict[str, Floats] = {}
    scalars: dict[str, float] = {}
    for statement in _statements(text):
        target, _, value = (text.strip() for text in statement.partition("="))
        matrix = re.fullmatch(r"mpc\.(bus|branch|gen)", target)
        if matrix:
            tables[matrix[1]] = _matrix(value)
        elif target == "mpc.baseMVA":
            scalars["mpc_baseMVA"] = _number(value, scalars)
            tables["baseMVA"] = np.array(scalars["mpc_baseMVA"])
        elif re.match(r"mpc\.(bus|branch|gen)\b", target):
            _convert(re.sub(r"\s*([=*/(),:])\s*", r"\1", statement), tables, scalars)
        elif re.fullmatch(r"[A-Za-z]\w*", target) and value:
            with suppress(ValueError, SyntaxError):  # of no use here, or missed where it is used
                scalars[target] = _number(_fill(value, tables), scalars)
    return tables


def _matrix(text: str) -> Floats:
    rows = [
        re.split(r"[\s,]+", row.strip()) for row in re.split(r"[;\n]", text.strip().strip("[]"))
    ]
    return np.array([[_number(cell, {}) for cell in row] for row in rows if row != [""]])


def _fill(text: str, tables: dict[str, Floats]) -> str:
    """An expression with numbers in place of single cells, as in `mpc.bus(1, BASE_KV)`."""

    def cell(match: re.Match[str]) -> str:
        table, row, column = match.groups()
        return repr(float(tables[table][int(row) - 1, _column(table, column)]))

    return _CELL.sub(cell, text).replace("mpc.baseMVA", "mpc_baseMVA")


def _column(table: str, name: str) -> int:
    return int(name) - 1 if name.isdigit() else _COLUMNS[table][name]


def _convert(statement: str, tables: dict[str, Floats], scalars: dict[str, float]) -> None:
    """Carries out `mpc.T(:, columns) = mpc.T(:, columns) * number`, or `/ number`."""
    match = _COLUMN.fullmatch(statement)
    if match is None or match["table"] not in tables:
        raise ValueError(f"statement not understood: {statement}")
    table = tables[match["table"]]
    target, source = (
        [_column(match["table"], name) for name in re.findall(r"\w+", match[side])]
        for side in ("target", "source")
    )
    table[:, target] = table[:, source] * _factor(match["by"], scalars)


def _factor(text: str, scalars: dict[str, float]) -> float:
    """The factor that `* a / b ...` amounts to; a sum is refused."""
    product = node = ast.parse(f"1{text}".replace("^", "**"), mode="eval").body
    while isinstance(node, ast.BinOp):
        if not isinstance(node.op, ast.Mult | ast.Div):
            raise ValueError(f"expression not understood: {text}")
        node = node.left
    return _value(product, scalars)


def _number(text: str, scalars: dict[str, float]) -> float:
    try:
        return float(text)
    except ValueError:
        return float(_value(ast.parse(text.replace("^", "**"), mode="eval").body, scalars))


def _value(node: ast.expr, scalars: dict[str, float]) -> float:
    match node:
        case ast.Constant(value=int() | float() as number):
            return number
        case ast.Name(id=name) if name in scalars:
            return scalars[name]
        case ast.UnaryOp(op=ast.USub(), operand=inner):
            return -_value(inner, scalars)
        case ast.BinOp(left=first, op=op, right=second) if type(op) in _OPERATORS:
            return float(_OPERATORS[type(op)](_value(first, scalars), _value(second, scalars)))
        case ast.Call(func=ast.Name(id=name), args=[inner]) if name in _FUNCTIONS:
            return _FUNCTIONS[name](_value(inner, scalars))
    raise ValueError(f"expression not understood: {ast.unparse(node)}")


def _feeder(tables: dict[str, Floats]) -> Feeder:
    base_mva, bus = float(tables["baseMVA"]), tables["bus"]
    bus = bus[bus[:, 1] != _ISOLATED]
    names = {int(row[0]): str(int(row[0])) for row in bus}
    unknown = [names[int(row[0])] for row in bus if row[9] <= 0]
    if unknown:
        raise ValueError(
            f"baseKV is 0 at bus {unknown[0]}; column 10 must hold the nominal voltage"
        )
    branches = []
    for row in tables["branch"]:
        start, end = names.get(int(row[0])), names.get(int(row[1]))
        if start is not None and end is not None:
            rating = float(row[5]) or math.inf
            r_pu, x_pu = float(row[2]) / base_mva, float(row[3]) / base_mva
            branches.append(Branch(start, end, r_pu, x_pu, rating, bool(row[10] > 0)))
    load = [
        SourceDevice(f"load{names[int(row[0])]}", names[int(row[0])], float(row[2]), float(row[3]))
        for row in bus
        if row[2] or row[3]
    ]
    reference = {names[int(row[0])] for row in bus if row[1] == _REFERENCE}
    generators = list(_generators(tables.get("gen"), names))
    return Feeder(
        make_network([(names[int(row[0])], float(row[9])) for row in bus], branches),
        load=tuple(load),
        generator=tuple(device for device in generators if device.bus not in reference),
        grid=tuple(device for device in generators if device.bus in reference),
    )


def _generators(gen: Floats | None, names: dict[int, str]) -> Iterator[SourceDevice]:
    rows = [] if gen is None else [row for row in gen if row[7] > 0 and int(row[0]) in names]
    titles = unique_names(f"gen{int(row[0])}" for row in rows)
    for row, title in zip(rows, titles, strict=True):
        yield SourceDevice(title, names[int(row[0])], float(row[8]), v_pu=float(row[5]))
