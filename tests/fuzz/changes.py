"""What is done to a file: its data, its text, its bytes, a thing or a few at a time."""

from __future__ import annotations

import copy
import io
import json
import re
import warnings
from collections.abc import Iterator, Mapping
from contextlib import suppress
from datetime import date, datetime, timedelta, timezone
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from hypothesis import strategies as st

Place = tuple[Any, ...]

TEXTS = (
    "", " ", "x", "0", "1.5", "1,5", "-1", "nan", "inf", "none", "true", "[/x]", "[red]",
    "$\\frac{$", "台风", "Ünwetter", "\u202e", "a\nb", "a\tb", "\x1b[31m", "1-2", "ess1", "12:00",
    "24:00", "25:61", "2016-07-12T00:00:00+08:00", "d9999999999 00:00", "1-2@00:15-00:45", "..",
    "/etc/passwd", "%s{}", ":x:",
    "x" * 300, "9" * 400, "1_000", "١٢", "None", "=1+1", "#", ";", '"', "'", "\\",
)  # fmt: skip
NUMBERS = (
    0, 1, -1, 2, 50, 95, 10**6, 10**30, -(10**30), 2**63, 0.0, -0.0, 0.5, 1e-9, 1e-300, -1e-300,
    5e-324, 1e12, 1e300, -1e300, 1.7e308, float("nan"), float("inf"), float("-inf"), True, False,
)  # fmt: skip
TIMES = (
    datetime(1, 1, 1), datetime(9999, 12, 31, 23, 59), datetime(2016, 7, 12, 0, 0, 0, 1),
    datetime(2016, 7, 12, tzinfo=timezone(timedelta(hours=8))), date(2016, 7, 12), date(1, 1, 1),
)  # fmt: skip
KEYS = (
    "",
    " ",
    "name",
    "x",
    "from_",
    "__class__",
    "hardning",
    "e_mhw",
    "[/x]",
    "台风",
    "type",
    "0",
)
ENDINGS = ("+08:00", "Z", " 00:00", ":00", "%", " MW", "e9")
DEPTHS = (1, 3, 30, 90, 400)


def nested(draw: st.DrawFn) -> Any:
    """Brackets in brackets."""
    value: Any = draw(st.sampled_from((0, "x", ())))
    kind = draw(st.sampled_from(("list", "dict", "both")))
    for k in range(draw(st.sampled_from(DEPTHS))):
        value = [value] if kind == "list" or (kind == "both" and k % 2) else {"x": value}
    return value


def places(value: Any, place: Place = ()) -> Iterator[Place]:
    """Where something stands in data, outermost first."""
    yield place
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from places(inner, (*place, key))
    elif isinstance(value, list):
        for k, inner in enumerate(value):
            yield from places(inner, (*place, k))


def at_place(data: Any, place: Place) -> Any:
    for key in place:
        data = data[key]
    return data


def _swapped(draw: st.DrawFn, old: Any) -> Any:
    """The same in another type."""
    swaps: list[Any] = [[old], {"x": old}, [], {}, str(old)[:50]]
    if isinstance(old, Mapping):
        swaps += [list(old.values()), [old, old]]
    if isinstance(old, list):
        swaps += [dict(enumerate(map(str, old))), old[:1], old + old, old[::-1]]
    if isinstance(old, str):
        swaps += [old.upper(), old + " ", old[:-1], re.sub(r"[^\d.-]", "", old)]
    if isinstance(old, int | float) and not isinstance(old, bool):
        swaps += [old * 1000.0, old * 100.0, -old, old + 0.5, f"{old} MW"]
    return draw(st.sampled_from(swaps))


def _with_typo(draw: st.DrawFn, data: Any, table: Place) -> None:
    """Puts an unknown key beside those of a table."""
    keys = [key for key in at_place(data, table) if isinstance(key, str)]
    typos = [key[:-1] for key in keys] + [key + "s" for key in keys] + [key.upper() for key in keys]
    key = draw(st.sampled_from([*KEYS, *typos]))
    at_place(data, table)[key] = draw(st.sampled_from([*TEXTS, *NUMBERS]))


