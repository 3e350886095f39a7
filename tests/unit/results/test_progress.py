"""Progress: phases and meters reach whoever watches, and a terminal shows a bar."""

from __future__ import annotations

import io
import logging

import pytest
from rich.console import Console

from resilience.cli.terminal import Ticker, progress_display
from resilience.progress import Meter, meter, stopwatch, watching


def test_a_meter_tells_who_watches() -> None:
    seen: list[tuple[int, int, str]] = []
    with watching(lambda m: seen.append((m.done, m.total, m.detail))), meter("work", 5) as work:
        work.on("first")
        work.advance(2)
        work.on("second")
        work.advance(3)
    assert seen == [(2, 5, "first"), (5, 5, "second")]
    with meter("work", 5) as work:
        work.advance(5)
    assert len(seen) == 2


def test_what_is_at_work_is_announced_once(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO, "resilience")
    with stopwatch() as seconds, meter("work", 3) as work:
        for name in ("a", "b", "a"):
            work.on(name)
    assert caplog.messages == ["work", "work (a)", "work (b)"]
    assert seconds["work"] >= 0


def test_a_bar_on_a_terminal_and_silence_elsewhere(capsys: pytest.CaptureFixture[str]) -> None:
    screen = io.StringIO()
    live = progress_display(Console(file=screen, force_terminal=True, width=80))
    ticker = Ticker(live, 0.0)
    with live:
        ticker.count(Meter("dispatch", 10, 4, "mpc"))
        assert live.tasks[0].percentage == pytest.approx(40.0)
    assert "dispatch (mpc)" in screen.getvalue()
    Ticker(None, 99.0).count(Meter("dispatch", 10, 4))
    assert capsys.readouterr() == ("", "")
