"""What long work shows on stderr: a spinner and a bar on a terminal, a line per phase elsewhere."""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

from resilience.progress import Meter, watching

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
        """Shows one message; lines only once the work has lasted `quiet_s` seconds."""
        seconds = time.perf_counter() - self.began
        if self.task is not None:
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

    log = logging.getLogger("resilience")
    log.setLevel(logging.INFO)
    console = Console(stderr=True)
    live = progress_display(console) if console.is_terminal and not verbose else None
    ticker = Ticker(live, 0.0 if verbose else QUIET_S)
    log.addHandler(ticker)
    try:
        with live or nullcontext(), watching(ticker.count):
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


def print_written(*files: tuple[str, Path | None]) -> None:
    """Prints what was written where, a line each; files that were not wanted are left out."""
    for title, path in files:
        if path is not None:
            print(f"{title}: {path}")
