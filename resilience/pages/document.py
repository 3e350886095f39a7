"""Pages from templates: everything that stands in one is in it, and whatever users named is text.

A page loads nothing: its policy of content forbids that. Templates escape what they print, data
stand in the page as JSON in which no tag can begin, and the script writes text, never markup.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from datetime import datetime
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resilience.arrays import rounded
from resilience.errors import UsageError
from resilience.files import check_file, replacing_file
from resilience.plots import panels, style

if TYPE_CHECKING:
    from jinja2 import Environment

SUFFIXES = (".html", ".htm")
SCRIPTS = ("draw.js", "charts.js", "dots.js", "map.js", "page.js")
DIGITS = 5
"""Significant digits of what is drawn; figures that are read come from the summary as they are."""


def check_page(path: Path) -> None:
    """Refuses a page's file before anything is computed.

    Raises:
        UsageError: the suffix is not that of a page, or it is a folder.
        FileError: it could not be written.
    """
    if path.suffix not in SUFFIXES:
        raise UsageError(
            f"cannot write a page to {path.name!r}; allowed suffixes: {', '.join(SUFFIXES)}",
            hint=f"{path.stem}.html, say",
        )
    check_file(path)


def render(
    template: str, summary: Mapping[str, Any], drawn: Mapping[str, Any], **words: Any
) -> str:
    """A page as text.

    Args:
        template: its name.
        summary: what `--json` prints; it stands in the page as it is.
        drawn: what the script draws: `times`, `charts` and `map`.
        words: what the template prints.
    """
    from resilience import __version__

    return _environment().get_template(template).render(
        summary=summary, drawn=drawn, made=f"{datetime.now():%Y-%m-%d %H:%M}",
        version=__version__, **words,
    )  # fmt: skip


def write(text: str, path: Path) -> Path:
    """Writes a page, whole or not at all.

    Raises:
        FileError: the system refuses.
    """
    with replacing_file(path) as fresh:
        fresh.write_text(text, encoding="utf-8")
    return path


@cache
def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("resilience.pages"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"as_json": as_json, "number": number}
    environment.globals |= {
        "style_sheet": _marked(_static("page.css")),
        "script": _marked("\n".join(map(_static, SCRIPTS))),
        "island_colours": panels.BAND,
        "method_colours": style.METHOD_COLOURS,
    }
    return environment


def _static(name: str) -> str:
    return (files("resilience.pages") / "static" / name).read_text(encoding="utf-8")


def _marked(text: str) -> Any:
    """Text of ours that is markup already."""
    from markupsafe import Markup

    return Markup(text)


def as_json(value: object) -> Any:
    """Data as JSON that may stand in a page's script: no tag, comment or entity begins in it."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    for letter in "<>&":
        text = text.replace(letter, f"\\u{ord(letter):04x}")
    return _marked(text)


def number(value: float | None, digits: int = 2) -> str:
    """`1,234.50`; what is not defined is a dash."""
    if value is None or not math.isfinite(value):
        return "–"
    return f"{round(value, digits) + 0.0:,.{digits}f}"


def plain(values: np.ndarray) -> list[Any]:
    """Numbers as lists, to the digits that can be drawn; what is not defined is None."""
    if values.dtype.kind in "bi":
        return values.astype(int).tolist()
    is_number = np.isfinite(values)
    lists = rounded(np.where(is_number, values, 0.0), DIGITS) + 0.0
    if is_number.all():
        return lists.tolist()
    gaps = lists.astype(object)
    gaps[~is_number] = None
    return gaps.tolist()
