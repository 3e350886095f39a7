"""What differs between two cases, key by key, as their files would say it."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from resilience.case import Case, case_text


@dataclass(frozen=True)
class KeyChange:
    """A key of a case whose value is another.

    Attributes:
        key: where it is, as `ess battery e_mwh`.
        before, after: the values as text; None where the key is not there.
    """

    key: str
    before: str | None
    after: str | None


def case_changes(before: Case, after: Case) -> list[KeyChange]:
    """Every key that differs, in the order of the case files; profiles by their means."""
    old, new = (dict(_flat(tomllib.loads(case_text(case)))) for case in (before, after))
    keys = list(dict.fromkeys([*old, *new]))
    return [
        KeyChange(key, _text(old.get(key)), _text(new.get(key)))
        for key in keys
        if old.get(key) != new.get(key)
    ]


def _flat(data: dict[str, Any], where: str = "") -> Iterator[tuple[str, Any]]:
    """Keys with their whole path; tables in lists are known by their names."""
    for key, value in data.items():
        path = f"{where} {key}".strip()
        if isinstance(value, dict):
            yield from _flat(value, path)
        elif isinstance(value, list) and value and all(isinstance(item, dict) for item in value):
            for k, item in enumerate(value):
                name = item.get("name") or _ends(item) or f"#{k + 1}"
                yield f"{path} {name}", "there"
                fields = {key: field for key, field in item.items() if key != "name"}
                yield from _flat(fields, f"{path} {name}")
        else:
            yield path, value


def _ends(table: dict[str, Any]) -> str:
    return f"{table['from']}-{table['to']}" if {"from", "to"} <= table.keys() else ""


def _text(value: Any) -> str | None:
    """A value as a case file has it; of a long list of numbers its length and mean."""
    if value is None:
        return None
    if (
        isinstance(value, list)
        and len(value) > 8
        and all(isinstance(v, int | float) for v in value)
    ):
        return f"{len(value)} values, mean {np.mean(value):.6g}"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return ", ".join(map(str, value)) or "none"
    return str(value)
