"""Every kind of file that is read: a sound one, how it is changed, who reads it, what is sound."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hypothesis import strategies as st

from tests.fuzz.verdict import Verdict, verdict

Files = Mapping[str, bytes]
"""Name of a file, from the folder, to what is in it."""


@dataclass(frozen=True)
class Kind:
    """A kind of file, or of folder.

    Attributes:
        base: sound files, all that reading needs.
        changes: from these files to those of them that are changed, drawn.
        read: reads what is in a folder.
        sound: raises where what was read is nonsense.
        named: what every refusal names.
        slow: whether a file takes so long that fewer are tried.
        unchanged: what comes of the sound files.
    """

    base: Callable[[], Files]
    changes: Callable[[Files], st.SearchStrategy[Files]]
    read: Callable[[Path], Any]
    sound: Callable[[Any], object] = lambda value: None
    named: str = ""
    slow: bool = False
    unchanged: Verdict = "read"


class Changed(dict[str, bytes]):
    """Files that are short where Hypothesis tells of them."""

    def __repr__(self) -> str:
        return f"Changed({ {name: data[:500] for name, data in self.items()} })"


class Ground:
    """A folder with the sound files of a kind, some of which are changed for one reading.

    Args:
        kind: of the files.
        folder: an empty one.
    """

    def __init__(self, kind: Kind, folder: Path) -> None:
        self.kind, self.folder, self.base = kind, folder, kind.base()
        self.changes = kind.changes(self.base).map(Changed)
        self._write(self.base)

    def judge(self, changed: Files) -> Verdict:
        """What comes of reading the changed files; the sound ones are put back.

        Raises:
            FaultError: as `verdict`.
        """
        self._write(changed)
        try:
            return verdict(lambda: self.kind.read(self.folder), self.kind.named, self.kind.sound)
        finally:
            for name in changed:
                (self.folder / name).unlink(missing_ok=True)
            self._write({name: self.base[name] for name in changed if name in self.base})

    def _write(self, files: Files) -> None:
        for name, data in files.items():
            path = self.folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)


def one_file(name: str, change: Callable[[bytes], st.SearchStrategy[bytes]]) -> Callable[
    [Files], st.SearchStrategy[Files]
]:  # fmt: skip
    """Changes of one file of a kind."""
    return lambda files: change(files[name]).map(lambda data: {name: data})


def some_file(
    change: Callable[[str, bytes], st.SearchStrategy[bytes]],
) -> Callable[[Files], st.SearchStrategy[Files]]:
    """Changes of one file out of a folder, or its loss."""

    def changes(files: Files) -> st.SearchStrategy[Files]:
        return st.sampled_from(sorted(files)).flatmap(
            lambda name: change(name, files[name]).map(lambda data: {name: data})
        )

    return changes


def saved(save: Callable[[Path], object]) -> Callable[[], Files]:
    """The files that something writes into a folder, made once."""

    @cache
    def base() -> Files:
        with TemporaryDirectory() as name:
            folder = Path(name)
            save(folder)
            paths = [path for path in sorted(folder.rglob("*")) if path.is_file()]
            return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}

    return base
