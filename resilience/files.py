"""Files appear whole or not at all, and what an interrupted process left is cleared by the next.

What is not finished is in a folder of its own beside its place, which its process locks. A folder
that nobody locks any more was left by a process that ended early: whoever writes there next removes
it. Files are on the disk before they take their place.
"""

from __future__ import annotations

import errno
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from resilience.errors import FileError, ResilienceError, UsageError

MAX_WORDS = 200
"""Characters of what a library says of a damaged file."""
PICTURE_SUFFIXES = (".png", ".pdf", ".svg")
HIDDEN = ".resilience-"
"""How names of folders begin that hold what is not in its place yet."""
_UNFINISHED = HIDDEN + "?" * 8
_ABANDONED_AFTER_S = 86400.0  # where the system cannot lock folders
_NO_LOCKS = {errno.ENOLCK, errno.EBADF, errno.EINVAL, errno.ENOSYS, errno.EOPNOTSUPP}
_NO_SYNC = {errno.EINVAL, errno.EBADF, errno.ENOSYS, errno.EOPNOTSUPP}

REMEDIES = {
    errno.EACCES: "name a place that you may write to, or change its permissions",
    errno.EPERM: "name a place that you may write to, or change its permissions",
    errno.EROFS: "name a place on a disk that can be written to",
    errno.ENOSPC: "free some space, or name a place on another disk; the same command goes on",
    errno.EDQUOT: "free some space, or name a place on another disk; the same command goes on",
    errno.EFBIG: "raise the limit on the size of files, or name a place on another disk",
    errno.ENOTDIR: "a file stands where a folder is needed; name another place",
    errno.EEXIST: "a file stands where a folder is needed; name another place",
    errno.EISDIR: "name a file in that folder",
    errno.ENAMETOOLONG: "shorten the name: 255 bytes is what most systems allow",
    errno.ENOENT: "name a place that can be written to",
    errno.ELOOP: "name a place that no circle of links leads to",
}
"""What to do about an error of the system, by its number."""


