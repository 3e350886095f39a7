"""The log of an operator: every decision with its inputs, a line of JSON each, and its memory.

A line is on the disk before its decision is given away. Whoever starts anew reads the lines and
does them again, so that a decision is neither lost nor made twice. The first line says what the log
is of. A last line that was not written to its end is cut off: nobody was given that decision.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

from resilience.errors import UsageError
from resilience.files import file_error, locked, writing
from resilience.inputs import checked_path

Record = dict[str, Any]


class Journal:
    """A log that is open; no other process can use it meanwhile.

    Args:
        path: of the file; it is made where there is none.
        head: what the log is of, as its first line says.
        wait_s: seconds to wait for another process that uses it.

    Attributes:
        records: the decisions in it, in their order.

    Raises:
        UsageError: another process uses it, it is of another case, method or version, or damaged.
        FileError: the system refuses.
    """

    def __init__(self, path: Path, head: Mapping[str, Any], wait_s: float = 0.0) -> None:
        self.path, self._closing = path, ExitStack()
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            if path.is_dir():
                raise UsageError(f"{path} is a folder; allowed: a file", hint="name a file in it")
            path.touch()
            self._lock(wait_s)
            try:
                self._file = self._closing.enter_context(path.open("r+b", buffering=0))
                self.records = self._begin(head)
            except BaseException:
                self._closing.close()
                raise

    def _lock(self, wait_s: float) -> None:
        until = time.monotonic() + wait_s
        while True:
            try:
                self._closing.enter_context(locked(self.path, wait=False))
                return
            except BlockingIOError:
                if time.monotonic() >= until:
                    raise UsageError(
                        f"{self.path} is in use by another process",
                        hint="ask the server that uses it, or name another log",
                    ) from None
                time.sleep(0.02)

    def _begin(self, head: Mapping[str, Any]) -> list[Record]:
        """The records of the file, which gets its first line where it has none, or no decision."""
        lines, self._end = whole_lines(self._file.read())
        self._file.truncate(self._end)
        self._file.seek(self._end)
        if not lines:
            self.append(head)
            return []
        first, *records = parsed(self.path, lines)
        if not records and first != head:  # whoever began it decided nothing
            self._end = 0
            self._file.truncate(0)
            self._file.seek(0)
            self.append(head)
            return []
        if differing := differences(head, first):
            raise UsageError(
                f"{self.path} is the log of another {' and '.join(differing)}",
                hint="name another log, or move this one away to begin anew",
            )
        return records

    def append(self, record: Mapping[str, Any]) -> None:
        """Puts a line on the disk; what cannot be written to its end is taken back.

        Raises:
            FileError: the system refuses.
        """
        line = json.dumps(record, allow_nan=False, separators=(",", ":")).encode() + b"\n"
        try:
            written = 0
            while written < len(line):
                written += self._file.write(line[written:]) or 0
            os.fsync(self._file.fileno())
        except OSError as error:
            with suppress(OSError):  # a torn line is cut off by whoever opens the log next
                self._file.truncate(self._end)
                self._file.seek(self._end)
            raise file_error(f"cannot write {self.path}", error) from error
        self._end += len(line)

    def close(self) -> None:
        """Lets others use the log."""
        self._closing.close()


def differences(head: Mapping[str, Any], first: Mapping[str, Any]) -> list[str]:
    """What two logs are of that is not the same, in words."""
    keys = [key for key, value in head.items() if first.get(key) != value]
    return list(dict.fromkeys(key.removesuffix("_digest").replace("_", " ") for key in keys))


def whole_lines(data: bytes) -> tuple[list[bytes], int]:
    """The lines that were written to their end, and where the last of them ends."""
    end = data.rfind(b"\n") + 1
    return data[:end].splitlines(), end


def parsed(path: Path, lines: list[bytes]) -> list[Record]:
    """Lines of a log as records.

    Raises:
        UsageError: a line is none.
    """
    records = []
    for number, line in enumerate(lines, start=1):
        try:
            record = json.loads(line)
        except (ValueError, RecursionError):
            record = None
        if not isinstance(record, dict):
            raise UsageError(
                f"{path}, line {number}: no record; allowed: a log of `operate` or `serve`",
                hint="the file was changed; move it away to begin anew",
            )
        records.append(record)
    return records


def read_journal(path: Path) -> tuple[Record, list[Record]]:
    """What a log is of, and its decisions, without the use of it.

    Raises:
        UsageError: it is no log, or damaged.
    """
    lines, _ = whole_lines(checked_path(path).read_bytes())
    if not lines:
        raise UsageError(f"{path} is empty; allowed: a log", hint="see `operate --log`")
    head, *records = parsed(path, lines)
    return head, records
