"""Folders of results: one takes the place of an earlier one of its kind, whole or not at all.

A new result is written into a hidden folder within the folder:

1. `.resilience-XXXXXXXX` while files are written. An interrupted process leaves the earlier result
   as it was, and the next one clears this.
2. Renamed `.resilience-next` once everything is on the disk: from here on the new result counts.
   The earlier summary is removed, then whatever else is replaced.
3. Renamed `.resilience-placing` once only the new result is left. Its files are moved into the
   folder, the summary last: where there is one, all files beside it are of the same result.

Whoever writes or reads next finishes what stopped in 2 or 3. What is said to stay, as the parts of
a comparison, is never touched.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from resilience.errors import UsageError
from resilience.files import (
    HIDDEN,
    check_folder,
    clear_abandoned,
    locked,
    staging,
    sync,
    writing,
)

SUMMARY_FILE = "summary.json"
PARTS_FOLDER = "parts"
README_FILE = "README.md"
NEXT, PLACING = f"{HIDDEN}next", f"{HIDDEN}placing"


@dataclass(frozen=True)
class ResultKind:
    """A kind of result in a folder.

    Attributes:
        name: what its summary says that it is.
        mark: name of its summary.
        lasting: patterns of names that stay when a result is replaced.
    """

    name: str
    mark: str = SUMMARY_FILE
    lasting: tuple[str, ...] = ()

    def is_lasting(self, name: str) -> bool:
        """Whether a file or folder of that name stays."""
        return any(fnmatchcase(name, pattern) for pattern in self.lasting)


PLAN = ResultKind("plan")
SCENARIO_PLAN = ResultKind("plan over scenarios")
COMPARISON = ResultKind("comparison", lasting=(PARTS_FOLDER,))
HAZARD = ResultKind("hazard", mark="hazard.json")
SURVIVAL = ResultKind("survival")
HARDENING = ResultKind("choice of what to build", lasting=(PARTS_FOLDER,))
REPRODUCTION = ResultKind("reproduction", lasting=("*",))
KINDS = {
    kind.name: kind
    for kind in (PLAN, SCENARIO_PLAN, COMPARISON, HAZARD, SURVIVAL, HARDENING, REPRODUCTION)
}
"""All kinds by name."""


def stated_kind(folder: Path, mark: str = SUMMARY_FILE) -> str | None:
    """What the summary in a folder says that the result is; None if it says nothing."""
    try:
        summary = json.loads((folder / mark).read_text(encoding="utf-8"))
        return str(summary["kind"])
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def write_summary(target: Path, kind: ResultKind, summary: Mapping[str, Any]) -> None:
    """Writes the summary of a result, which says its kind first."""
    text = json.dumps({"kind": kind.name, **summary}, indent=2, allow_nan=False)
    (target / kind.mark).write_text(text + "\n", encoding="utf-8")


def write_readme(
    target: Path,
    kind: ResultKind,
    files: Mapping[str, str],
    columns: Mapping[str, Mapping[str, str]] | None = None,
) -> None:
    """Writes what every file of a result holds, for whoever is handed the folder alone.

    Args:
        target: the folder.
        kind: of the result.
        files: name to what is in it, units included.
        columns: by name of a table, what is in each of its columns, likewise.
    """
    lines = [
        f"# A {kind.name}, written by resilience",
        "",
        "Times are local and say when a slot starts. Powers are means over the slot, and what is",
        "stored is what is there at its end. Where nothing else is said, a table has a row per",
        "slot, and a column per device, bus or line, by its name.",
        "",
        *(f"- `{name}`: {meaning}" for name, meaning in files.items()),
    ]
    for table, meanings in (columns or {}).items():
        lines += ["", f"Columns of `{table}`:", ""]
        lines += [f"- `{name}`: {meaning}" for name, meaning in meanings.items()]
    (target / README_FILE).write_text("\n".join([*lines, ""]), encoding="utf-8")


def check_replaceable(folder: Path, *kinds: ResultKind) -> None:
    """Refuses a folder for a result, before hours are spent on it.

    What an interrupted process left there is put in place or cleared first.

    Args:
        folder: it need not exist.
        kinds: that the result may turn out to be.

    Raises:
        UsageError: it is a file, holds a result of another kind, or something else.
        FileError: it could not be written to.
    """
    with writing(folder), steady(folder):
        if folder.is_dir():
            _check_contents(folder, kinds)
    check_folder(folder)


def _check_contents(folder: Path, kinds: tuple[ResultKind, ...]) -> None:
    kind = kinds[0]
    names = [path.name for path in folder.iterdir() if not path.name.startswith(HIDDEN)]
    allowed = " or ".join(kind.name for kind in kinds)
    if kind.mark in names:
        stated = stated_kind(folder, kind.mark)
        if stated not in {kind.name for kind in kinds}:
            says = f"holds a {stated}" if stated else f"has a {kind.mark} that says no kind"
            raise UsageError(
                f"{folder} {says}; allowed: an earlier {allowed}, or an empty folder",
                hint="name a new folder",
            )
    elif not all(kind.is_lasting(name) for name in names):
        raise UsageError(
            f"{folder} is not empty and holds no earlier result; allowed: an earlier {allowed}, or "
            "an empty folder",
            hint="name a new folder",
        )


@contextmanager
def replacing(folder: Path, kind: ResultKind) -> Iterator[Path]:
    """A new folder whose contents take the place of those of `folder` when the block ends well.

    Args:
        folder: where the result is to be.
        kind: of the result; its mark is among the contents.

    Raises:
        UsageError: as `check_replaceable`.
        FileError: the system refuses.
    """
    check_replaceable(folder, kind)
    is_new = not folder.exists()
    try:
        with writing(folder), staging(folder) as fresh:
            yield fresh
            _kind_of(fresh)
            _sync_all(fresh)
            with locked(folder):
                _place(folder)
                _check_contents(folder, (kind,))
                os.replace(fresh, folder / NEXT)
                sync(folder)
                _place(folder)
    except BaseException:
        if is_new:
            with suppress(OSError):
                folder.rmdir()
        raise


@contextmanager
def steady(folder: Path) -> Iterator[None]:
    """No other process puts a result into the folder while the block reads one.

    Raises:
        FileError: there is a result to be put in place first, and the system refuses.
    """
    if not folder.is_dir():
        yield
        return
    settle(folder)
    with locked(folder, shared=True):
        yield


def settle(folder: Path) -> None:
    """Puts in place what an interrupted process had finished, and clears what it had not.

    Raises:
        FileError: the system refuses.
    """
    clear_abandoned(folder)
    if (folder / NEXT).is_dir() or (folder / PLACING).is_dir():
        with writing(folder), locked(folder):
            _place(folder)


def _place(folder: Path) -> None:
    """Steps 2 and 3, from wherever they stopped."""
    if (folder / PLACING).is_dir():
        _move_all(folder)
    if not (folder / NEXT).is_dir():
        return
    kind = _kind_of(folder / NEXT)
    (folder / kind.mark).unlink(missing_ok=True)
    sync(folder)
    for path in sorted(folder.iterdir()):
        if not path.name.startswith(HIDDEN) and not kind.is_lasting(path.name):
            _remove(path)
    os.replace(folder / NEXT, folder / PLACING)
    _move_all(folder)


def _move_all(folder: Path) -> None:
    placing = folder / PLACING
    names = sorted(path.name for path in placing.iterdir())
    marks = {kind.mark for kind in KINDS.values()}
    for name in names:
        if name not in marks:
            os.replace(placing / name, folder / name)
    sync(folder)
    for name in names:
        if name in marks:
            os.replace(placing / name, folder / name)
    sync(folder)
    placing.rmdir()


def _kind_of(folder: Path) -> ResultKind:
    for kind in KINDS.values():
        if (folder / kind.mark).is_file() and stated_kind(folder, kind.mark) == kind.name:
            return kind
    raise UsageError(f"{folder} holds no result", hint="delete it")


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink()


def _sync_all(folder: Path) -> None:
    for path in sorted(folder.rglob("*")):
        sync(path)
    sync(folder)
