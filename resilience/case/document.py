"""Case files as plain data: finding them, reading TOML, and merging a case over its base."""

from __future__ import annotations

import os
import re
import tomllib
from collections import defaultdict
from collections.abc import Iterable, Iterator, Set
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from resilience.case.schema import DEVICES
from resilience.errors import Mistake, UsageError, did_you_mean, shortened
from resilience.inputs import (
    InputFileError,
    MissingFileError,
    case_folder,
    checked_path,
    read_text,
    shown_name,
)

_SOURCES = ("pandapower", "file", "bus", "line")
_BEGINNINGS = ("extends", "network", "time")
"""Every case has one of these; a file without them is another file, and is not quoted."""
_MAX_CHAIN = 50  # of cases that extend each other
_MAX_PARTS = 100  # of a dotted key; tomllib takes seconds for thousands
_PART = r"""(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*"""
_LONG_KEY = re.compile(rf"(?<![\w-])(?:{_PART}\.[ \t]*){{{_MAX_PARTS}}}")

TomlTable = dict[str, object]
"""A table of a case file as it was read: nobody has checked what its values are."""

Place = tuple[str, ...]
"""Where a table or a key stands: `("ess", "ess1", "p_max_mw")`; keyed entries go by name."""

Finding = tuple[str, str, str, str]
"""`(key, value, allowed, hint)`: one thing wrong with a table."""


@dataclass
class Document:
    """A merged case file and what is wrong with it.

    Attributes:
        path: its file; None where it came from none.
        data: its tables, merged over those of the cases that it extends.
        origin: the file that each table and key comes from, by place.
        mistakes: what could not be read, and what checks have noted since.
    """

    path: Path | None
    data: TomlTable = field(default_factory=dict)
    origin: dict[Place, str] = field(default_factory=dict)
    mistakes: list[Mistake] = field(default_factory=list)

    def entries(self, kind: str) -> list[TomlTable]:
        """The tables `[[kind]]`, without whatever else stands among them."""
        tables = self.data.get(kind, [])
        return [e for e in tables if isinstance(e, dict)] if isinstance(tables, list) else []

    def defaults(self, kind: str) -> TomlTable:
        """The table `[defaults.kind]`; empty where it is missing or no table."""
        section = self.data.get("defaults")
        table = section.get(kind) if isinstance(section, dict) else None
        return table if isinstance(table, dict) else {}

    def add_findings(
        self, where: Place, table: str, findings: Iterable[Finding], file: str = ""
    ) -> None:
        """Notes what is wrong with the table at `where`, each finding at its own key.

        Where it stands in a file that the table names, `file` says so.
        """
        for key, value, allowed, hint in findings:
            if file:
                self.mistakes.append(Mistake(file, table, key, value, allowed, hint))
            else:
                self.add((*where, key), table, key, value, allowed, hint)

    def add(self, where: Place, table: str, key: str, value: str, allowed: str, hint: str) -> None:
        """Notes one mistake; `where` is the place of its key in the data.

        A key that a device has from `[defaults.<kind>]` is a mistake there.
        """
        if self._is_default(where):
            where, table = ("defaults", where[0], where[2]), f"[defaults.{where[0]}]"
        self.mistakes.append(Mistake(self.file_of(*where), table, key, value, allowed, hint))

    def _is_default(self, where: Place) -> bool:
        if len(where) != 3 or not _is_keyed(where[0]):
            return False
        kind, name, key = where
        return key in self.defaults(kind) and key not in self.stated_keys(kind, name)

    def stated_keys(self, kind: str, name: str) -> Set[str]:
        """The keys that the entries of a name state themselves, without their defaults."""
        return self._keys_by_name.get((kind, name), frozenset())

    @cached_property
    def _keys_by_name(self) -> dict[tuple[str, str], set[str]]:
        """The keys of every keyed entry: looked through once, however many mistakes there are."""
        keys: defaultdict[tuple[str, str], set[str]] = defaultdict(set)
        for kind in filter(_is_keyed, self.data):
            for entry in self.entries(kind):
                keys[kind, entry_name(kind, entry)].update(entry)
        return keys

    def file_of(self, *where: str) -> str:
        """The file that a table or key comes from, the innermost that is known."""
        for length in range(len(where), 0, -1):
            if where[:length] in self.origin:
                return self.origin[where[:length]]
        return shown(self.path)


