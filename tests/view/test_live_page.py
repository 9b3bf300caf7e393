"""The live page in a real browser without a screen."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import pytest

from clew.slam import Slam
from clew.view.live import BrowserViewer
from view.browser import chromium
from view.test_live import drive, mapped, until


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as started:
        yield started.driver


def pressed(browser: Any, name: str) -> bool:
    return browser.find_element("id", name).get_attribute("aria-pressed") == "true"


def told(browser: Any, name: str) -> str:
    return str(browser.execute_script("return document.body.dataset[arguments[0]] || ''", name))


def colours(browser: Any) -> int:
    """How many colours the canvas shows."""
    return int(browser.execute_script("""
        const canvas = document.getElementById("map"), seen = new Set();
        const image = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
        const data = new Uint32Array(image.data.buffer);
        for (const pixel of data) seen.add(pixel);
        return seen.size;"""))


def test_page_shows_a_run_from_its_first_scan_to_its_end(browser: Any) -> None:
    with BrowserViewer("office", total=drive().scan_count) as viewer:
        browser.get(viewer.url)
        assert until(lambda: viewer.server.streams == 1)
        assert browser.find_element("id", "empty").is_displayed()
        slam = Slam(viewer=viewer)
        for measurement in drive().measurements():
            slam.add(measurement)
            if slam.scan_count == 20 and not told(browser, "keyframes"):
                viewer.moved(slam)
                assert until(lambda: int(told(browser, "keyframes") or 0) > 2)
                assert not browser.find_element("id", "empty").is_displayed()
                assert colours(browser) > 5
        slam.refine()
    assert until(lambda: browser.find_element("id", "stage").text == "finished")
    assert until(lambda: told(browser, "drawn") == str(len(slam.keyframes)))
    time.sleep(1.0)  # a page that tried to connect again would say so
    assert browser.find_element("id", "stage").text == "finished"
    assert f"{len(slam.keyframes)} keyframes" in browser.find_element("id", "numbers").text
    assert browser.get_log("browser") == []


def test_pause_holds_the_picture_and_resume_catches_up(browser: Any) -> None:
    with BrowserViewer("office") as viewer:
        browser.get(viewer.url)
        assert until(lambda: viewer.server.streams == 1)
        viewer.stage("one")
        assert until(lambda: told(browser, "stage") == "one")
        browser.find_element("id", "pause").click()
        assert pressed(browser, "pause")
        mapped(viewer, refine=False)
        viewer.stage("two")
        time.sleep(0.5)
        assert told(browser, "stage") == "one"
        browser.find_element("id", "map").send_keys(" ")
        assert not pressed(browser, "pause")
        assert until(lambda: told(browser, "stage") == "two")
    assert browser.get_log("browser") == []


def test_view_follows_fits_and_is_moved_by_keys(browser: Any) -> None:
    with BrowserViewer("office") as viewer:
        browser.get(viewer.url)
        slam = mapped(viewer)
        assert until(lambda: told(browser, "drawn") == str(len(slam.keyframes)))
        canvas = browser.find_element("id", "map")
        assert pressed(browser, "fit")
        before = canvas.screenshot_as_png
        canvas.send_keys("+")
        canvas.send_keys("\ue012")  # arrow left
        assert not pressed(browser, "fit")
        assert until(lambda: canvas.screenshot_as_png != before)
        canvas.send_keys("f")
        assert pressed(browser, "follow")
        canvas.send_keys("0")
        assert pressed(browser, "fit")
        assert not pressed(browser, "follow")
    assert browser.get_log("browser") == []


def test_server_that_goes_without_a_word_is_told(browser: Any) -> None:
    viewer = BrowserViewer("office")
    browser.get(viewer.url)
    assert until(lambda: viewer.server.streams == 1)
    viewer.server.close()
    assert until(lambda: "connection lost" in browser.find_element("id", "stage").text
                 or "over" in browser.find_element("id", "stage").text)
