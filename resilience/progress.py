"""Named phases of long work: announced as they begin, timed when they end."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

log = logging.getLogger("resilience")
_seconds: ContextVar[dict[str, float] | None] = ContextVar("seconds", default=None)


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
