"""How a line runs: its length, whether it lies underground, and the way it takes."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

Points = tuple[tuple[float, float], ...]
_CABLE = "cs"
"""pandapower's `type` of a cable system; an overhead line is `ol`."""


@dataclass(frozen=True)
class Course:
    """How a line runs, as far as the source of its network says.

    Attributes:
        length_km: of the line; None where the source has none.
        underground: it is a cable.
        points: (x, y) along it, ends included, in the coordinates of the buses; empty where the
            source has none.
    """

    length_km: float | None = None
    underground: bool = False
    points: Points = ()


def pandapower_courses(rows: Iterable[Mapping[str, Any]]) -> dict[int, Course]:
    """Courses by index, of the rows of pandapower's table `line`.

    Converters that know impedances in ohm only give every line the same length, 1 km mostly, which
    is none.
    """
    rows = list(rows)
    lengths = {int(row["index"]): _length(row) for row in rows}
    if len(rows) > 1 and len(set(lengths.values())) == 1:
        lengths = dict.fromkeys(lengths)
    return {
        index: Course(length, row.get("type") == _CABLE, _points(row.get("geo")))
        for row, (index, length) in zip(rows, lengths.items(), strict=True)
    }


def _length(row: Mapping[str, Any]) -> float | None:
    value = row.get("length_km")
    usable = isinstance(value, int | float) and math.isfinite(value) and value > 0
    return float(value) if usable else None  # type: ignore[arg-type]


def _points(geo: object) -> Points:
    """The points of a GeoJSON line, or none."""
    try:
        coordinates = json.loads(geo)["coordinates"]  # type: ignore[arg-type]
        points = tuple((float(x), float(y)) for x, y, *_ in coordinates)
    except (KeyError, TypeError, ValueError):
        return ()
    finite = all(math.isfinite(value) for point in points for value in point)
    return points if finite and len(points) > 1 else ()
