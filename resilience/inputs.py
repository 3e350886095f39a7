"""Files that are read: where they may lie, their bytes, their text, and tables in them.

Every reader begins here, so that all of them say the same of a file that is missing, may not be
read, is no text in UTF-8, or holds a table with ragged rows.

`RESILIENCE_ROOT` is for those who run the package as a service: where it is set, files are read
only below the folders that it names (several with `:` between them, `;` on Windows) and below the
cases that come with the package. Links are followed before that is decided.
"""

from __future__ import annotations

import csv
import gzip
import io
import os
import re
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from resilience.errors import Mistake, UsageError, shortened

ROOT_VARIABLE = "RESILIENCE_ROOT"
MAX_BYTES = 2**29
"""Of a file that is read as a whole, unpacked."""
_PACKAGE = Path(__file__).parent
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_COMMA_NUMBER = re.compile(r"[+-]?\d+,\d+([eE][+-]?\d+)?", re.ASCII)
_WORD = re.compile(r"[+-]?(nan|inf|infinity)", re.IGNORECASE | re.ASCII)
_SEPARATORS = ";\t,"


class InputFileError(UsageError):
    """A file that cannot be read, or does not hold what it should.

    Args:
        path: of the file.
        place: where in it, as `row 3`; empty: the whole file.
        value: what was found there.
        allowed: what may stand there.
        hint: what to do about it.
    """

    def __init__(self, path: str, place: str, value: str, allowed: str, hint: str) -> None:
        where = f"{path}, {place}" if place else path
        super().__init__(f"{where}: {value}; allowed: {allowed}", hint)
        self.mistake = Mistake(path, place, "", value, allowed, hint)
        self.args = (path, place, value, allowed, hint)


class MissingFileError(InputFileError):
    """A file that does not exist."""


def case_folder() -> Path:
    """The folder of the cases that come with the package, or with a source checkout."""
    installed = _PACKAGE / "_cases"
    return installed if installed.is_dir() else _PACKAGE.parent / "cases"


def checked_path(path: Path) -> Path:
    """A file that is there and may be read, its links followed.

    Raises:
        InputFileError: it lies elsewhere than `RESILIENCE_ROOT` says, does not exist, is no plain
            file, or has a name that no file can have.
    """
    hint = "in a case, paths start at the case file's folder"
    try:
        check_root(path)
        resolved = path.resolve()
        if resolved.is_file():
            return resolved
        if not resolved.exists():
            raise MissingFileError(
                shown_name(path), "", "does not exist", "a file that exists", hint
            )
        value = "is no plain file"
    except (OSError, ValueError, RuntimeError) as error:
        value = f"cannot be looked at ({getattr(error, 'strerror', None) or error})"
    raise InputFileError(shown_name(path), "", value, "a plain file", hint)


def check_root(path: Path) -> None:
    """Refuses what lies elsewhere than `RESILIENCE_ROOT` says, whether it exists or not.

    Raises:
        InputFileError: it does.
    """
    roots = [Path(root) for root in os.environ.get(ROOT_VARIABLE, "").split(os.pathsep) if root]
    resolved = path.resolve() if roots else path
    folders = [root.resolve() for root in (*roots, case_folder())]
    if roots and not any(resolved.is_relative_to(folder) for folder in folders):
        hint = f"move the file there; {ROOT_VARIABLE} is set by whoever runs this service"
        allowed = f"a file below the folders of {ROOT_VARIABLE}"
        raise InputFileError(shown_name(path), "", "lies elsewhere", allowed, hint)


def shown_name(path: Path | str, limit: int = 200) -> str:
    """A path for messages: in one line, and no longer than a name can be."""
    text = "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in str(path))
    return text if len(text) <= limit else f"{text[: limit // 2]}...{text[-limit // 2 :]}"


def read_bytes(path: Path) -> bytes:
    """What a file holds; what a `.gz` file holds, unpacked.

    Raises:
        InputFileError: it cannot be read, is damaged, or is larger than `MAX_BYTES`.
    """
    file, name = checked_path(path), shown_name(path)
    try:
        with gzip.open(file) if file.suffix == ".gz" else file.open("rb") as stream:
            data = stream.read(MAX_BYTES + 1)
    except (zlib.error, gzip.BadGzipFile, EOFError) as error:
        value, hint = f"cannot be unpacked ({error})", "it is damaged: copy it again"
        raise InputFileError(name, "", value, "a whole file", hint) from None
    except OSError as error:
        value = f"cannot be read ({error.strerror or error})"
        raise InputFileError(name, "", value, "a readable file", "look at its rights") from None
    if len(data) > MAX_BYTES:
        allowed, hint = f"{MAX_BYTES:,} bytes at most", "leave out what is not needed"
        raise InputFileError(name, "", f"more than {MAX_BYTES:,} bytes", allowed, hint)
    return data


def read_text(path: Path) -> str:
    """The text of a file in UTF-8, with or without a byte order mark.

    Raises:
        InputFileError: it cannot be read, or is no such text; the row is named.
    """
    return decoded(read_bytes(path), shown_name(path))


