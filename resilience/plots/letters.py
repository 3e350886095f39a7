"""Letters of every script: a picture takes them from any installed font that has them."""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from resilience.progress import notice

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MISSING = re.compile(r"Glyph (\d+) ")
"""How matplotlib begins a warning of a letter that its font has not."""
IGNORED = r"Glyph \d+ .* missing from"
_NO_LETTERS = re.compile(r"last ?resort|^cm|stix.*siz|nonunicode", re.IGNORECASE)
"""Fonts of boxes, and of symbols under the codes of letters."""
_MAX_NAMED = 12


def save_figure(figure: Figure, file: Path, name: str, dpi: int) -> None:
    """Writes a figure; letters that no font here has are named once, and drawn as boxes.

    Args:
        figure: what is drawn.
        file: where to.
        name: what the file is called where letters are missing.
        dpi: dots per inch.
    """
    from matplotlib.text import Text

    missing = _saved(figure, file, dpi)
    if missing and (families := families_with(missing)):
        for text in figure.findobj(Text):
            assert isinstance(text, Text)
            text.set_fontfamily([*text.get_fontfamily(), *families])
        missing = _saved(figure, file, dpi)
    if missing:
        letters = "".join(map(chr, sorted(missing)[:_MAX_NAMED]))
        more = " and others" if len(missing) > _MAX_NAMED else ""
        notice(
            f"{name}: no font here has {letters}{more}, drawn as boxes; Noto's fonts have every "
            "script"
        )


def _saved(figure: Figure, file: Path, dpi: int) -> set[int]:
    """Codes of the letters that were missing when the figure was written."""
    missing = set[int]()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        figure.savefig(file, dpi=dpi)
    for warning in caught:
        if match := _MISSING.match(str(warning.message)):
            missing.add(int(match[1]))
        else:
            warnings.warn_explicit(
                warning.message, warning.category, warning.filename, warning.lineno
            )
    return missing


def families_with(codes: set[int]) -> list[str]:
    """Families of installed fonts that together have as many of these letters as any."""
    from matplotlib.font_manager import fontManager, get_font

    letters = dict[str, set[int]]()
    for entry in fontManager.ttflist:
        if entry.name in letters or entry.style != "normal" or _NO_LETTERS.search(entry.name):
            continue
        try:
            letters[entry.name] = codes & get_font(entry.fname).get_charmap().keys()
        except (OSError, RuntimeError):  # a font that is gone, or of a kind that is not read
            continue
    families, missing = list[str](), set(codes)
    while missing:
        name = max(letters, key=lambda name: len(letters[name] & missing), default="")
        if not letters.get(name, set()) & missing:
            break
        families.append(name)
        missing -= letters[name]
    return families
