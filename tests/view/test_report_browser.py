"""The report in a real browser: it opens without complaint, and slider, clicks and keys do what they say."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from clew.cli.mapping_job import JobOptions, map_log
from clew.factors import Between
from clew.geometry import SE3
from clew.graph import FactorGraph, Role
from clew.io import log_health
from clew.sim import simulate_demo
from clew.solve import optimize
from clew.view import report_of_solution, write_report
from view.browser import Browser, chromium

PATH, SCAN, OTHER = "#1668d6", "#0b7285", "#e8590c"  # colours of the light theme
LASTS = 330.0  # seconds; the robot comes back to where it was


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as running:
        yield running


@pytest.fixture(scope="module")
def page(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of a short simulated run that closes loops."""
    folder = tmp_path_factory.mktemp("run")
    log = simulate_demo(1, duration=LASTS)
    result = map_log(log, JobOptions(folder, "a <b>short</b> run"), Console(quiet=True),
                     health=lambda: log_health(log))
    assert result.slam.closures
    return folder / "report.html"


@pytest.fixture
def opened(browser: Browser, page: Path) -> Iterator[Browser]:
    browser.open(page)
    yield browser
    assert browser.errors() == []


def test_it_opens_in_time_and_says_what_it_is(opened: Browser) -> None:
    assert opened.text("h1") == "a <b>short</b> run"
    assert "The robot drove" in opened.text(".lead")
    assert opened.run("document.querySelectorAll('section').length") == 2
    assert opened.coloured("#ground", PATH) > 200
    assert opened.coloured("#ground", "#ffffff") > 5000  # free space of the map


def test_slider_replays_the_run(opened: Browser) -> None:
    whole = opened.coloured("#ground", PATH)
    counts = []
    for share in (0, 5000, 10000):
        opened.driver.execute_script(
            f"const s = document.getElementById('time'); s.value = {share}; s.dispatchEvent(new Event('input'))")
        opened.settle()
        counts.append(opened.coloured("#ground", PATH))
        assert opened.text("#clock").startswith(f"{LASTS * share / 10000:.1f} /")
    assert counts[0] < 60 < counts[1] < 0.9 * counts[2]
    assert counts[2] == whole
    assert opened.coloured("#map", SCAN) == 0  # at the end no scan lies over the map
    opened.driver.execute_script("document.getElementById('time').value = 3000;"
                                 "document.getElementById('time').dispatchEvent(new Event('input'))")
    opened.settle()
    assert opened.coloured("#map", SCAN) > 50


def test_play_and_pause_and_step(opened: Browser) -> None:
    opened.keys(" ")
    opened.wait("parseFloat(document.getElementById('clock').textContent) > 1")
    assert opened.run("document.getElementById('play').getAttribute('aria-label')") == "Pause"
    opened.keys(" ")
    stopped = opened.text("#clock")
    opened.settle()
    assert opened.text("#clock") == stopped
    opened.keys(".")
    later = float(opened.text("#clock").split(" /")[0])
    opened.keys(",", ",")
    assert float(opened.text("#clock").split(" /")[0]) < later


def test_click_on_a_pose_shows_its_scan_and_covariance(opened: Browser) -> None:
    opened.driver.execute_script("const input = document.querySelector('#inspector input'); input.value = '40';"
                                 "input.form.requestSubmit()")
    opened.settle()
    assert opened.text("#inspector h2") == "Pose 40"
    opened.keys("\ue00c")  # Escape
    assert opened.text("#inspector h2") == "Nothing selected"
    for layer in ("closures", "landmarks"):  # nothing else may lie on it
        opened.driver.execute_script(f"const box = document.querySelector('[data-layer={layer}]');"
                                     "if (box && box.checked) box.click()")
    opened.click_map()
    assert opened.text("#inspector h2") == "Pose 40"
    panel = opened.text("#inspector")
    assert "95 % ellipse" in panel
    assert "correlation x y" in panel
    assert opened.coloured("#inspector canvas.scan", SCAN) > 50
    assert opened.coloured("#map", SCAN) > 50


def test_click_on_a_closure_shows_both_scans_before_and_after(opened: Browser) -> None:
    opened.keys("n", "n")
    named = opened.text("#inspector h2")
    assert named.startswith("Closure ")
    opened.keys("\ue00c")
    opened.click_map()
    assert opened.text("#inspector h2") == named
    panel = opened.text("#inspector")
    for evidence in ("Believed", "returns with a partner", "returns in free space", "moved from what was expected"):
        assert evidence in panel
    before, after = ("#inspector [data-overlay=before]", "#inspector [data-overlay=after]")
    for canvas in (before, after):
        assert opened.coloured(canvas, SCAN, 60) > 30
        assert opened.coloured(canvas, OTHER, 60) > 30
    assert (opened.pixels(before) != opened.pixels(after)).any()
    opened.driver.execute_script("[...document.querySelectorAll('#inspector .nav button')]"
                                 ".find((b) => b.textContent === 'Next').click()")
    assert opened.text("#inspector h2") != named