def file_error(doing: str, error: OSError) -> FileError:
    """An error of the system with its remedy.

    Args:
        doing: what failed, as "cannot write run".
        error: what the system says.
    """
    reason = os.strerror(error.errno) if error.errno else str(error) or type(error).__name__
    reason = reason[:1].lower() + reason[1:]
    hint = REMEDIES.get(error.errno or 0, "see that the disk is there and in order")
    return FileError(f"{doing}: {reason}", hint=hint)


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Names the file or folder that is being written, whatever the system refuses of it.

    Raises:
        FileError: the system refuses; what is allowed is in the hint.
    """
    try:
        yield
    except FileError as error:
        if not isinstance(error.__cause__, OSError):
            raise
        raise file_error(f"cannot write {path}", error.__cause__) from error.__cause__
    except OSError as error:
        raise file_error(f"cannot write {path}", error) from error


def check_picture(path: Path) -> None:
    """Refuses a picture's file before anything is drawn.

    Raises:
        UsageError: the suffix is no picture format, or it is a folder.
        FileError: it could not be written.
    """
    if path.suffix not in PICTURE_SUFFIXES:
        raise UsageError(
            f"cannot draw to {path.name!r}; allowed suffixes: {', '.join(PICTURE_SUFFIXES)}",
            hint=f"{path.stem}.png, say",
        )
    check_file(path)


def check_file(path: Path) -> None:
    """Refuses a file that could not be written, before its contents are computed.

    Raises:
        UsageError: it is a folder.
        FileError: the system would refuse.
    """
    with writing(path):
        if path.is_dir():
            raise UsageError(f"{path} is a folder; allowed: a file", hint="name a file in it")
        _try(path)


def check_folder(folder: Path) -> None:
    """Refuses a folder that could not be written to, before its contents are computed.

    Raises:
        UsageError: it is a file.
        FileError: the system would refuse.
    """
    with writing(folder):
        if folder.exists() and not folder.is_dir():
            raise UsageError(f"{folder} is a file; allowed: a folder", hint="name a folder")
        _try(folder / "file")


def _try(path: Path) -> None:
    """Makes a folder of that name at a place beside it, on trial; raises what the system says."""
    path = Path(os.path.realpath(path))
    parent, names = path.parent, [path.name]
    while not parent.exists():
        parent, names = parent.parent, [parent.name, *names]
    if not parent.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(parent))
    with staging(parent) as trial:
        trial.joinpath(*names).mkdir(parents=True)


@contextmanager
def staging(parent: Path) -> Iterator[Path]:
    """A new folder for what is not finished; it is gone when the block ends.

    Args:
        parent: the folder in which it is; what interrupted processes left there is cleared.
    """
    parent.mkdir(parents=True, exist_ok=True)
    clear_abandoned(parent)
    fresh, lock = _locked_folder(parent)
    with lock:
        try:
            yield fresh
        finally:
            shutil.rmtree(fresh, ignore_errors=True)


def _locked_folder(parent: Path) -> tuple[Path, ExitStack]:
    """A new folder, and its lock."""
    while True:
        fresh, lock = Path(tempfile.mkdtemp(prefix=HIDDEN, dir=parent)), ExitStack()
        with suppress(FileNotFoundError):
            lock.enter_context(locked(fresh))
            if fresh.is_dir():
                return fresh, lock
        lock.close()  # others took it for abandoned in the moment before it was locked


def clear_abandoned(parent: Path) -> None:
    """Removes what interrupted processes did not finish in a folder, as far as it can be."""
    leftovers: list[Path] = []
    with suppress(OSError):
        leftovers = sorted(parent.glob(_UNFINISHED))
    for path in leftovers:
        with suppress(OSError), locked(path, wait=False) as certain:
            if certain or time.time() - path.stat().st_mtime > _ABANDONED_AFTER_S:
                shutil.rmtree(path, ignore_errors=True)


@contextmanager
def locked(folder: Path, *, shared: bool = False, wait: bool = True) -> Iterator[bool]:
    """Keeps others from locking a folder; however the process ends, the lock ends with it.

    Args:
        folder: it is there.
        shared: others may lock it, too, if they share it.
        wait: for others to release it.

    Yields:
        Whether the folder is locked: False where the system cannot lock folders.

    Raises:
        BlockingIOError: another has locked it, and is not waited for.
    """
    if sys.platform == "win32":
        yield False
        return
    import fcntl

    descriptor = os.open(folder, os.O_RDONLY)
    try:
        certain = True
        kind = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
        try:
            fcntl.flock(descriptor, kind if wait else kind | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                raise
            certain = False
        yield certain
    finally:
        os.close(descriptor)


def sync(path: Path) -> None:
    """Waits until a file, or the names in a folder, are on the disk, where the system can say."""
    if path.is_dir() and sys.platform == "win32":
        return
    descriptor = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno not in _NO_SYNC:
            raise
    finally:
        os.close(descriptor)


@contextmanager
def replacing_file(path: Path) -> Iterator[Path]:
    """A new file, called as `path`, that takes its place when the block ends well.

    A link stays, and what it names is replaced.

    Raises:
        FileError: the system refuses.
    """
    with writing(path):
        target = Path(os.path.realpath(path))
        with staging(target.parent) as folder:
            fresh = folder / path.name
            yield fresh
            sync(fresh)
            os.replace(fresh, target)
            sync(target.parent)


DAMAGED = (Exception,)
"""What libraries raise where some bytes of a file are others: zlib.error, SyntaxError, TokenError,
RecursionError, MemoryError and whatever else."""


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
    except ResilienceError as error:
        if type(error) is UsageError and path.name not in error.message:
            raise UsageError(f"{path}: {error.message}", hint=error.hint) from error
        raise
    except DAMAGED as error:
        text = " ".join(str(error).split())
        text = text if len(text) <= MAX_WORDS else f"{text[:MAX_WORDS]} ..."
        raise UsageError(
            f"{path} holds no {contents}: {type(error).__name__}: {text}",
            hint="it is damaged or of another kind; run the command again that wrote it",
        ) from error