def shown(path: Path | None) -> str:
    """A path as messages print it: relative where it lies below the working folder."""
    if path is None:
        return "case"
    try:
        return str(path.resolve().relative_to(Path.cwd()))
    except ValueError:
        return str(path)


def case_names() -> list[str]:
    """Names of the cases that come with the package: `ieee33`, `analytic/island`."""
    folder = case_folder()
    return sorted(p.relative_to(folder).with_suffix("").as_posix() for p in folder.rglob("*.toml"))


def find_case(ref: str | os.PathLike[str], beside: Path | None = None) -> Path:
    """The file of a case given by name or path; relative paths start at `beside`.

    Raises:
        UsageError: there is no such case.
    """
    path = Path(ref)
    local = path if beside is None else beside / path
    refusals = []
    for candidate in (local, case_folder() / f"{ref}.toml", Path(f"{local}.toml")):
        try:
            return checked_path(candidate)
        except MissingFileError:
            pass
        except InputFileError as error:
            refusals.append(error)
    if refusals:
        raise refusals[0]
    name = shown_name(path)
    if path.suffix == ".toml":
        raise UsageError(
            f"case file {name} does not exist",
            "give a path or one of the names: " + ", ".join(case_names()),
        )
    raise UsageError(
        f"case {name!r} does not exist", did_you_mean(str(ref), case_names(), max_listed=40)
    )


def read_document(path: Path, chain: tuple[Path, ...] = ()) -> Document:
    """Reads a case file and merges it over the case that it extends."""
    path = checked_path(path)
    document = Document(path)
    document.data = _parse(path, document)
    _absolute_paths(document.data, path.parent)
    document.origin = dict.fromkeys(_places(document.data), shown(path))
    base_ref = document.data.get("extends")
    if not isinstance(base_ref, str):
        return document
    where = ("extends",)
    try:
        base_path = find_case(base_ref, beside=path.parent)
    except UsageError as error:
        value, allowed = shortened(repr(base_ref)), "the name or path of a case"
        document.add(where, "", "extends", value, allowed, error.hint)
        return document
    chain = (*chain, path)
    if base_path in chain:
        loop = " -> ".join(p.stem for p in (*chain, base_path))
        hint = "remove `extends` from one of these files"
        document.add(where, "", "extends", loop, "a chain that ends", hint)
        return document
    if len(chain) > _MAX_CHAIN:
        value, hint = f"{len(chain)} cases, each on the next", "put some of them into one file"
        document.add(where, "", "extends", value, f"{_MAX_CHAIN} at most", hint)
        return document
    base = read_document(base_path, chain)
    return Document(
        path,
        _merge(base.data, document.data),
        base.origin | document.origin,
        base.mistakes + document.mistakes,
    )


def document_of(tables: TomlTable, base: TomlTable | None = None) -> Document:
    """Tables made in code as a case file, merged over the case that they extend.

    Args:
        tables: as TOML has them; files in them are named from the working folder.
        base: tables that these are laid over; those of `extends` if omitted.

    Raises:
        UsageError: there is no case to extend.
    """
    _absolute_paths(tables, Path.cwd())
    if base is not None:
        return Document(None, _merge(base, tables))
    extends = tables.get("extends")
    if not isinstance(extends, str):
        return Document(None, tables)
    document = read_document(find_case(extends))
    return Document(None, _merge(document.data, tables), document.origin, document.mistakes)


def _parse(path: Path, document: Document) -> TomlTable:
    """The tables of a file; mistakes are noted. What is no case is not quoted."""
    try:
        text = read_text(path)
    except InputFileError as error:
        wrong = error.mistake
        value = f"{wrong.value} in {wrong.table}" if wrong.table else wrong.value
        document.add((), "", "", value, "a text file in UTF-8", "case files are TOML text")
        return {}
    try:
        if long_key := _LONG_KEY.search(text):
            raise tomllib.TOMLDecodeError(
                f"A key of {_MAX_PARTS} parts or more (at line "
                f"{text.count(chr(10), 0, long_key.start()) + 1}, column 1)"
            )
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        _add_decode_error(document, text, str(error))
    except (RecursionError, ValueError) as error:
        value = "too deep" if isinstance(error, RecursionError) else "a number of too many digits"
        document.add((), "", "", value, "TOML", "is it a case file?")
    else:
        if not data or any(key in data for key in _BEGINNINGS):
            return data
        value, hint = "none of them", "is it a case file?"
        document.add((), "", "", value, "[network] and [time], or extends", hint)
    return {}


