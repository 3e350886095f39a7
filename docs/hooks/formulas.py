"""MkDocs hook: formulas become MathML when the site is built, so that pages need no script.

pymdownx.arithmatex marks them; every current browser draws MathML by itself.
"""

import html
import re
from typing import Any

MARKED = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)


def on_page_content(content: str, **_: Any) -> str:
    """Replace every formula of a page."""
    return MARKED.sub(mathml, content)


def mathml(match: re.Match[str]) -> str:
    """Return the MathML of one formula."""
    from latex2mathml.converter import convert

    formula = html.unescape(match[2]).strip()
    if match[1] == "span":
        return str(convert(formula))
    return f'<div class="formula">{convert(formula, display="block")}</div>'
