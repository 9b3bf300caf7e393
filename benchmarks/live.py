"""What the live view costs a run: the same log with and without it, turn by turn, a browser attached.

    python benchmarks/live.py                      # the real logs of ../shared/data/lidar, 5 pairs of runs each
    python benchmarks/live.py fr079 --pairs 9
    python benchmarks/live.py --no-browser         # a client that only reads, where there is no Chromium
    python benchmarks/live.py mit-csail --rerun    # the recording for rerun in place of the browser

Each run is a process of its own that maps and refines a log; measured are its processor time, all threads, and the time
on the clock. A page in Chromium without a screen (selenium, chromedriver) shows the map during every second run. Where
the browser has no core of its own, the clock also counts what it takes from the run: then the processor time is the
cost of attaching a page, and the clock that of the browser beside it.
"""

from __future__ import annotations

import argparse
import json
import shutil
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from clew.io import open_log
from clew.motion import Odometry
from clew.slam import Slam
from clew.view.live import BrowserViewer, RerunViewer

DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "lidar"
LOGS = ("intel", "fr079", "mit-csail")


def run(name: str, view: str, record: Path | None) -> None:
    """One run in this process; prints its times as JSON, and before that the address of its page."""
    log = open_log(DATA / f"{name}.clf.bz2")
    viewer: Any = None
    if view == "browser":
        viewer = BrowserViewer(name, total=log.scan_count)
        print(viewer.url, flush=True)
        until = time.monotonic() + 30
        while not viewer.server.streams and time.monotonic() < until:
            time.sleep(0.05)
    elif view == "rerun":
        viewer = RerunViewer(name, record, log.scan_count)
    cpu, clock = time.process_time(), time.perf_counter()
    slam = Slam(viewer=viewer)
    for measurement in log.measurements():
        if isinstance(measurement, Odometry):
            slam.add_odometry(measurement)
        elif slam.has_odometry and (not slam.scan_count or measurement.timestamp > slam.time_span[1]):
            slam.add_scan(measurement)
    slam.refine()
    pages = viewer.server.streams if view == "browser" else 0
    times = {"cpu": time.process_time() - cpu, "clock": time.perf_counter() - clock, "pages": pages}
    if viewer is not None:
        viewer.close()
    print(json.dumps(times), flush=True)


class Reader:
    """A client that reads the stream and does nothing with it."""

    def get(self, url: str) -> None:
        threading.Thread(target=self._read, args=(url,), daemon=True).start()

    @staticmethod
    def _read(url: str) -> None:
        with suppress(OSError), urllib.request.urlopen(url + "events") as stream:
            while stream.readline():
                pass


@contextmanager
def attached(real: bool) -> Iterator[Any]:
    """A browser, or what stands for one."""
    if not real:
        yield Reader()
        return
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or shutil.which("google-chrome") or ""
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--window-size=1200,800"):
        options.add_argument(argument)
    with webdriver.Chrome(options=options, service=webdriver.ChromeService(shutil.which("chromedriver"))) as browser:
        yield browser


def measure(name: str, view: str, browser: Any) -> dict[str, float]:
    """One run in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, __file__, name, "--one", view, "--record", str(Path(folder) / "run.rrd")]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert process.stdout is not None
        if view == "browser":
            browser.get(process.stdout.readline().strip())
        lines = process.stdout.read().splitlines()
        if process.wait() != 0 or not lines:
            raise SystemExit(f"the run of {name} failed")
    times: dict[str, float] = json.loads(lines[-1])
    if view == "browser" and times["pages"] != 1:
        raise SystemExit(f"{times['pages']} pages were attached at the end of the run, not 1")
    return times


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("logs", nargs="*", default=LOGS, metavar="LOG", help=f"of {', '.join(LOGS)}; all by default")
    parser.add_argument("--pairs", type=int, default=5, help="runs with and without the view")
    parser.add_argument("--no-browser", action="store_true", help="attach a client that only reads")
    parser.add_argument("--rerun", action="store_true", help="measure the recording for rerun")
    parser.add_argument("--one", choices=("none", "browser", "rerun"), help=argparse.SUPPRESS)
    parser.add_argument("--record", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        run(options.logs[0], options.one, options.record)
        return
    view = "rerun" if options.rerun else "browser"
    print("| log | view | processor s, without | with | cost, median | least to largest | clock s, without | with |")
    print("| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: |")
    with attached(real=view == "browser" and not options.no_browser) as browser:
        for name in options.logs:
            pairs = [(measure(name, "none", browser), measure(name, view, browser)) for _ in range(options.pairs)]
            costs = [100 * (shown["cpu"] / plain["cpu"] - 1) for plain, shown in pairs]
            plain, shown = ({key: statistics.median(pair[side][key] for pair in pairs) for key in ("cpu", "clock")}
                            for side in (0, 1))
            print(f"| {name} | {view} | {plain['cpu']:.2f} | {shown['cpu']:.2f} | {statistics.median(costs):+.1f} % | "
                  f"{min(costs):+.1f} to {max(costs):+.1f} % | {plain['clock']:.2f} | {shown['clock']:.2f} |",
                  flush=True)


if __name__ == "__main__":
    main()
