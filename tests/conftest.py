"""How Hypothesis and Ctrl-C behave in every test here, and which tests run when asked for only.

A failure is told as it was found, not made smaller first: that took minutes, in which a test run
may be ended before it says anything. `pytest --hypothesis-profile shrink TEST` makes it smaller.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Generator
from types import FrameType

import pytest
from hypothesis import Phase, settings

settings.register_profile("shrink", deadline=None)
settings.register_profile(
    "told at once",
    deadline=None,
    phases=(Phase.explicit, Phase.reuse, Phase.generate),
    print_blob=True,
)
settings.load_profile("told at once")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leaves out what is marked `exhaustive`, unless RESILIENCE_EXHAUSTIVE is set."""
    if os.environ.get("RESILIENCE_EXHAUSTIVE"):
        return
    left_out = [item for item in items if item.get_closest_marker("exhaustive")]
    if left_out:
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if not item.get_closest_marker("exhaustive")]


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Ctrl-C ends the run also where what a test calls takes it for its own, as commands do."""
    before = signal.getsignal(signal.SIGINT)
    if not callable(before):
        return (yield)

    def note(number: int, frame: FrameType | None) -> None:
        item.session.shouldstop = "interrupted"
        before(number, frame)

    signal.signal(signal.SIGINT, note)
    try:
        return (yield)
    finally:
        signal.signal(signal.SIGINT, before)
