"""The shapes in which ENTSO-E hands out load and generation, told apart by their header.

1. Total load, old website: `Time (CET/CEST)`, `Actual Total Load [MW] - BZN|DE-LU`, ...
2. Generation per type, old website: `Area`, `MTU`, `Solar  - Actual Aggregated [MW]`, ...
3. New website: `MTU (CET/CEST)` and `Actual Total Load (MW)`, or, a row per type of plant,
   `Production Type` and `Generation (MW)`.
4. Bulk files, tab-separated: `DateTime(UTC)`, `AreaMapCode`, `TotalLoad[MW]`, or `ProductionType`
   and `ActualGenerationOutput[MW]`.

And a plain one: `time_utc`, `load_mw`, `solar_mw`. A column that no shape knows is refused.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from resilience.errors import UsageError
from resilience.inputs import read_table

if TYPE_CHECKING:
    import pandas as pd

LOAD, SOLAR = "load", "solar"
AREA_COLUMNS = ("Area", "AreaCode", "AreaDisplayName", "AreaTypeCode", "AreaMapCode")
FORECAST = "Day-ahead Total Load Forecast [MW]"


@dataclass(frozen=True)
class Shape:
    """One shape of file; names of columns are as `plain_name` writes them.

    Attributes:
        about: what it is called in messages.
        start: matches the column of times; its group `zone` is their clock.
        values: column to the series in it; of a type of plant where there is a column of types.
        kinds: name of the column of types of plants; empty where columns are types.
        ignored: matches all other columns that it may have.
    """

    about: str
    start: str
    values: dict[str, str]
    kinds: str = ""
    ignored: str = ""


SHAPES = (
    Shape(
        "total load, old website",
        r"Time \((?P<zone>[\w/]+)\)",
        {"Actual Total Load [MW]": LOAD},
        ignored=re.escape(FORECAST),
    ),
    Shape(
        "generation, old website",
        r"MTU",
        {"Solar - Actual Aggregated [MW]": SOLAR},
        ignored=r".+ - Actual (Aggregated|Consumption) \[MW\]",
    ),
    Shape(
        "generation, new website",
        r"MTU \((?P<zone>[\w/]+)\)",
        {"Generation [MW]": SOLAR},
        kinds="Production Type",
        ignored=r"Consumption \[MW\]",
    ),
    Shape(
        "total load, new website",
        r"MTU \((?P<zone>[\w/]+)\)",
        {"Actual Total Load [MW]": LOAD},
        ignored=re.escape(FORECAST),
    ),
    Shape(
        "generation, bulk",
        r"DateTime ?\((?P<zone>UTC)\)",
        {"ActualGenerationOutput [MW]": SOLAR},
        kinds="ProductionType",
        ignored=r"ResolutionCode|UpdateTime ?\(UTC\)|ActualConsumption \[MW\]",
    ),
    Shape(
        "total load, bulk",
        r"DateTime ?\((?P<zone>UTC)\)",
        {"TotalLoad [MW]": LOAD},
        ignored=r"ResolutionCode|UpdateTime ?\(UTC\)",
    ),
    Shape(
        "plain",
        r"time_(?P<zone>utc)",
        {"load_mw": LOAD, "solar_mw": SOLAR},
        ignored="load_dayahead_forecast_mw|solar_mw_hourly_mean",
    ),
)


@dataclass(frozen=True)
class Export:
    """The rows of a file that matter, as text.

    Attributes:
        path: of the file.
        starts: (rows,) when each slot begins, as the file writes it.
        zone: the clock of the whole column, as `CET/CEST`; empty where every row says its own.
        cells: series to its (rows,) cells.
        number: what the text of a cell states; None where that is no number.
    """

    path: Path
    starts: pd.Series[str]
    zone: str
    cells: dict[str, pd.Series[str]]
    number: Callable[[str], float | None]


def read_export(path: Path, area: str | None = None) -> Export:
    """A file of one of the shapes.

    Args:
        path: CSV or tab-separated, maybe with `.gz`.
        area: name or code of the area, where the file has several.

    Raises:
        UsageError: it cannot be read, has a column that is not known, or several areas.
    """
    import pandas as pd

    text = read_table(path)
    columns = [plain_name(column) for column in text.columns]
    _check_names(path, columns)
    table = pd.DataFrame(list(text.rows), columns=columns, dtype=str)
    shape, start = _shape_of(path, list(table.columns))
    _check_columns(path, shape, start, list(table.columns))
    table = _of_area(path, table, area)
    values = {column: name for column, name in shape.values.items() if column in table}
    if shape.kinds:
        solar = table[shape.kinds].str.strip() == "Solar"
        if not solar.any():
            types = ", ".join(sorted(set(table[shape.kinds].str.strip())))
            raise UsageError(
                f"{path}: no rows of `Solar` under {shape.kinds}, but {types}",
                hint="export the generation of solar plants",
            )
        table = table[solar]
    matched = re.fullmatch(shape.start, start)
    zone = (matched and matched.groupdict().get("zone")) or ""
    cells = {name: table[column].str.strip() for column, name in values.items()}
    return Export(path, table[start].str.strip(), zone.upper(), cells, text.number)


def plain_name(column: str) -> str:
    """A column's name with one blank between words, `[MW]` for the unit, and without the area."""
    name = re.sub(r"\s+", " ", column.strip().strip('"'))
    name = re.sub(r" - \w+\|.*$", "", name)
    return re.sub(r" ?[\[(]MW[\])]", " [MW]", name)


