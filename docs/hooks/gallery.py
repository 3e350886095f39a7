"""MkDocs hook: `gallery/NAME.md`, made from the executed notebook `docs/gallery/NAME.ipynb`."""

import json
import re
from html import escape
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

GALLERY = Path(__file__).parents[1] / "gallery"
STYLE = re.compile(r"<style.*?</style>", re.DOTALL)
"""What pandas says of its tables; the site has a style of its own."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a page per notebook; the notebook itself stays beside it."""
    for path in sorted(GALLERY.glob("*.ipynb")):
        notebook = json.loads(path.read_text(encoding="utf-8"))
        files.append(File.generated(config, f"gallery/{path.stem}.md", content=page(notebook)))
    return files


def page(notebook: dict[str, Any]) -> str:
    """Return a notebook as Markdown: texts, programs, and what they show."""
    parts = []
    for cell in notebook["cells"]:
        source = "".join(cell["source"])
        parts.append(source if cell["cell_type"] == "markdown" else f"```python\n{source}\n```")
        parts += [shown(output) for output in cell.get("outputs", [])]
    return "\n\n".join(parts) + "\n"


def shown(output: dict[str, Any]) -> str:
    """Return one output: a picture, a table, or text."""
    data = {kind: "".join(text) for kind, text in output.get("data", {}).items()}
    if "image/png" in data:
        picture = data["image/png"].replace("\n", "")
        return f'<img alt="what the program draws" src="data:image/png;base64,{picture}">'
    if "text/html" in data:
        table = STYLE.sub("", data["text/html"])
        table = table.replace(' border="1"', "").replace(' class="dataframe"', "")
        # A blank line would end the block of HTML.
        return "\n".join(line.strip() for line in table.splitlines() if line.strip())
    text = "".join(output.get("text", data.get("text/plain", "")))
    return f"<pre>{escape(text)}</pre>" if "```" in text else f"```text\n{text.rstrip()}\n```"
