"""The tables of a pandapower network, read from its JSON without importing pandapower."""

from __future__ import annotations

import importlib.util
import json
import logging
import math
import re
import warnings
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from resilience.case.networks.feeder import FeederError
from resilience.errors import did_you_mean

Row = dict[str, Any]
"""A row of a table by column, with its `index`; JSON tells no more of its values."""
Tables = dict[str, list[Row]]
"""Rows by name of the table; the table `net` has one row, `f_hz` of the network."""

_HINT = "write the file with pandapower.to_json(net, path)"
_NO_ELEMENTS = re.compile(r"res_|_|std_types|.*geodata|measurement|characteristic|group|.*_table$")
"""Tables that say nothing of what there is."""


def tables_of_name(name: str) -> Tables:
    """The tables of a function of `pandapower.networks` that needs no argument.

    Raises:
        FeederError: there is no such network.
    """
    spec = importlib.util.find_spec("pandapower")
    folders = spec.submodule_search_locations if spec else None
    if not folders:
        allowed, hint = "an installed pandapower", "pip install pandapower"
        raise FeederError(("pandapower", repr(name), allowed, hint))
    path = Path(folders[0]) / "networks" / "power_system_test_case_jsons" / f"{name}.json"
    # pandapower moves the reference bus of the RTE cases after reading their file.
    as_filed = path.is_file() and not name.endswith("rte")
    return tables_of_file(path) if as_filed else tables_of_call(name)


def tables_of_file(path: Path) -> Tables:
    """The tables of a file written by `pandapower.to_json`.

    Raises:
        FeederError: it is no such file.
    """
    try:
        return tables_of_content(json.loads(path.read_text(encoding="utf-8"))["_object"])
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        allowed = f"a pandapower network ({error!r})"
        raise FeederError(("file", path.name, allowed, _HINT)) from None


def tables_of_content(content: Mapping[str, Any]) -> Tables:
    """The tables of what `pandapower.to_json` writes, as JSON reads it.

    Raises:
        KeyError, ValueError, TypeError, AttributeError: it is something else.
    """
    frames = {
        name: _body(value)
        for name, value in content.items()
        if isinstance(value, dict)
        and value.get("_class", "DataFrame") == "DataFrame"
        and "_object" in value
        and not _NO_ELEMENTS.match(name)
    }
    tables = {name: _rows(body) for name, body in frames.items() if _is_numbered(body["index"])}
    if "bus" not in tables:
        raise KeyError("bus")
    _take_geodata(tables, content)
    return tables | {"net": [{"index": 0, "f_hz": content.get("f_hz")}]}


def _take_geodata(tables: Tables, content: Mapping[str, Any]) -> None:
    """Puts coordinates into column `geo`, where files before pandapower 3 have tables of them."""
    for kind in ("bus", "line"):
        frame = content.get(f"{kind}_geodata")
        body = _body(frame) if isinstance(frame, dict) else {}
        rows = _rows(body) if _is_numbered(body.get("index", "none")) else []
        geodata = {int(row["index"]): row for row in rows}
        for row in tables.get(kind, []):
            old = geodata.get(int(row["index"]))
            if old is not None and not isinstance(row.get("geo"), str):
                points = [old.get("x"), old.get("y")] if kind == "bus" else old.get("coords")
                row["geo"] = json.dumps({"coordinates": points})


def _body(frame: Row) -> Row:
    body = frame["_object"]
    return dict(json.loads(body) if isinstance(body, str) else body)


def _is_numbered(index: Iterable[Any]) -> bool:
    """Whether a table is one of elements, which have numbers; others have names."""
    return all(re.fullmatch(r"\d+", str(entry)) for entry in index)


def _rows(body: Row) -> list[Row]:
    columns = body["columns"]
    rows = [
        {"index": index, **dict(zip(columns, values, strict=True))}
        for index, values in zip(body["index"], body["data"], strict=True)
    ]
    return sorted(rows, key=lambda row: int(row["index"]))


def tables_of_call(name: str) -> Tables:
    """The tables of a network that pandapower builds with code.

    Raises:
        FeederError: there is no such network, or it needs arguments.
    """
    logger = logging.getLogger("pandapower")
    level = logger.level
    with warnings.catch_warnings():
        # Its power flows warn of missing numba and of features it is about to drop.
        warnings.filterwarnings("ignore", module=r"pandapower\b")
        logger.setLevel(logging.ERROR)
        try:
            net = _built(name)
        finally:
            logger.setLevel(level)
    tables = {
        key: [
            {"index": index, **{str(column): value for column, value in row.items()}}
            for index, row in zip(frame.index.tolist(), frame.to_dict("records"), strict=True)
        ]
        for key, frame in net.items()
        if hasattr(frame, "to_dict")
        and hasattr(frame, "columns")
        and not _NO_ELEMENTS.match(key)
        and _is_numbered(frame.index)
    }
    return tables | {"net": [{"index": 0, "f_hz": net.get("f_hz")}]}


def _built(name: str) -> Mapping[str, Any]:
    import pandapower.networks as library

    builders = {
        key: value
        for key, value in vars(library).items()
        if getattr(value, "__module__", "").startswith(library.__name__) and key[0] != "_"
    }
    if name not in builders:
        hint = did_you_mean(name, builders)
        raise FeederError(("pandapower", f'"{name}"', "a function of pandapower.networks", hint))
    try:
        net: Mapping[str, Any] = builders[name]()
        net["bus"], net["line"]
    except (TypeError, KeyError, IndexError) as error:
        allowed = "a function that needs no argument and returns a network"
        raise FeederError(("pandapower", f'"{name}"', allowed, str(error))) from None
    return net


def number(row: Row, key: str, default: float) -> float:
    """A value of a row; the default where it is missing, NaN or text."""
    value = row.get(key)
    if value is None or isinstance(value, str) or _is_missing(value):
        return default
    return float(value)


def _is_missing(value: Any) -> bool:
    try:
        return math.isnan(value)
    except TypeError:  # pandas' own sign for a missing value
        return True


def active(tables: Tables, kind: str) -> Iterator[Row]:
    """Rows of elements that are in service."""
    return (row for row in tables.get(kind, []) if row.get("in_service", True))


def source_names(rows: list[Row]) -> dict[int, str] | None:
    """The source's names by index, or `None` where they are missing, repeated or numbers."""
    names = [name.strip() for row in rows if isinstance(name := row.get("name"), str)]
    telling = [name for name in names if name and not re.fullmatch(r"\d+(\.0)?", name)]
    if len(set(telling)) < len(rows):
        return None
    return {int(row["index"]): name for row, name in zip(rows, names, strict=True)}


def titles(kind: str, rows: list[Row]) -> dict[int, str]:
    """A name for every row by index: the source's, or the kind and a number."""
    return source_names(rows) or {int(r["index"]): f"{kind}{int(r['index']) + 1}" for r in rows}
