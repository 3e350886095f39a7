"""A browser without a window, for pages as their readers see them."""

from __future__ import annotations

import shutil
from collections.abc import Iterator

import pytest

pytest.importorskip("selenium", reason="the extra `browser` is not installed")

from tests.browser.pages import Browser

CHROMIUM = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Chromium; where there is none, what needs it skips."""
    program = next((path for name in CHROMIUM if (path := shutil.which(name))), None)
    driver = shutil.which("chromedriver")
    if program is None or driver is None:
        pytest.skip("no Chromium with its chromedriver at hand: apt-get install chromium-driver")
    with Browser.opened(program, driver) as opened:
        yield opened
