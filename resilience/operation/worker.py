"""A thread that does calls one after another, so that whoever waits for one may stop waiting."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from queue import SimpleQueue
from typing import Any, TypeVar

T = TypeVar("T")
Item = tuple[Callable[[], Any], "Future[Any]"]


class Worker:
    """Does calls in their order, in a thread of its own that ends with the process.

    A call that nobody waits for any more is done all the same, and those behind it wait for it: so
    what is called has taken notice of everything, in order.
    """

    def __init__(self) -> None:
        self._queue: SimpleQueue[Item | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._work, name="dispatcher", daemon=True)
        self._thread.start()

    def submit(self, call: Callable[[], T]) -> Future[T]:
        """The result to come of a call, behind all that were submitted before."""
        future: Future[T] = Future()
        self._queue.put((call, future))
        return future

    def stop(self, wait_s: float = 1.0) -> None:
        """Ends the thread behind the calls that are submitted, and waits a moment for that."""
        self._queue.put(None)
        self._thread.join(wait_s)

    @property
    def is_alive(self) -> bool:
        """Whether the thread has not ended; once it was stopped, that it is still at work."""
        return self._thread.is_alive()

    def _work(self) -> None:
        while item := self._queue.get():
            call, future = item
            try:
                result = call()
            except BaseException as error:
                future.set_exception(error)
            else:
                future.set_result(result)
