"""Results appear whole or not at all: a folder or a file takes the place of what stood there."""

from __future__ import annotations

import os
import shutil
import tempfile
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from resilience.errors import UsageError

PICTURE_SUFFIXES = (".png", ".pdf", ".svg")


def check_replaceable(folder: Path, mark: str, keep: str = "") -> list[str]:
    """Names of what is in a folder that `replacing` may replace.

    Args:
        folder: it need not exist.
        mark: name of the file by which an earlier result is known.
        keep: name of a sub-folder that does not count.

    Raises:
        UsageError: it is a file, or holds something that is no earlier result.
    """
    if folder.exists() and not folder.is_dir():
        raise UsageError(f"{folder} is a file", hint="name a folder")
    names = [path.name for path in folder.iterdir()] if folder.is_dir() else []
    if set(names) - {keep} and mark not in names:
        raise UsageError(
            f"{folder} is not empty and holds no earlier result", hint="name a new folder"
        )
    return names


def check_picture(path: Path) -> None:
    """Refuses a picture's file before anything is drawn.

    Raises:
        UsageError: the suffix is no picture format.
    """
    if path.suffix not in PICTURE_SUFFIXES:
        raise UsageError(
            f"cannot draw to {path.name!r}; allowed suffixes: {', '.join(PICTURE_SUFFIXES)}",
            hint=f"{path.stem}.png, say",
        )


@contextmanager
def replacing(folder: Path, mark: str, keep: str = "") -> Iterator[Path]:
    """A new folder that takes the place of `folder` when the block ends well.

    An existing folder is replaced only if it is empty or holds the file `mark`; its sub-folder
    `keep` does not count, and moves on to the new one.

    Raises:
        UsageError: what stands there is no earlier result.
    """
    names = check_replaceable(folder, mark, keep)
    folder.parent.mkdir(parents=True, exist_ok=True)
    fresh = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    try:
        yield fresh
        fresh.chmod(0o755)
        if folder.exists():
            # Moved aside, since no system replaces a folder that is not empty in one step.
            aside = Path(tempfile.mkdtemp(prefix=f".{folder.name}-old-", dir=folder.parent))
            old = aside / "was"
            os.replace(folder, old)
            os.replace(fresh, folder)
            if keep and keep in names:
                os.replace(old / keep, folder / keep)
            shutil.rmtree(aside)
        else:
            os.replace(fresh, folder)
    except BaseException:
        shutil.rmtree(fresh, ignore_errors=True)
        raise


@contextmanager
def replacing_file(path: Path) -> Iterator[Path]:
    """A new file, called as `path`, that takes its place when the block ends well."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".new-", dir=path.parent) as folder:
        fresh = Path(folder) / path.name
        yield fresh
        os.replace(fresh, path)


DAMAGED = (
    zipfile.BadZipFile, zlib.error, EOFError, ValueError, TypeError, KeyError, IndexError,
    AttributeError, NotImplementedError, OverflowError, MemoryError, OSError,
)  # fmt: skip
"""What reading a file of data raises where some of its bytes are others."""


@contextmanager
def reading(path: Path, contents: str = "trajectory") -> Iterator[None]:
    """Names the file or folder in which reading fails, whatever its library raises.

    Args:
        path: of the file or folder.
        contents: what should be in it.

    Raises:
        UsageError: it is damaged, or of another kind.
    """
    try:
        yield
    except DAMAGED as error:
        raise UsageError(
            f"{path} holds no {contents}: {type(error).__name__}: {error}",
            hint="it is damaged or of another kind; run the command again that wrote it",
        ) from error
