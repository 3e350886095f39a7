"""What the tests ask of a page in a browser."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service

FLAGS = ("--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--no-first-run")
OUT_OF_VIEW = """
const wide = document.documentElement.clientWidth;
return [...document.querySelectorAll("main *")].filter(shape => {
  if (shape.closest(".scroll") || shape.closest("svg")) return false;
  const box = shape.getBoundingClientRect();
  return box.width > 0 && (box.right > wide + 1 || box.left < -1);
}).map(shape => shape.tagName + " " + shape.className);
"""
"""Elements that stick out on either side; tables that scroll by themselves may."""
TEXT_OUT_OF_VIEW = """
const wide = document.documentElement.clientWidth;
return [...document.querySelectorAll("svg text")].filter(word => {
  const box = word.getBoundingClientRect();
  return box.right > wide + 1 || box.left < -1;
}).map(word => word.textContent);
"""


class Browser:
    """A headless Chromium that can be made as wide, and as dark, as a reader has it."""

    def __init__(self, driver: webdriver.Chrome) -> None:
        self.driver = driver

    @classmethod
    @contextmanager
    def opened(cls, program: str, driver: str) -> Iterator[Browser]:
        """A browser for as long as the block lasts."""
        options = Options()
        options.binary_location = program
        for flag in FLAGS:
            options.add_argument(flag)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        window = webdriver.Chrome(options=options, service=Service(driver))
        try:
            yield cls(window)
        finally:
            window.quit()

    def open(self, page: Path, *, width: int = 1280, dark: bool = False) -> None:
        """Opens a page without any network; screenshots go where RESILIENCE_SCREENSHOTS says."""
        self._command("Network.enable", {})
        self._command(
            "Network.emulateNetworkConditions",
            {"offline": True, "latency": 0, "downloadThroughput": 0, "uploadThroughput": 0},
        )
        shape = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 500}
        self._command("Emulation.setDeviceMetricsOverride", shape)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self._command("Emulation.setEmulatedMedia", {"features": [scheme]})
        self.driver.get(page.resolve().as_uri())
        if folder := os.environ.get("RESILIENCE_SCREENSHOTS"):
            self.picture(Path(folder) / f"{page.stem}-{width}-{'dark' if dark else 'light'}.png")

    def picture(self, path: Path) -> None:
        """Writes the whole page as a picture."""
        import base64

        high, wide = self.run(
            "const e = document.documentElement; return [e.scrollHeight, e.clientWidth]"
        )
        clip = {"x": 0, "y": 0, "width": wide, "height": high, "scale": 1}
        shot = self._command(
            "Page.captureScreenshot", {"captureBeyondViewport": True, "clip": clip}
        )
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(base64.b64decode(shot["data"]))

    def run(self, script: str, *arguments: object) -> Any:
        """What a script returns."""
        return self.driver.execute_script(script, *arguments)

    def messages(self) -> list[str]:
        """What the console was told since it was last asked."""
        return [str(entry["message"]) for entry in self.driver.get_log("browser")]

    def out_of_view(self) -> list[str]:
        """What sticks out of the page at the width that it has."""
        return [*self.run(OUT_OF_VIEW), *self.run(TEXT_OUT_OF_VIEW)]

    def _command(self, name: str, arguments: Mapping[str, object]) -> Any:
        return self.driver.execute_cdp_cmd(name, dict(arguments))
