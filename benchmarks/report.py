"""How large reports are, how soon they show a picture, and how smoothly they move, in a headless Chromium.

    python benchmarks/report.py                      all of them
    python benchmarks/report.py intel city10000      some
    python benchmarks/report.py --page out/report.html   a page that is there already

Needs selenium, Chromium and chromedriver. Times are those of the page itself, in milliseconds: the first picture counts
from the start of the navigation (`performance.now()` when the map, its grid included, has been drawn); frames are the
intervals between animation frames while the mouse drags the map around, while the wheel zooms in and out, and in
the replay.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))
DATA = ROOT / ".." / "shared" / "data"


def pages(names: list[str], folder: Path) -> dict[str, Path]:
    """Make the reports that are asked for."""
    from rich.console import Console

    from clew.cli.mapping_job import JobOptions, map_log
    from clew.io import log_health, open_log, read_graph
    from clew.sim import simulate_demo
    from clew.solve import optimize
    from clew.view import report_of_solution, write_report

    graphs = {"city10000": "graphs2d/city10000.g2o", "sphere2500": "graphs3d/sphere2500.g2o",
              "victoria": "landmarks/victoriaPark-full.g2o.gz"}
    logs = {"intel": lambda: open_log(DATA / "lidar/intel.clf.bz2"), "demo": lambda: simulate_demo(1)}
    unknown = set(names) - {*graphs, *logs, "large"}
    if unknown:
        raise SystemExit(f"no report {', '.join(sorted(unknown))}; choose of {', '.join((*logs, *graphs, 'large'))}")
    made = {}
    for name in names or [*logs, *graphs, "large"]:
        made[name] = folder / f"{name}.html"
        if name == "large":
            large(made[name])
        elif name in graphs:
            write_report(made[name], report_of_solution(optimize(read_graph(DATA / graphs[name]).graph), name))
        else:
            log = logs[name]()
            map_log(log, JobOptions(folder, name), Console(quiet=True),
                    health=lambda log=log: log_health(log))
            (folder / "report.html").rename(made[name])
    return made


def large(page: Path) -> None:
    """A page as large as a report that is to stay quick: 10,000 poses with 360 returns each, 2,000 x 2,000 cells.

    The poses wind through a hall with pillars; the numbers are made up, the page is what counts.
    """
    from clew.factors import Between
    from clew.geometry import SE2
    from clew.graph import FactorGraph, Role
    from clew.mapping import OccupancyGrid
    from clew.solve import optimize
    from clew.view import report_of_solution, write_report

    count, rng = 10_000, np.random.default_rng(0)
    along = np.linspace(0, 60 * np.pi, count)
    poses = np.column_stack([40 * np.sin(along) + 5, 45 * np.cos(along * 0.71), along % 6])
    graph = FactorGraph()
    graph.add_pose(SE2.from_array(poses))
    for step, role in ((1, Role.ODOMETRY), (4000, Role.LOOP), (2500, Role.LOOP)):
        ends = np.arange(count - step)
        seen = SE2.from_array(poses[:-step]).between(SE2.from_array(poses[step:]))
        graph.add(Between(ends, ends + step, seen, sigmas=0.05, role=role))
    found = report_of_solution(optimize(graph, init="file"), "10,000 poses")
    log_odds = rng.normal(-2.0, 0.5, (2000, 2000)).astype(np.float32)
    log_odds[::100] = log_odds[:, ::100] = 3.0
    log_odds[:300] = 0.0
    angles = np.linspace(-np.pi, np.pi, 360)
    scans = [np.column_stack([np.cos(angles), np.sin(angles)]) * rng.uniform(1, 20, (360, 1)) for _ in range(count)]
    scene = replace(found.scene, scans=scans, grid=OccupancyGrid(log_odds, 0.05, np.array([-50.0, -50.0])))
    write_report(page, replace(found, scene=scene))


def measure(browser: object, page: Path, width: int, height: int) -> dict[str, float]:
    """Milliseconds of one page, and its size."""
    from view.browser import Browser

    assert isinstance(browser, Browser)
    browser.open(page, width, height)
    browser.settle()
    box = browser.run("(() => { const b = document.getElementById('map').getBoundingClientRect();"
                      "return [b.left + b.width / 2, b.top + Math.min(b.height / 2, innerHeight - b.top - 60)] })()")
    result = {"megabytes": page.stat().st_size / 1e6,
              "first picture": float(browser.run("document.documentElement.dataset.drawn"))}

    def mouse(kind: str, x: float, y: float, **more: object) -> None:
        browser.driver.execute_cdp_cmd("Input.dispatchMouseEvent", {"type": kind, "x": x, "y": y, **more})

    def frames(name: str, action: object) -> None:
        browser.driver.execute_script(
            "window.frames_ = []; let last = 0; window.watching = true;"
            "const tick = (now) => { if (last) frames_.push(now - last); last = now;"
            "if (watching) requestAnimationFrame(tick) };"
            "requestAnimationFrame(tick)")
        action()  # type: ignore[operator]
        times = np.array(browser.run("(() => { watching = false; return frames_ })()"), float)
        result[f"{name} median"], result[f"{name} 95 %"] = float(np.median(times)), float(np.percentile(times, 95))
        result[f"{name} longest"] = float(times.max())

    def pan() -> None:
        x, y = box
        mouse("mousePressed", x, y, button="left", clickCount=1)
        for k in range(240):
            angle = 2 * np.pi * k / 80
            mouse("mouseMoved", x + 260 * np.sin(angle), y + 140 * np.sin(2 * angle), button="left", buttons=1)
        mouse("mouseReleased", x, y, button="left", clickCount=1)

    def zoom() -> None:
        for k in range(160):
            mouse("mouseWheel", *box, deltaX=0, deltaY=-40 if k % 80 < 40 else 40)

    def replay() -> None:
        browser.driver.execute_script(
            "document.getElementById('speed').value = '15'; document.getElementById('play').click()")
        browser.driver.execute_async_script("setTimeout(arguments[0], 5000)")
        browser.driver.execute_script("document.getElementById('play').click()")

    for name, action in (("panning", pan), ("zooming", zoom), ("replay", replay)):
        frames(name, action)
        browser.settle()
    errors = browser.errors()
    if errors:
        raise SystemExit(f"{page.name}: {errors}")
    return result


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="intel, demo, city10000, sphere2500, victoria, large; default: all")
    parser.add_argument("--page", type=Path, action="append", default=[], help="measure a page that is there already")
    parser.add_argument("--size", type=int, nargs=2, default=(1440, 900), metavar=("WIDTH", "HEIGHT"),
                        help="of the window")
    options = parser.parse_args()
    from view.browser import chromium

    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        made = {page.stem: page for page in options.page}
        if options.names or not made:
            made |= pages(options.names, Path(folder))
        columns = ["megabytes", "first picture", *(f"{what} {which}" for what in ("panning", "zooming", "replay")
                                                   for which in ("median", "95 %", "longest"))]
        print("| report | " + " | ".join(columns) + " |")
        print("| --- |" + " ---: |" * len(columns))
        for name, page in made.items():
            found = measure(browser, page, *options.size)
            print(f"| {name} | " + " | ".join(f"{found[column]:.1f}" for column in columns) + " |", flush=True)


if __name__ == "__main__":
    main()
