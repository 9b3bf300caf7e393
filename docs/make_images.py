"""Make the pictures that README and index show, from the Intel log: ``python docs/make_images.py intel.clf.bz2``.

The picture of the report needs Chromium, chromedriver and selenium (``pip install '.[test]'``).
"""

from __future__ import annotations

import argparse
import io
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image
from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.support.wait import WebDriverWait

IMAGES = Path(__file__).parent / "images"
WINDOW = (1360, 1240)
CHROMIUM = ("--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--disable-background-networking")


def photograph(page: Path, out: Path) -> None:
    """The top of a page as a picture of few colours, once its map is drawn."""
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or shutil.which("google-chrome") or ""
    for flag in (*CHROMIUM, f"--window-size={WINDOW[0]},{WINDOW[1]}"):
        options.add_argument(flag)
    with webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver"))) as browser:
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", {
            "width": WINDOW[0], "height": WINDOW[1], "deviceScaleFactor": 1, "mobile": False})
        browser.get(page.resolve().as_uri())
        WebDriverWait(browser, 20).until(lambda b: b.execute_script("return document.readyState") == "complete")
        browser.execute_async_script("requestAnimationFrame(() => requestAnimationFrame(arguments[0]))")
        picture = Image.open(io.BytesIO(browser.get_screenshot_as_png())).convert("RGB")
    picture.quantize(96, dither=Image.Dither.NONE).save(out, optimize=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("log", type=Path, help="the Intel log (intel.clf.bz2)")
    with tempfile.TemporaryDirectory() as temporary:
        out = Path(temporary)
        command = [sys.executable, "-c", "from clew.cli import main; main()", "run", str(parser.parse_args().log)]
        subprocess.run([*command, "-o", str(out)], check=True)
        overview = Image.open(out / "overview.png").convert("RGB")
        overview.quantize(96, dither=Image.Dither.NONE).save(IMAGES / "intel.png", optimize=True)
        photograph(out / "report.html", IMAGES / "report.png")


if __name__ == "__main__":
    main()
