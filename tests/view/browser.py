"""A headless Chromium that opens pages from disk, where there is one."""

from __future__ import annotations

import base64
import io
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
         "--disable-background-networking", "--disable-component-update", "--force-device-scale-factor=1")
PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
PATIENCE = 30.0  # seconds, on a machine that is busy


class Browser:
    """A page and what a person does with it."""

    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def open(self, page: Path, width: int = 1280, height: int = 900) -> None:
        """Open a file and wait until its map is drawn."""
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", {
            "width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600})
        self.driver.get(page.resolve().as_uri())
        self.wait("document.documentElement.dataset.drawn")

    def run(self, script: str) -> Any:
        """Value of an expression in the page."""
        return self.driver.execute_script(f"return {script}")

    def wait(self, condition: str) -> None:
        """Until an expression is true."""
        deadline = time.monotonic() + PATIENCE
        while not self.run(condition):
            assert time.monotonic() < deadline, f"still not: {condition}; {self.errors()}"
            time.sleep(0.03)

    def settle(self) -> None:
        """Until what was asked for has been drawn, a moment of rest after a move included."""
        self.driver.execute_async_script(
            "const done = arguments[0], frame = requestAnimationFrame; setTimeout(() => frame(() => frame(done)), 200)")

    def text(self, selector: str) -> str:
        """Text of an element."""
        return str(self.run(f"document.querySelector('{selector}').innerText"))

    def keys(self, *keys: str, on: str = "#map") -> None:
        """Press keys on an element, through the browser's own input."""
        self.driver.execute_script(f"document.querySelector('{on}').focus()")
        from selenium.webdriver.common.action_chains import ActionChains

        ActionChains(self.driver).send_keys(*keys).perform()
        self.settle()

    def click_map(self, dx: int = 0, dy: int = 0) -> None:
        """Click on the map, beside its middle."""
        self._pointer(dx, dy).click().perform()
        self.settle()

    def drag_map(self, dx: int, dy: int) -> None:
        """Drag the map."""
        self._pointer(0, 0).click_and_hold().move_by_offset(dx // 2, dy // 2).move_by_offset(
            dx - dx // 2, dy - dy // 2).release().perform()
        self.settle()

    def _pointer(self, dx: int, dy: int) -> Any:
        from selenium.webdriver.common.action_chains import ActionChains
        from selenium.webdriver.common.by import By

        return ActionChains(self.driver, duration=20).move_to_element_with_offset(
            self.driver.find_element(By.ID, "map"), dx, dy)

    def pixels(self, canvas: str) -> np.ndarray:
        """``(height, width, 4)`` of a canvas."""
        data = self.run(f"document.querySelector('{canvas}').toDataURL()")
        return np.asarray(Image.open(io.BytesIO(base64.b64decode(data.split(",")[1]))).convert("RGBA")).astype(int)

    def coloured(self, canvas: str, colour: str, tolerance: int = 30) -> int:
        """How many opaque pixels of a canvas have about a colour."""
        pixels = self.pixels(canvas)
        wanted = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)])
        return int(((np.abs(pixels[..., :3] - wanted).max(axis=-1) <= tolerance) & (pixels[..., 3] > 128)).sum())

    def errors(self) -> list[str]:
        """What the console complained of since the last call."""
        return [str(entry["message"]) for entry in self.driver.get_log("browser")]


@contextmanager
def chromium() -> Iterator[Browser]:
    """A browser of its own; the test is skipped, with the reason, where there is none."""
    selenium = pytest.importorskip("selenium.webdriver", reason="needs selenium: pip install 'clew[test]'")
    program = next(filter(None, map(shutil.which, PROGRAMS)), None)
    driver = shutil.which("chromedriver")
    if program is None or driver is None:
        pytest.skip("needs Chromium and chromedriver on the PATH")
    with tempfile.TemporaryDirectory() as profile:
        options = selenium.ChromeOptions()
        for flag in (*FLAGS, f"--user-data-dir={profile}"):
            options.add_argument(flag)
        options.binary_location = program
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        running = selenium.Chrome(options=options, service=selenium.ChromeService(driver))
        try:
            yield Browser(running)
        finally:
            running.quit()
