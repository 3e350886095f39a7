"""A plan as a workbook for spreadsheets."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from resilience.errors import UsageError
from resilience.extras import need
from resilience.files import check_file, replacing_file

if TYPE_CHECKING:
    import pandas as pd

LEFT_OUT = ("variables",)
"""Tables with more columns than anybody reads."""


def check_workbook(path: Path) -> None:
    """Refuses to write a workbook before it is made.

    Raises:
        UsageError: openpyxl is missing, or another ending than .xlsx.
        FileError: it could not be written.
    """
    need("excel", "a workbook", "openpyxl")
    if path.suffix.lower() != ".xlsx":
        raise UsageError(f"{path.name} is no workbook; allowed: a name in .xlsx", "plan.xlsx")
    check_file(path)


def write_workbook(path: Path, sheets: Mapping[str, pd.DataFrame]) -> None:
    """Writes tables as .xlsx, a sheet each. Texts stay texts, also where they begin as formulas do.

    Raises:
        FileError: the system refuses.
    """
    import pandas as pd

    with replacing_file(path) as fresh, pd.ExcelWriter(fresh, engine="openpyxl") as writer:
        for name, frame in sheets.items():
            frame.to_excel(writer, sheet_name=name, index=isinstance(frame.index, pd.DatetimeIndex))
        for sheet in writer.book.worksheets:
            formulas = (cell for row in sheet.iter_rows() for cell in row if cell.data_type == "f")
            for cell in formulas:
                cell.data_type = "s"