@st.composite
def data_changed(draw: st.DrawFn, data: Any, times: bool = False) -> Any:
    """Data with one to three changes.

    Args:
        draw: of hypothesis.
        data: tables, lists and values.
        times: whether dates are among what may stand there.
    """
    data = copy.deepcopy(data)
    values = [*TEXTS, *NUMBERS, *(TIMES if times else ()), [], {}, [[]], [1, "x"]]
    for _ in range(draw(st.integers(1, 3))):
        every = list(places(data))
        tables = [place for place in every if isinstance(at_place(data, place), dict)]
        inner = every[1:]
        if not inner:
            break
        place = draw(st.sampled_from(inner))
        *outer, key = place
        parent = at_place(data, tuple(outer))
        match draw(st.sampled_from(("delete", "swap", "extreme", "key", "twin", "nest", "move"))):
            case "delete":
                del parent[key]
            case "swap":
                parent[key] = _swapped(draw, parent[key])
            case "extreme":
                parent[key] = copy.deepcopy(draw(st.sampled_from(values)))
            case "key" if tables:
                _with_typo(draw, data, draw(st.sampled_from(tables)))
            case "twin" if isinstance(parent, list):
                parent.insert(key, copy.deepcopy(parent[key]))
            case "nest":
                parent[key] = nested(draw)
            case "move":
                parent[key] = copy.deepcopy(at_place(data, draw(st.sampled_from(inner))))
    return data


JUNK = (
    b"\0", b"\xff", b"\xe9", b"\r", b"\r\n", b"\n\n", b"\xef\xbb\xbf", b"\xff\xfe", b'"', b",",
    b";", b"#", b"%", b"\t", b"[", b"{", b"=", b"-", b"9" * 30, b"1e400", b"nan", b"'",
    b"x" * 200_000, "台风".encode(), b"+08:00", b"1_0", b"^9999999", b"...",
)  # fmt: skip


@st.composite
def bytes_changed(draw: st.DrawFn, data: bytes) -> bytes:
    """Bytes with one to three changes."""
    for _ in range(draw(st.integers(1, 3))):
        k = draw(st.integers(0, max(len(data) - 1, 0)))
        match draw(st.sampled_from(("cut", "lose", "flip", "add", "repeat", "endings", "code"))):
            case "cut":
                data = data[:k]
            case "lose":
                data = data[:k] + data[k + draw(st.integers(1, 40)) :]
            case "flip":
                data = data[:k] + draw(st.binary(min_size=1, max_size=4)) + data[k + 1 :]
            case "add":
                data = data[:k] + draw(st.sampled_from(JUNK)) + data[k:]
            case "repeat":
                data = data[:k] + data[k : k + draw(st.integers(1, 400))] + data[k:]
            case "endings":
                data = data.replace(b"\n", draw(st.sampled_from((b"\r", b"\r\n", b"\n\n", b""))))
            case "code":
                text = data.decode("utf-8", "replace")
                data = text.encode(
                    draw(st.sampled_from(("utf-16", "latin-1", "utf-8-sig"))), "replace"
                )
    return data


@st.composite
def table_changed(draw: st.DrawFn, text: str, separator: str = ",") -> bytes:
    """A text table with changes of its cells, rows, columns and separators; sometimes of bytes."""
    rows = [line.split(separator) for line in text.strip("\n").split("\n")]
    for _ in range(draw(st.integers(1, 3))):
        rows = _rows_changed(draw, rows)
    joined = draw(st.sampled_from((separator,) * 4 + (";", "\t", ",")))
    data = "\n".join(joined.join(row) for row in rows).encode()
    if joined == ";" and draw(st.booleans()):
        data = data.replace(b".", b",")
    return draw(bytes_changed(data)) if draw(st.integers(0, 3)) == 0 else data


def _rows_changed(draw: st.DrawFn, rows: list[list[str]]) -> list[list[str]]:
    """Rows with one change."""
    r = draw(st.integers(0, len(rows) - 1))
    c = draw(st.integers(0, max(len(rows[r]) - 1, 0)))
    cells = (*TEXTS, *map(str, NUMBERS), "y" * 200_000)
    match draw(st.sampled_from(("cell", "row", "twin", "short", "long", "column", "swap", "zone"))):
        case "cell" if rows[r]:
            rows[r][c] = draw(st.sampled_from(cells))
        case "row" if len(rows) > 1:
            del rows[r]
        case "twin":
            rows.insert(r, list(rows[r]))
        case "short":
            rows[r] = rows[r][:c]
        case "long":
            rows[r] = [*rows[r], draw(st.sampled_from(TEXTS))]
        case "column":
            rows = [[*row, *row[c : c + 1]] for row in rows]
        case "swap":
            rows.append(rows.pop(r))
        case "zone" if rows[r]:
            rows[r][c] += draw(st.sampled_from(ENDINGS))
    return rows


TOKEN = re.compile(r"[\w.+-]+|\S")


