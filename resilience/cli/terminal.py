"""What long work shows on stderr: a spinner and a bar on a terminal, a line per phase elsewhere."""

from __future__ import annotations

import logging
import math
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from resilience.errors import ResilienceError
from resilience.progress import Meter, interruptible, watching

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

QUIET_S = 2.0  # shorter work needs no progress lines where there is no terminal


class Ticker(logging.Handler):
    """Shows the phase at work, and how far it is where that is counted.

    Args:
        live: the display of a terminal; None: lines.
        quiet_s: seconds of work before the first line.
    """

    def __init__(self, live: Progress | None, quiet_s: float) -> None:
        super().__init__()
        self.quiet_s = quiet_s
        self.began = time.perf_counter()
        self.task = None if live is None else (live, live.add_task("starting", total=None))

    def emit(self, record: logging.LogRecord) -> None:
        """Shows one message, a notice in any case; others, as lines, only once the work has
        lasted `quiet_s` seconds.
        """
        seconds = time.perf_counter() - self.began
        if record.levelno > logging.INFO:
            print(record.getMessage(), file=sys.stderr, flush=True)
        elif self.task is not None:
            live, task = self.task
            live.update(task, description=record.getMessage())
        elif seconds >= self.quiet_s:
            print(f"{seconds:6.1f} s  {record.getMessage()}", file=sys.stderr, flush=True)

    def count(self, meter: Meter) -> None:
        """Moves the bar; one that is full gives way to the spinner."""
        if self.task is not None:
            live, task = self.task
            total = meter.total if meter.done < meter.total else None
            text = f"{meter.kind} ({meter.detail})" if meter.detail else meter.kind
            live.update(task, description=text, completed=meter.done, total=total)


@contextmanager
def progress(verbose: bool) -> Iterator[None]:
    """Shows phases and meters of the block on stderr.

    Args:
        verbose: a line for every phase, also on a terminal.
    """
    from rich.console import Console

    console = Console(stderr=True)
    live = progress_display(console) if console.is_terminal and not verbose else None
    ticker = Ticker(live, 0.0 if verbose else QUIET_S)
    with _listening(ticker), live or nullcontext(), watching(ticker.count):
        yield


@contextmanager
def notices() -> Iterator[None]:
    """Shows on stderr what a user must know of the block, and none of its phases."""
    with _listening(Ticker(None, math.inf)):
        yield


@contextmanager
def _listening(ticker: Ticker) -> Iterator[None]:
    log = logging.getLogger("resilience")
    log.setLevel(logging.INFO)
    log.addHandler(ticker)
    try:
        yield
    finally:
        log.removeHandler(ticker)


def progress_display(console: Console) -> Progress:
    """A spinner, a bar and the time that has passed, for the phase that is on."""
    from rich.progress import (
        BarColumn,
        Progress,
        SpinnerColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    return Progress(
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        console=console,
        transient=True,
    )


def show(answer: Callable[[], object]) -> None:
    """Prints the answer; it is also written where whoever reads stdout has gone by now."""
    try:
        answer()
        sys.stdout.flush()
    except (BrokenPipeError, SystemExit):  # the latter is what rich makes of it
        silence()


def silence() -> None:
    """Lets what is still printed to stdout vanish."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@dataclass(frozen=True)
class Output:
    """A file or folder that a user asks for beside what is printed.

    Attributes:
        title: what it is called where it is announced.
        path: where; None: it is not asked for.
        write: writes it there.
    """

    title: str
    path: Path | None
    write: Callable[[Path], object]


def write(*outputs: Output, quiet: bool = False) -> None:
    """Writes what is asked for, after the answer was printed, and announces each on stdout.

    Args:
        outputs: those without a path are left out.
        quiet: nothing is announced, since stdout is one JSON object.

    Raises:
        ResilienceError: of the first that could not be written; the others are all the same.
    """
    errors = list[ResilienceError]()
    for output in outputs:
        if output.path is None:
            continue
        note = f"{output.path} is not written to the end; the same command writes it"
        try:
            with notices(), interruptible(lambda note=note: note):  # type: ignore[misc]
                output.write(output.path)
        except ResilienceError as error:
            errors.append(error)
        else:
            if not quiet:
                print_written((output.title, output.path))
    for further in errors[1:]:
        print(f"error: {further}", file=sys.stderr)
    if errors:
        raise errors[0]


def print_written(*files: tuple[str, Path | None]) -> None:
    """Prints what was written where, a line each; files that were not wanted are left out."""
    for title, path in files:
        if path is not None:
            print(f"{title}: {path}", flush=True)
