"""MkDocs hook: reference pages made from the code, so that they cannot differ from it.

- `reference/case.md` from the JSON Schema of a case file;
- `reference/components/<name>.md` from the docstring of each file in models/components, and of the
  file of every other device that is registered;
- `reference/symbols.md` from `symbol_table()`.

A navigation entry that ends in `/` is filled with the pages of that folder.
"""

import ast
import inspect
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parents[2]
COMPONENTS = ROOT / "resilience" / "models" / "components"

# Longest suffix first: p_max_mw is MW, cost_per_mwh is not.
UNITS = {
    "_m3_per_mwh": "m³/MWh",
    "_m3_per_h": "m³/h",
    "_m3": "m³",
    "_mw_per_h": "MW/h",
    "_per_mwh": "$/MWh",
    "_per_h": "$/h",
    "_cost": "$",
    "_mvar": "Mvar",
    "_mwh": "MWh",
    "_mva": "MVA",
    "_ohm": "Ω",
    "_mw": "MW",
    "_kv": "kV",
    "_pu": "pu",
    "_min": "min",
    "_hours": "h",
    "_h": "h",
}
RANGES = {
    "minimum": "≥ {}",
    "exclusiveMinimum": "> {}",
    "maximum": "≤ {}",
    "exclusiveMaximum": "< {}",
    "minLength": "at least {} character",
}
TYPES = {
    "boolean": "true or false",
    "string": "text",
    "number": "number",
    "integer": "whole number",
    "object": "table",
}


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Make the package importable and fill the folders named in the navigation."""
    sys.path.insert(0, str(ROOT))
    if config.nav is not None:
        fill(config.nav, Path(config.docs_dir))
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages."""
    for path, text in pages():
        files.append(File.generated(config, path, content=text))
    return files


def pages() -> Iterator[tuple[str, str]]:
    """Yield path and Markdown of every generated page."""
    from resilience.case import case_schema
    from resilience.models.symbols import symbol_table

    yield "reference/case.md", case_page(case_schema())
    yield "reference/symbols.md", symbol_page(symbol_table())
    for name, text in components().items():
        yield f"reference/components/{name}.md", text


def fill(nav: list[Any], docs: Path) -> None:
    """Replace, in place, every navigation entry that ends in `/` by the pages of the folder."""
    for entry in nav:
        for title, target in entry.items() if isinstance(entry, dict) else ():
            if isinstance(target, list):
                fill(target, docs)
            elif target == "reference/components/":
                titles = {name: text.partition("\n")[0][2:] for name, text in components().items()}
                entry[title] = [{t: f"{target}{name}.md"} for name, t in titles.items()]
            elif target.endswith("/"):
                pages = sorted(
                    (docs / target).glob("*.md"), key=lambda page: (page.stem != "index", page.name)
                )
                entry[title] = [f"{target}{page.name}" for page in pages]


def components() -> dict[str, str]:
    """Return the page of every component file whose docstring holds formulas."""
    found = {}
    for path in [*sorted(COMPONENTS.glob("*.py")), *device_files()]:
        text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
        if "$$" in text:
            title = re.split(r" \(|[:,.]", text, maxsplit=1)[0]
            source = path.relative_to(ROOT).as_posix() if path.is_relative_to(ROOT) else path.name
            body = text.removeprefix(f"{title}.").strip()
            found[path.stem] = f"# {title}\n\n{body}\n\n*From `{source}`.*\n"
    return found


def device_files() -> list[Path]:
    """Return the files of components that were registered from elsewhere."""
    from resilience.models.components import fleet_classes

    files = {Path(inspect.getfile(fleet)) for fleet in fleet_classes()}
    return sorted(path for path in files if path.parent != COMPONENTS)


def case_page(schema: dict[str, Any]) -> str:
    """Return the case reference: a section and a table of keys for every table of a case file."""
    lines = ["# Case file", "", "Made from the schema: `resilience case schema` prints it."]
    for heading, table in tables(schema, schema, ""):
        about = table.get("description", "").split("`: ", 1)[-1]
        rows = [row(key, value, table) for key, value in keys(table)]
        if rows:
            lines += ["", f"## {heading}", "", about[:1].upper() + about[1:], ""]
            lines += ["| key | type | unit | default | allowed | what it is |"]
            lines += ["|---|---|---|---|---|---|", *rows]
    return "\n".join(lines) + "\n"


def tables(schema: dict[str, Any], table: dict[str, Any], at: str) -> Iterator[tuple[str, Any]]:
    """Yield heading and schema of a table and of all tables in it, depth first."""
    yield (at or "Top level"), table
    for key, value in table["properties"].items():
        inner = reference(value)
        if inner:
            name = f"{at.strip('[]`')}.{key}".lstrip(".")
            if "additionalProperties" in value:
                name += ".<name>"
            heading = f"`[[{name}]]`" if "items" in value else f"`[{name}]`"
            yield from tables(schema, schema["$defs"][inner], heading)


def reference(value: dict[str, Any]) -> str:
    """Return the name of the table that a property holds, or "" where it holds a plain value."""
    inner = (value.get(key, {}) for key in ("items", "additionalProperties"))
    held = [value, *value.get("anyOf", []), *(one for one in inner if isinstance(one, dict))]
    target = next((one["$ref"] for one in held if "$ref" in one), "")
    return str(target).rpartition("/")[2]


def keys(table: dict[str, Any]) -> list[tuple[str, dict[str, Any]]]:
    """Return the properties of a table that are plain values."""
    return [(key, value) for key, value in table["properties"].items() if not reference(value)]


def row(key: str, value: dict[str, Any], table: dict[str, Any]) -> str:
    """Return the row of one key."""
    plain = next((v for v in value.get("anyOf", []) if v.get("type") != "null"), value)
    cells = (
        f"`{key}`",
        kind(plain),
        unit(key),
        default(key, value, table),
        allowed(plain),
        value.get("description", ""),
    )
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def kind(value: dict[str, Any]) -> str:
    """Return the type of a value in words, lists in the notation of TOML."""
    if value.get("format") == "date-time":
        return "date and time"
    if "prefixItems" in value:
        return f"[{', '.join(kind(item) for item in value['prefixItems'])}]"
    if value.get("type") == "array":
        return f"[{kind(value['items'])}, ...]"
    return TYPES.get(value.get("type", ""), "")


def unit(key: str) -> str:
    """Return the unit that the name of a key ends in."""
    if key.startswith("soc_"):
        return ""
    return next((unit for suffix, unit in UNITS.items() if key.endswith(suffix)), "")


def default(key: str, value: dict[str, Any], table: dict[str, Any]) -> str:
    """Return the default as TOML, or "required"."""
    if key in table.get("required", []):
        return "**required**"
    if value.get("default") in (None, "", []):
        return ""
    return f"`{str(value['default']).lower()}`"


def allowed(value: dict[str, Any]) -> str:
    """Return the limits of a value in words."""
    if "enum" in value:
        return ", ".join(f"`{choice}`" for choice in value["enum"])
    limits = [text.format(value[name]) for name, text in RANGES.items() if name in value]
    return ", ".join(limits)


def symbol_page(symbols: list[dict[str, str]]) -> str:
    """Return the table of symbols and units."""
    lines = ["# Symbols and units", "", "| name | unit | kind | meaning |", "|---|---|---|---|"]
    for symbol in symbols:
        cells = (f"`{symbol['name']}`", symbol["unit"], symbol["kind"], symbol["meaning"])
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n"
