"""Processes that are killed just before a file operation: nothing is cleaned up, as in a crash."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

OPERATIONS = {
    "open", "os.chmod", "os.link", "os.mkdir", "os.remove", "os.rename", "os.rmdir", "os.symlink",
    "os.truncate", "shutil.rmtree", "tempfile.mkdtemp", "tempfile.mkstemp",
}  # fmt: skip
"""Events of Python that a file operation announces itself by, before it happens."""


class Killer:
    """An audit hook that kills its process just before a file operation below a folder.

    Args:
        folder: where operations count.
        count: of the operation that is not reached any more; 0: none.

    Attributes:
        counted: operations so far.
    """

    def __init__(self, folder: Path, count: int) -> None:
        self.folder, self.count, self.counted = str(folder), count, 0

    def __call__(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event not in OPERATIONS or not self._is_below(arguments):
            return
        if event == "open" and not int(arguments[2] or 0) & (os.O_WRONLY | os.O_RDWR):
            return
        self.counted += 1
        if self.counted == self.count:
            os.kill(os.getpid(), signal.SIGKILL)
            time.sleep(60.0)

    def _is_below(self, arguments: tuple[Any, ...]) -> bool:
        """Whether a path is, or is relative to a descriptor, as where a folder is removed."""
        path = os.fsdecode(arguments[0]) if isinstance(arguments[0], str | bytes | Path) else ""
        is_relative = isinstance(arguments[-1], int) and arguments[-1] >= 0
        return path.startswith(self.folder) or (is_relative and path != "" and "/" not in path)


def forked(work: Callable[[], object]) -> int:
    """Signal or exit code of a child that does the work."""
    sys.stdout.flush()
    child = os.fork()
    if not child:
        code = 1
        try:
            work()
            code = 0
        except BaseException as error:
            print(f"{type(error).__name__}: {error}", file=sys.stderr)
        finally:
            os._exit(code)
    status = os.waitpid(child, 0)[1]
    return os.WTERMSIG(status) if os.WIFSIGNALED(status) else os.WEXITSTATUS(status)


def killed_at(folder: Path, count: int, work: Callable[[], object]) -> bool:
    """Whether a child that does the work is killed before its operation of that number below the
    folder; otherwise it is done.

    Raises:
        RuntimeError: the work failed.
    """

    def hooked() -> None:
        sys.addaudithook(Killer(folder, count))
        work()

    code = forked(hooked)
    if code not in (0, signal.SIGKILL):
        raise RuntimeError(f"the work failed with {code}")
    return code == signal.SIGKILL


def operations(folder: Path, work: Callable[[], object]) -> int:
    """How many file operations below the folder the work takes, done in a child."""
    reader, writer = os.pipe()

    def counted() -> None:
        killer = Killer(folder, 0)
        sys.addaudithook(killer)
        work()
        os.write(writer, str(killer.counted).encode())

    if forked(counted) != 0:
        raise RuntimeError("the work failed")
    os.close(writer)
    with os.fdopen(reader) as pipe:
        return int(pipe.read())