def test_closures_of_summarised_keyframes_are_shown_without_their_scans(opened: Browser, page: Path) -> None:
    with (page.parent / "closures.csv").open() as file:
        rows = [(row["source"], row["target"]) for row in csv.DictReader(file)]
    data = opened.run("JSON.parse(document.getElementById('report-data').textContent)")
    assert len(data["closures"]) == len(rows)
    poses = opened.run(f"atob('{data['poses']['heading']['data']}').length / 4")
    k = next(k for k, c in enumerate(data["closures"]) if c["target"] < poses <= c["source"])
    opened.driver.execute_script(
        "const link = document.createElement('button'); link.dataset.focus = `closure ${arguments[0]} -1`;"
        "document.body.append(link); link.click(); link.remove()", k)
    opened.settle()
    source, target = rows[k]
    assert opened.text("#inspector h2") == f"Closure {source} → {target}"
    assert f"Not kept: the scan of {source}." in opened.text("#inspector")
    assert opened.coloured("#inspector [data-overlay=after]", SCAN, 60) > 30


def test_map_is_moved_scaled_and_seen_whole_again(opened: Browser) -> None:
    whole, scale = opened.pixels("#ground"), opened.text("#scale-text")
    opened.drag_map(120, 60)
    moved = opened.pixels("#ground")
    np.testing.assert_array_equal(moved[100:-100, 200:-200], whole[40:-160, 80:-320])
    opened.keys("+", "+", "+", "+")
    assert opened.text("#scale-text") != scale
    opened.keys("0")
    np.testing.assert_array_equal(opened.pixels("#ground"), whole)
    opened.keys("\ue012")  # left arrow: the map moves to the right
    assert (opened.pixels("#ground") != whole).any()


def test_layers_can_be_switched(opened: Browser) -> None:
    assert opened.coloured("#ground", PATH) > 200
    opened.driver.execute_script("document.querySelector('[data-layer=trajectory]').click()")
    opened.settle()
    assert opened.coloured("#ground", PATH) == 0
    opened.driver.execute_script("document.querySelector('[data-layer=steps]').click()")
    opened.settle()
    assert opened.coloured("#ground", PATH) > 100


def test_rows_of_tables_lead_to_the_map(opened: Browser) -> None:
    opened.driver.execute_script("document.querySelector('td [data-focus^=edge]').click()")
    opened.settle()
    assert " edge " in opened.text("#inspector h2")
    assert opened.text("#status").endswith("selected")


def test_dark_and_light(opened: Browser) -> None:
    light = opened.run("getComputedStyle(document.body).backgroundColor")
    opened.driver.execute_script("document.getElementById('theme').click()")
    opened.settle()
    assert opened.run("document.documentElement.dataset.theme") == "dark"
    assert opened.run("getComputedStyle(document.body).backgroundColor") != light
    assert opened.coloured("#ground", "#ffffff", 10) == 0


def test_everything_is_reached_by_the_keyboard(opened: Browser) -> None:
    opened.driver.execute_script("document.body.focus()")
    reached = set()
    for _ in range(60):
        opened.driver.switch_to.active_element.send_keys("\ue004")  # Tab
        reached.add(opened.run("document.activeElement.id || document.activeElement.dataset.layer || ''"))
        if "speed" in reached and "grid" in reached:
            break
    assert {"theme", "map", "zoom-in", "zoom-out", "fit", "play", "time", "speed", "grid", "trajectory"} <= reached
    assert opened.run("[...document.querySelectorAll('button')].every((b) => b.textContent.trim() || b.ariaLabel)")


@pytest.mark.parametrize("width", [360, 820])
def test_narrow_windows(browser: Browser, page: Path, width: int) -> None:
    browser.open(page, width, 800)
    assert browser.run("document.documentElement.scrollWidth") <= width
    assert browser.run("document.getElementById('map').clientWidth") >= 0.85 * width
    assert browser.errors() == []


def test_graph_in_space_turns(browser: Browser, tmp_path: Path) -> None:
    graph = FactorGraph()
    turn = np.linspace(0, 12, 80)
    poses = np.column_stack([5 * np.cos(turn), 5 * np.sin(turn), turn, *np.zeros((3, 80)), np.ones(80)])
    graph.add_pose(SE3.from_array(poses))
    for step, role in ((1, Role.ODOMETRY), (40, Role.LOOP)):
        ends = np.arange(80 - step)
        seen = SE3.from_array(poses[:-step]).between(SE3.from_array(poses[step:]))
        graph.add(Between(ends, ends + step, seen, sigmas=0.05, role=role))
    write_report(tmp_path / "report.html", report_of_solution(optimize(graph, init="file"), "a helix"))
    browser.open(tmp_path / "report.html")
    before = browser.pixels("#ground")
    assert browser.coloured("#ground", PATH) > 100
    browser.keys("\ue014")  # right arrow turns
    turned = browser.pixels("#ground")
    assert (turned != before).any()
    browser.drag_map(60, 30)
    assert (browser.pixels("#ground") != turned).any()
    assert browser.errors() == []
