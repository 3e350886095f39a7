"""From plain data to checked tables: every pydantic error becomes a `Mistake` people can read."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from datetime import date, datetime
from pathlib import Path
from typing import Any, TypeVar, cast

from pydantic import TypeAdapter, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from resilience.case.document import Document, Finding, Place, TomlTable, entry_name
from resilience.case.outages import in_words
from resilience.case.schema import DEVICES, Table
from resilience.errors import did_you_mean, shortened

T = TypeVar("T", bound=Table)

_ALLOWED = {
    "greater_than": "greater than {gt:g}",
    "greater_than_equal": "{ge:g} or more",
    "less_than": "less than {lt:g}",
    "less_than_equal": "{le:g} or less",
    "string_too_short": "a name that is not empty",
    "string_too_long": "{max_length} characters at most",
    "too_long": "{max_length} values at most",
    "string_pattern_mismatch": "letters, digits and _",
    "float_type": "a number",
    "int_type": "a whole number",
    "bool_type": "true or false",
    "string_type": "text in quotes",
    "datetime_type": "a date and time, as in 2016-07-12T00:00:00",
    "finite_number": "a finite number",
    "tuple_type": "a list in brackets",
    "dict_type": "a table",
    "missing": "a value",
}


SMALLEST, LARGEST = 1e-12, 1e12
"""Of any number of a case but 0 and those of profiles, whatever its unit."""


def show(value: object, limit: int = 60) -> str:
    """A value as TOML writes it, cut to `limit` characters."""
    if isinstance(value, bool):
        text = "true" if value else "false"
    elif isinstance(value, str):
        text = f'"{value}"'
    elif isinstance(value, date):
        text = value.isoformat()
    elif isinstance(value, float):
        text = f"{value:.6g}"
    else:
        text = _plain_text(value)
    return shortened(text, limit)


def _plain_text(value: object) -> str:
    try:
        return str(value)
    except (ValueError, RecursionError):  # Python writes no number of more than 4300 digits
        return "more digits or brackets than can be written"


def read_table(
    model: type[T], raw: object, document: Document, table: str, where: Place
) -> tuple[T, bool]:
    """Checks one table; mistakes go to the document.

    An unsound table holds `None` where a value is wrong or missing, so that the rules which do
    not need that value can still be checked.

    Args:
        model: what the table may hold.
        raw: the table as it was read.
        document: the case file.
        table: the table's title in messages: `[[ess]] ess2`.
        where: its place in the file.

    Returns:
        The table, and whether it is sound.
    """
    if not isinstance(raw, dict):
        hint = f"write {table} on a line of its own and the keys below it"
        document.add(where, table, "", show(raw), "a table", hint)
        return _partial(model, {}, set()), False
    try:
        checked = model.model_validate(raw)
        beyond = [] if model.has_any_size else list(_beyond_measure(raw))
        document.add_findings(where, table, beyond)
        return checked, not beyond
    except ValidationError as errors:
        bad = set()
        for error in errors.errors(include_url=False):
            key = str(error["loc"][0])
            bad.add(key)
            if error["type"] == "default_factory_not_called":
                continue  # it follows from another key, whose mistake is noted
            document.add((*where, key), table, *_describe(model, error, raw))
        return _partial(model, raw, bad), False


def _beyond_measure(value: object, key: str = "") -> Iterator[Finding]:
    """Numbers that are none of anything on a feeder, in a table or in what stands in it."""
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _beyond_measure(inner, f"{key}.{name}" if key else str(name))
    elif isinstance(value, list):
        for number, inner in enumerate(value, start=1):
            yield from _beyond_measure(inner, f"{key}[{number}]")
    elif isinstance(value, int | float) and not isinstance(value, bool):
        is_plain = value not in (0, math.inf, -math.inf) and value == value  # noqa: PLR0124 nan
        if is_plain and not SMALLEST <= abs(value) <= LARGEST:
            allowed, hint = f"0, or {SMALLEST:g} to {LARGEST:g}", "is the unit right?"
            yield key, show(value), allowed, hint


def _describe(model: type[Table], error: ErrorDetails, raw: TomlTable) -> Finding:
    """What one pydantic error means."""
    loc, kind = error["loc"], error["type"]
    key = str(loc[0]) + "".join(f"[{i + 1}]" if isinstance(i, int) else f".{i}" for i in loc[1:])
    if kind == "extra_forbidden":
        return (key, *unknown_key(model, key))
    field = _field(model, str(loc[0]))
    about = (field.description if field else None) or "see the case reference"
    if kind == "missing" and len(loc) == 1:
        return key, "nothing", "a value", f"add {key} = ... ({about})"
    allowed = _ALLOWED.get(kind, error["msg"]).format(**error.get("ctx", {}))
    value = show(raw.get(str(loc[0])) if kind == "missing" else error["input"])
    hint = f"{loc[0]} is: {about}"
    if kind in ("float_type", "int_type", "bool_type") and isinstance(error["input"], str):
        hint = f"remove the quotes; {hint}"
    if kind == "less_than_equal" and key == "vn_kv":
        hint = "probably V given as kV; divide by 1000"
    elif kind.startswith("less_than") and 1 in error["ctx"].values() and error["input"] <= 100:
        hint = f"probably percent; divide by 100 ({hint})"
    return key, value, allowed, hint


def unknown_key(model: type[Table], key: str) -> tuple[str, str, str]:
    """`(value, allowed, hint)` for a key that a table does not have."""
    keys = [f.alias or name for name, f in model.model_fields.items()]
    hint = did_you_mean(key, keys)
    return "an unknown key", ", ".join(keys), hint if hint.startswith("did") else "remove it"


def _field(model: type[Table], key: str) -> FieldInfo | None:
    fields = model.model_fields.items()
    return next((field for name, field in fields if key in (name, field.alias)), None)


def _partial(model: type[T], raw: TomlTable, bad: set[str]) -> T:
    """A table with `None` where a value is wrong or missing."""
    values: dict[str, Any] = {}
    for name, field in model.model_fields.items():
        key = field.alias or name
        if key in raw and key not in bad:
            is_name = key in ("name", "bus", "from", "to") and isinstance(raw[key], int)
            values[name] = str(raw[key]) if is_name else _inner(field, raw[key])
        elif key in bad or field.is_required() or field.default_factory_takes_validated_data:
            values[name] = None
        else:
            values[name] = field.get_default(call_default_factory=True)
    return cast(T, model.model_construct(**values))


def _inner(field: FieldInfo, value: object) -> object:
    """A sound value; tables within the table as such."""
    annotation: Any = field.annotation
    holds_more = isinstance(value, dict | list)
    return TypeAdapter(annotation).validate_python(value) if holds_more else value


def read_list(
    model: type[T], kind: str, raw: object, document: Document, where: Place
) -> list[tuple[T, str, bool]]:
    """Checks every entry of `[[kind]]`: tables, their titles, and whether they are sound."""
    if not isinstance(raw, list):
        hint = f"write [[{kind}]] with two brackets"
        document.add(where, f"[{kind}]", "", show(raw), f"a list of tables, [[{kind}]]", hint)
        raw = [raw] if isinstance(raw, dict) else []
    defaults = _defaults(model, kind, document)
    tables = []
    for number, entry in enumerate(raw, start=1):
        name = entry_name(kind, entry) if isinstance(entry, dict) else ""
        title = f"[[{kind}]] {shortened(name) or f'#{number}'}"
        full = defaults | entry if isinstance(entry, dict) else entry
        table, sound = read_table(model, full, document, title, (*where, name))
        tables.append((table, title, sound))
    return tables


def _defaults(model: type[Table], kind: str, document: Document) -> TomlTable:
    """`[defaults.kind]` without its unknown keys, which are mistakes."""
    if kind not in DEVICES:
        return {}
    defaults = document.defaults(kind)
    for key in [key for key in defaults if key not in model.model_fields]:
        where = ("defaults", kind, key)
        document.add(where, f"[defaults.{kind}]", key, *unknown_key(model, key))
    return {key: value for key, value in defaults.items() if key in model.model_fields}


def in_toml(tables: Mapping[str, Any]) -> dict[str, Any]:
    """Tables made in code as TOML would have them.

    Arrays, series and tuples become lists, tables of cases plain ones, a frame of profiles its
    columns, outages their texts, and the start of a horizon a time. What is None is left out.
    """
    data = {str(key): _in_toml(value) for key, value in tables.items() if value is not None}
    outages = tables.get("outages")
    if isinstance(outages, list | tuple):
        data["outages"] = [in_words(entry) for entry in outages]
    time = data.get("time")
    if isinstance(time, dict) and isinstance(time.get("start"), str):
        with suppress(ValueError):  # what is no time is refused where the table is read
            time["start"] = datetime.fromisoformat(time["start"])
    return data


def _in_toml(value: Any) -> Any:
    if isinstance(value, Table):
        value = value.model_dump(
            by_alias=True, exclude_none=True, exclude_unset=True, warnings=False
        )
    if isinstance(value, Mapping):
        return {str(key): _in_toml(inner) for key, inner in value.items() if inner is not None}
    if hasattr(value, "to_pydatetime"):  # a timestamp of pandas
        return value.to_pydatetime()
    if type(value).__name__ == "DataFrame":
        return _in_toml(value.to_dict("list"))
    if hasattr(value, "tolist"):  # arrays, their numbers, and series
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_in_toml(inner) for inner in value]
    return str(value) if isinstance(value, Path) else value