def decoded(data: bytes, name: str) -> str:
    """Bytes as text in UTF-8, every line ended by one line feed.

    Raises:
        InputFileError: they are none; the row is named.
    """
    allowed, hint = "UTF-8 text", "damaged, or in another encoding: save it as CSV in UTF-8"
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        row = len(re.split(rb"\r\n|\r|\n", data[: error.start]))
        value = f"the byte {data[error.start]:#04x}"
        raise InputFileError(name, f"row {row}", value, allowed, hint) from None
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    if (place := text.find("\0")) >= 0:
        row = text.count("\n", 0, place) + 1
        raise InputFileError(name, f"row {row}", "a NUL character", allowed, hint)
    return text


@dataclass(frozen=True)
class TextTable:
    """A table of a CSV file; its cells are text without blanks around them.

    Attributes:
        name: of the file, for messages.
        columns: the heading, in the order of the cells.
        rows: as many cells as the heading has, each.
        numbers: (rows,) the line of the file in which each row ends, from 1.
        has_decimal_commas: whether its numbers have a comma where others have a point.
    """

    name: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    numbers: tuple[int, ...]
    has_decimal_commas: bool

    def cells(self, column: str) -> tuple[str, ...]:
        """(rows,) what stands under a heading."""
        k = self.columns.index(column)
        return tuple(row[k] for row in self.rows)

    def number(self, text: str) -> float | None:
        """The number that a cell states, `nan` and `inf` included; None where it states none.

        Among decimal commas a point separates thousands, or is a slip: no number, either.
        """
        if self.has_decimal_commas and "." in text:
            return None
        return to_number(text.replace(",", ".") if self.has_decimal_commas else text)

    def records(self) -> list[dict[str, str]]:
        """The rows by column."""
        return [dict(zip(self.columns, row, strict=True)) for row in self.rows]


def read_table(path: Path, *, is_padded: bool = False) -> TextTable:
    """A CSV file with a heading; empty rows, and rows that begin with `#`, are left out.

    Cells are separated by commas, by semicolons, as spreadsheets write where a comma is the decimal
    sign, or by tabulators: whatever the heading has most of.

    Args:
        path: of the file, maybe with `.gz`.
        is_padded: whether a row may have fewer cells than the heading; they are empty then.

    Raises:
        InputFileError: it is no such file; the row is named.
    """
    name, text = shown_name(path), read_text(path)
    first = next((line for line in text.split("\n") if line.strip() and line[0] != "#"), "")
    separator = separator_of(first)
    reader = csv.reader(io.StringIO(text), delimiter=separator, strict=True)
    rows, numbers = list[tuple[str, ...]](), list[int]()
    try:
        for row in reader:
            if any(cell.strip() for cell in row) and not row[0].startswith("#"):
                rows.append(tuple(cell.strip() for cell in row))
                numbers.append(reader.line_num)
    except csv.Error as error:
        allowed, hint = "rows of cells", "is a quotation mark missing, or is it another file?"
        raise InputFileError(name, f"row {reader.line_num}", str(error), allowed, hint) from None
    columns = rows[0] if rows else ()
    _check_heading(name, columns)
    cells = [_fitted(name, number, row, len(columns), is_padded)
             for number, row in zip(numbers[1:], rows[1:], strict=True)]  # fmt: skip
    has_commas = has_decimal_commas(cells, separator)
    return TextTable(name, columns, tuple(cells), tuple(numbers[1:]), has_commas)


def separator_of(heading: str) -> str:
    """What separates the cells of a table: of comma, semicolon and tabulator the most frequent."""
    bare = re.sub(r'"[^"]*"', "", heading)
    separator = max(_SEPARATORS, key=bare.count)
    return separator if separator in bare else ","


def has_decimal_commas(rows: Iterable[Sequence[str]], separator: str) -> bool:
    """Whether numbers among these cells have a comma where others have a point."""
    return separator != "," and any(
        _COMMA_NUMBER.fullmatch(cell.strip()) for row in rows for cell in row
    )


def _check_heading(name: str, columns: tuple[str, ...]) -> None:
    twice = [column for k, column in enumerate(columns) if column and column in columns[:k]]
    if twice:
        value, hint = f"the heading {shortened(twice[0])!r} twice", "rename one, or leave it out"
        raise InputFileError(name, "heading", value, "headings once each", hint)


def _fitted(
    name: str, number: int, row: tuple[str, ...], count: int, is_padded: bool
) -> tuple[str, ...]:
    """A row with as many cells as the heading."""
    if len(row) > count and not any(row[count:]):
        row = row[:count]
    if len(row) > count or (len(row) < count and not is_padded):
        allowed = f"{count}, as the heading"
        hint = "a separator is missing or too many; with commas between cells, decimals take points"
        raise InputFileError(name, f"row {number}", f"{len(row)} cells", allowed, hint)
    return row + ("",) * (count - len(row))


def to_number(text: str) -> float | None:
    """The number that a text states, `nan` and `inf` included; None where it states none.

    Python's own reading takes digits of every script and underscores between them, too.
    """
    return float(text) if _NUMBER.fullmatch(text) or _WORD.fullmatch(text) else None