@st.composite
def words_changed(draw: st.DrawFn, text: str) -> bytes:
    """A text of words with changes of single words; sometimes of bytes."""
    for _ in range(draw(st.integers(1, 3))):
        words = list(TOKEN.finditer(text))
        if not words:
            break
        word = draw(st.sampled_from(words))
        other = draw(st.sampled_from([*TEXTS, *map(str, NUMBERS), *(w[0] for w in words[:60])]))
        text = text[: word.start()] + other + text[word.end() :]
    data = text.encode("utf-8", "replace")
    return draw(bytes_changed(data)) if draw(st.integers(0, 3)) == 0 else data


@st.composite
def arrays_changed(draw: st.DrawFn, arrays: Mapping[str, Any], facts: str = "") -> bytes:
    """An .npz file of arrays with one or two changes; sometimes of bytes.

    Args:
        draw: of hypothesis.
        arrays: by name.
        facts: name of one that holds JSON, which is changed as data.
    """
    changed: dict[str, Any] = dict(arrays)
    for _ in range(draw(st.integers(1, 2))):
        name = draw(st.sampled_from(sorted(arrays)))
        if name == facts:
            text = json.dumps(draw(data_changed(json.loads(str(arrays[name])))), default=str)
            changed[name] = np.array(text)
        elif draw(st.integers(0, 9)) == 0:
            changed.pop(name, None)
        else:
            changed[name] = draw(array_changed(arrays[name]))
    file = io.BytesIO()
    writer = draw(st.sampled_from((np.savez, np.savez_compressed)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        writer(file, **changed)
    data = file.getvalue()
    return draw(bytes_changed(data)) if draw(st.integers(0, 2)) == 0 else data


@st.composite
def array_changed(draw: st.DrawFn, array: np.ndarray) -> np.ndarray:
    """An array of another shape or kind, or with another number in it."""
    kinds = ("i1", "u8", "f4", "f8", "c16", "b1", "U3", "S5", "O", "M8[s]")
    shapes = ((-1,), (1, -1), (-1, 1), (1, 1, 1, -1))
    changed = array
    match draw(st.sampled_from(("number", "kind", "flat", "cut", "grown", "single", "empty"))):
        case "number" if array.size and array.dtype.kind in "fiu":
            changed = array.astype(float)
            number = float(draw(st.sampled_from(NUMBERS)))
            changed.flat[draw(st.integers(0, array.size - 1))] = number
        case "kind":
            with warnings.catch_warnings(), suppress(ValueError, TypeError, OverflowError):
                warnings.simplefilter("ignore")
                changed = array.astype(draw(st.sampled_from(kinds)))
        case "flat":
            changed = array.reshape(draw(st.sampled_from(shapes)))
        case "cut" if array.ndim:
            changed = array[:-1]
        case "grown" if array.ndim:
            changed = np.concatenate([array, array])
        case "single":
            changed = np.array(draw(st.sampled_from([*TEXTS[:20], *NUMBERS])))
        case "empty":
            changed = np.zeros(draw(st.sampled_from(((0,), (0, 3), (3, 0, 2)))))
    return changed


@st.composite
def parquet_changed(draw: st.DrawFn, data: bytes) -> bytes:
    """A Parquet file with another column or cell; or with other bytes."""
    if draw(st.integers(0, 2)) == 0:
        return draw(bytes_changed(data))
    table = pq.read_table(io.BytesIO(data))
    columns = dict(zip(table.column_names, table.columns, strict=True))
    name = draw(st.sampled_from(table.column_names))
    cells = columns[name].to_pylist()
    match draw(st.sampled_from(("drop", "rename", "cell", "type", "short", "twin"))):
        case "drop":
            del columns[name]
        case "rename":
            columns = {
                (draw(st.sampled_from(KEYS)) if k == name else k): v for k, v in columns.items()
            }
        case "cell" if cells:
            cells[draw(st.integers(0, len(cells) - 1))] = draw(
                st.sampled_from((None, float("nan"), float("inf"), -1.0, 1e300, 50.0))
            )
        case "type":
            cells = [
                draw(st.sampled_from((str, repr, lambda x: None, lambda x: [x])))(x) for x in cells
            ]
        case "short":
            columns = {k: v[:-1] for k, v in columns.items()}
        case "twin":
            columns[name + " "] = columns[name]
    try:
        if name in columns and cells != table.column(name).to_pylist():
            columns[name] = pa.array(cells)
        changed = pa.table(columns)
    except (pa.ArrowException, TypeError, ValueError, OverflowError):
        return draw(bytes_changed(data))
    file = io.BytesIO()
    pq.write_table(changed.replace_schema_metadata(table.schema.metadata), file)
    return file.getvalue()