def _check_names(path: Path, columns: list[str]) -> None:
    """Refuses two columns that are one, but for the name of the area and the blanks."""
    twice = sorted({column for column in columns if columns.count(column) > 1 and column})
    if twice:
        raise UsageError(
            f"{path}: the columns {', '.join(twice)} twice; allowed: every column once",
            hint="leave one out; of areas there is only one to a file of columns",
        )


def _shape_of(path: Path, columns: list[str]) -> tuple[Shape, str]:
    """The shape of a header, and its column of times."""
    matching = [
        (shape, column)
        for shape in SHAPES
        for column in columns
        if re.fullmatch(shape.start, column)
    ]
    for shape, column in matching:
        has_values = any(name in columns for name in shape.values)
        if has_values and shape.kinds in (*columns, ""):
            return shape, column
    if matching:
        allowed = " or ".join(name for shape, _ in matching for name in shape.values)
        raise UsageError(
            f"{path} has the columns {', '.join(columns)}; allowed: one of them is {allowed}",
            hint="export the actual total load, or the generation per type, in MW",
        )
    raise UsageError(
        f"{path} has the columns {', '.join(columns)}, no shape of ENTSO-E; allowed: "
        + "; ".join(f"{shape.about}: {', '.join(shape.values)}" for shape in SHAPES),
        hint="export the actual total load, or the generation per type, as CSV",
    )


def _check_columns(path: Path, shape: Shape, start: str, columns: list[str]) -> None:
    allowed = {start, *shape.values, *AREA_COLUMNS, shape.kinds}
    unknown = [c for c in columns if c not in allowed and not re.fullmatch(shape.ignored, c)]
    if unknown:
        raise UsageError(
            f"{path} ({shape.about}) has the unknown columns {', '.join(unknown)}",
            hint="delete them; of units there is only MW",
        )


def _of_area(path: Path, table: pd.DataFrame, area: str | None) -> pd.DataFrame:
    """The rows of one area."""
    columns = [column for column in AREA_COLUMNS if column in table]
    if not columns:
        return table
    labels = table[columns].agg(" ".join, axis=1)
    if area is not None:
        chosen = (table[columns] == area).any(axis=1) | (labels == area)
        table, labels = table[chosen], labels[chosen]
    names = sorted(set(labels))
    if len(names) != 1:
        text = "; ".join(names) or f"none called {area!r}"
        raise UsageError(
            f"{path} has the areas {text}; allowed: one", hint="name it with --area, as DE_LU"
        )
    return table
