"""Long work: named phases, announced as they begin and timed when they end, and how far it is."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field

log = logging.getLogger("resilience")
NOTICE = 25
"""Level of what is said in any case: between INFO and WARNING."""
_seconds: ContextVar[dict[str, float] | None] = ContextVar("seconds", default=None)


def notice(text: str) -> None:
    """Says what a user must know, however short the work is."""
    log.log(NOTICE, text)


@contextmanager
def interruptible(note: Callable[[], str]) -> Iterator[None]:
    """On Ctrl-C within the block, says what is there and how to go on.

    Args:
        note: makes the text; what a block within has said counts before it.

    Raises:
        KeyboardInterrupt: with the text as its message.
    """
    try:
        yield
    except KeyboardInterrupt as stop:
        if stop.args:
            raise
        raise KeyboardInterrupt(note()) from None


@contextmanager
def phase(kind: str, detail: str = "") -> Iterator[None]:
    """Announces `kind (detail)` to the log and adds its seconds to the stopwatch under `kind`."""
    log.info(f"{kind} ({detail})" if detail else kind)
    began = time.perf_counter()
    try:
        yield
    finally:
        watch = _seconds.get()
        if watch is not None:
            watch[kind] = watch.get(kind, 0.0) + time.perf_counter() - began


@contextmanager
def stopwatch() -> Iterator[dict[str, float]]:
    """Seconds per kind of phase within the block, filled as phases end."""
    seconds: dict[str, float] = {}
    token = _seconds.set(seconds)
    try:
        yield seconds
    finally:
        _seconds.reset(token)


@dataclass
class Meter:
    """How far counted work is.

    Attributes:
        kind: what is done.
        total: how much there is.
        done: how much of it is finished.
        detail: what is at work now.
        show: who is told of every change, if anybody.
    """

    kind: str
    total: int
    done: int = 0
    detail: str = ""
    show: Callable[[Meter], None] | None = None
    _named: set[str] = field(default_factory=set, repr=False)

    def advance(self, amount: int) -> None:
        """Counts so much more as finished."""
        self.done += amount
        if self.show is not None:
            self.show(self)

    def on(self, detail: str) -> None:
        """Names what is at work now; it is announced once."""
        self.detail = detail
        if detail not in self._named:
            self._named.add(detail)
            log.info(f"{self.kind} ({detail})")


_viewer: ContextVar[Callable[[Meter], None] | None] = ContextVar("viewer", default=None)


@contextmanager
def meter(kind: str, total: int) -> Iterator[Meter]:
    """Counted work, shown to whoever watches; its seconds count under `kind` as a phase's do."""
    with phase(kind):
        yield Meter(kind, total, show=_viewer.get())


@contextmanager
def watching(show: Callable[[Meter], None]) -> Iterator[None]:
    """Calls `show` with every meter that changes within the block."""
    token = _viewer.set(show)
    try:
        yield
    finally:
        _viewer.reset(token)
