"""The one verdict on what a reader makes of a file: read, refused in words, or a fault."""

from __future__ import annotations

import signal
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Literal

from resilience.errors import ResilienceError

LIMIT_S = 5.0
MAX_MESSAGE = 30_000
"""Characters of a message that somebody may still read."""

Verdict = Literal["read", "refused"]


class FaultError(AssertionError):
    """What no reader may do: a traceback, a hang, a warning, nonsense taken for sound."""


def verdict(read: Callable[[], Any], named: str, sound: Callable[[Any], object]) -> Verdict:
    """What comes of reading a file.

    Args:
        read: reads it.
        named: what a refusal must name, as the name of the file; empty: nothing.
        sound: raises where what was read is nonsense.

    Raises:
        FaultError: anything else than a sound value or a `ResilienceError` that names the file.
    """
    try:
        with time_limit(LIMIT_S), warnings.catch_warnings():
            warnings.simplefilter("error")
            value = read()
            sound(value)
    except ResilienceError as error:
        check_message(str(error), named)
        return "refused"
    except FaultError:
        raise
    except Exception as error:
        raise FaultError(f"{type(error).__name__}: {str(error)[:300]}") from error
    return "read"


def check_message(message: str, named: str) -> None:
    """Refuses a message that nobody can use."""
    if named not in message:
        raise FaultError(f"{named} is not named: {message[:300]}")
    if len(message) > MAX_MESSAGE:
        raise FaultError(f"a message of {len(message)} characters: {message[:300]}")


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Ends what takes longer, in time of the CPU: what else the machine does is no fault.

    Raises:
        FaultError: it does.
    """

    def ring(number: int, frame: FrameType | None) -> None:
        raise FaultError(f"more than {seconds:g} s")

    before = signal.signal(signal.SIGPROF, ring)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
