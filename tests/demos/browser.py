"""A page in a headless browser: opened from its file, moved, read, and watched for errors and requests."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome")


def missing() -> str:
    """What keeps the tests from a browser, empty when nothing does."""
    try:
        import selenium  # noqa: F401
    except ImportError:
        return "selenium is not installed: pip install '.[test]'"
    if not any(map(shutil.which, NAMES)):
        return "there is no chromium: apt-get install chromium chromium-driver"
    return "" if shutil.which("chromedriver") else "there is no chromedriver: apt-get install chromium-driver"


class Page:
    """One window; `open` waits until the page has drawn itself."""

    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def open(self, path: Path, *, width: int = 1280, height: int = 900, fragment: str = "") -> None:
        self.window(width, height)
        self.driver.get("about:blank")
        for kind in ("browser", "performance"):
            self.driver.get_log(kind)
        self.driver.get(path.as_uri() + fragment)

    def window(self, width: int, height: int, scale: float = 1) -> None:
        """The window's size, with so many points of the screen to a pixel; a narrow one is a telephone's."""
        self.driver.execute_cdp_cmd(
            "Emulation.setDeviceMetricsOverride",
            {"width": width, "height": height, "deviceScaleFactor": scale, "mobile": width < 500},
        )

    def run(self, code: str, *arguments: Any) -> Any:
        """The value that the body of a function returns in the page."""
        return self.driver.execute_script(code, *arguments)

    def settle(self) -> None:
        """Wait until every change has been drawn."""
        done = "const done = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(() => done()));"
        self.driver.execute_async_script(done)

    def measured(self) -> None:
        """Wait until the errors at every epsilon of the ladder have been measured."""
        self.driver.execute_async_script(
            "const done = arguments[0];"
            "const look = () => (ladder.length >= LADDER.length ? done() : setTimeout(look, 20)); look();"
        )

    def picture(self, view: str = "plane") -> str:
        return self.run("return views[arguments[0]].canvas.toDataURL()", view)

    def inked(self, view: str = "plane") -> int:
        """Pixels of a picture that are not empty."""
        return self.run(
            "const c = views[arguments[0]].canvas;"
            "const copy = document.createElement('canvas'); copy.width = c.width; copy.height = c.height;"
            "const context = copy.getContext('2d', { willReadFrequently: true }); context.drawImage(c, 0, 0);"
            "const d = context.getImageData(0, 0, c.width, c.height).data;"
            "let n = 0; for (let i = 3; i < d.length; i += 4) n += d[i] > 0; return n;",
            view,
        )

    def slide(self, slider: str, value: float) -> None:
        """Move a slider as a hand does."""
        self.run(
            "const s = document.getElementById(arguments[0]); s.value = String(arguments[1]);"
            "s.dispatchEvent(new Event('input', { bubbles: true }));",
            slider,
            value,
        )
        self.settle()

    def complaints(self) -> list[str]:
        """Everything that the console has said."""
        return [entry["message"] for entry in self.driver.get_log("browser")]

    def requests(self) -> list[str]:
        """Addresses that were asked for, but for the page itself and data that it holds."""
        found = []
        for entry in self.driver.get_log("performance"):
            message = json.loads(entry["message"])["message"]
            if message["method"] == "Network.requestWillBeSent":
                found.append(message["params"]["request"]["url"])
        return [url for url in found if not url.startswith(("data:", "file://", "about:"))]


def windows() -> Iterator[Page]:
    """A window, closed afterwards; skips where there is no browser, and fails there in continuous integration."""
    reason = missing()
    if reason:
        if os.environ.get("CI") == "true":
            pytest.fail(reason)
        pytest.skip(reason)
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = next(filter(None, map(shutil.which, NAMES)))
    for argument in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--window-size=1280,900"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
    try:
        driver.set_script_timeout(60)
        yield Page(driver)
    finally:
        driver.quit()
