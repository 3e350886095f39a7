"""Letters that the usual font has not: taken from another font, or named once."""

from __future__ import annotations

from pathlib import Path

import pytest
from fontTools.fontBuilder import FontBuilder
from fontTools.pens.ttGlyphPen import TTGlyphPen
from matplotlib import font_manager
from matplotlib.figure import Figure
from matplotlib.text import Text

from resilience.plots.letters import families_with
from resilience.plots.style import look, write_figure
from resilience.progress import NOTICE

PRIVATE = "\ue123"
"""A letter for private use, which no font of an operating system has."""


def square() -> object:
    pen = TTGlyphPen(None)
    pen.moveTo((0, 0))
    for corner in ((0, 700), (700, 700), (700, 0)):
        pen.lineTo(corner)
    pen.closePath()
    return pen.glyph()


@pytest.fixture
def private_font(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A font, known to matplotlib, whose only letter is a square for `PRIVATE`."""
    builder = FontBuilder(1000, isTTF=True)
    builder.setupGlyphOrder([".notdef", "square"])
    builder.setupCharacterMap({ord(PRIVATE): "square"})
    builder.setupGlyf({".notdef": square(), "square": square()})
    builder.setupHorizontalMetrics({".notdef": (800, 0), "square": (800, 0)})
    builder.setupHorizontalHeader(ascent=800, descent=-200)
    builder.setupNameTable({"familyName": "Private Letters", "styleName": "Regular"})
    builder.setupOS2()
    builder.setupPost()
    path = tmp_path / "private.ttf"
    builder.save(path)
    monkeypatch.setattr(font_manager.fontManager, "ttflist", [*font_manager.fontManager.ttflist])
    font_manager.fontManager.addfont(path)
    return "Private Letters"


def written(path: Path, title: str) -> list[str]:
    """The families of the title of a picture with another text, once it is written."""
    with look():
        figure = Figure()
        axis = figure.subplots()
        axis.set_title(title)
        axis.set_yticks([0.0, 1.0], [title, "b"])
        write_figure(figure, path)
    [family] = {tuple(t.get_fontfamily()) for t in figure.findobj(Text) if t.get_text() == title}
    return list(family)


def test_a_letter_is_taken_from_a_font_that_has_it(
    private_font: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(NOTICE, "resilience")
    assert families_with({ord("a"), ord(PRIVATE)})[1:] == [private_font]
    assert written(tmp_path / "a.png", f"line {PRIVATE}") == ["sans-serif", private_font]
    assert written(tmp_path / "b.svg", "line Ä") == ["sans-serif"]
    assert caplog.messages == []


def test_letters_that_no_font_has_are_named_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(NOTICE, "resilience")
    assert families_with({ord(PRIVATE)}) == []
    path = tmp_path / "a.png"
    assert written(path, f"{PRIVATE} and \ue124{PRIVATE}") == ["sans-serif"]
    assert caplog.messages == [
        f"{path}: no font here has {PRIVATE}\ue124, drawn as boxes; Noto's fonts have every script"
    ]
    assert path.stat().st_size > 1000