def _add_decode_error(document: Document, text: str, message: str) -> None:
    """Notes where a text is no TOML; the line is quoted where the rest of it is a case."""
    place = re.search(r"\(at line (\d+), column (\d+)\)", message)
    lines = text.split("\n")
    line = int(place[1]) if place else max(len(lines) - (not lines[-1]), 1)
    column = f"column {place[2]}" if place else "end of file"
    begins = re.search(rf"^\s*\[*({'|'.join(_BEGINNINGS)})\b", text, re.MULTILINE)
    is_case = document.path is not None and document.path.suffix == ".toml" and begins
    value = shortened(lines[line - 1].strip() or "end of file") if is_case else "something else"
    document.add((), f"line {line}", column, value, "TOML", message.split(" (at ", 1)[0])


def _absolute_paths(data: TomlTable, folder: Path) -> None:
    plan = data.get("plan")
    catalogue = plan.get("storm") if isinstance(plan, dict) else None
    storms = catalogue if isinstance(catalogue, list) else []
    for section in (data.get("network"), data.get("profiles"), *storms):
        if isinstance(section, dict) and isinstance(section.get("file"), str):
            section["file"] = os.path.abspath(folder / section["file"])


def _places(value: object, where: Place = ()) -> Iterator[Place]:
    """The place of every table and key; entries of keyed lists go by name."""
    if where:
        yield where
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _places(inner, (*where, str(key)))
    elif len(where) == 1 and _is_keyed(where[0]) and isinstance(value, list):
        for entry in value:
            if isinstance(entry, dict):
                yield from _places(entry, (*where, entry_name(where[0], entry)))


def _is_keyed(key: str) -> bool:
    """Whether the entries of a list of tables merge by name: devices, lines and tanks."""
    return key in ("line", "tank") or key in DEVICES


def entry_name(kind: str, entry: TomlTable) -> str:
    """The name of an entry of a list of tables; empty where it has none."""
    unnamed = {"grid": "grid", "network.line": f"{entry.get('from')}-{entry.get('to')}"}
    return str(entry.get("name", unnamed.get(kind, "")))


def _merge(base: TomlTable, child: TomlTable) -> TomlTable:
    """A case laid over its base: tables key by key, lists of devices by name, all else replaced."""
    merged = {k: v for k, v in base.items() if k not in ("extends", "name", "description")}
    for key, value in child.items():
        old = merged.get(key)
        if _is_keyed(key) and isinstance(old, list) and isinstance(value, list):
            merged[key] = _merge_entries(key, old, value)
        elif key == "network" and isinstance(old, dict) and isinstance(value, dict):
            merged[key] = _merge_network(old, value)
        elif isinstance(old, dict) and isinstance(value, dict):
            merged[key] = _merge_tables(old, value)
        else:
            merged[key] = value
    return merged


def _merge_tables(old: TomlTable, new: TomlTable) -> TomlTable:
    both = {
        key: _merge_tables(table, value)
        for key, value in new.items()
        if isinstance(value, dict) and isinstance(table := old.get(key), dict)
    }
    return old | new | both


def _merge_network(old: TomlTable, new: TomlTable) -> TomlTable:
    """A new source of the network replaces the old one; inline buses keep inline lines."""
    sources = [key for key in _SOURCES if key in new]
    inline = ("bus", "line") if any(key in ("bus", "line") for key in sources) else ()
    dropped = [key for key in _SOURCES if sources and key not in inline]
    return {k: v for k, v in old.items() if k not in dropped} | new


def _merge_entries(kind: str, old: list[object], new: list[object]) -> list[object]:
    """The old entries, each with the keys of its namesake laid over it, then new ones.

    Of old entries that share a name, the first takes the first new one; a second new one stands
    alone, so that the check of names sees both.
    """
    merged = list(old)
    free = {
        entry_name(kind, entry): (position, entry)
        for position, entry in reversed(list(enumerate(old)))
        if isinstance(entry, dict)
    }
    for entry in new:
        name = entry_name(kind, entry) if isinstance(entry, dict) else ""
        if isinstance(entry, dict) and name and name in free:
            position, table = free.pop(name)
            merged[position] = _merge_tables(table, entry)
        else:
            merged.append(entry)
    return merged
