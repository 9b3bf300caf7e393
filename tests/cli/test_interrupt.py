"""Ctrl-C: what has been mapped so far is written, and the exit code says so."""

from __future__ import annotations

import json
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from rich.console import Console

from clew.cli.interrupt import Interrupt
from clew.cli.mapping_job import JobOptions, map_log
from clew.cli.progress import JobProgress
from clew.io import read_graph, read_tum
from clew.motion import Odometry
from clew.scan import LaserScan
from cli.commands import FILES, PROGRAM, drive, environment


class Stopped:
    """A log during which Ctrl-C is pressed at a scan."""

    report, scan_count, duration = drive().report, drive().scan_count, drive().duration

    def __init__(self, at: int) -> None:
        self.at = at

    def measurements(self) -> Iterator[LaserScan | Odometry]:
        scans = 0
        for measurement in drive().measurements():
            if scans == self.at:
                signal.raise_signal(signal.SIGINT)
            yield measurement
            scans += isinstance(measurement, LaserScan)


def test_log_that_is_stopped_is_written_as_far_as_it_came(tmp_path: Path) -> None:
    result = map_log(Stopped(20), JobOptions(tmp_path, "stopped"), Console(quiet=True))
    assert result.interrupted
    assert (result.summary["complete"], result.summary["refined"], result.summary["scans"]) == (False, False, 20)
    assert len(read_tum(tmp_path / "trajectory.tum")[0]) == 20
    assert len(read_graph(tmp_path / "graph.g2o").graph) == result.summary["keyframes"]


def test_refinement_that_is_stopped_ends_with_its_round(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rounds: list[int] = []

    def refining(self: JobProgress, done: int, most: int) -> None:
        rounds.append(done)
        if done == 1:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(JobProgress, "refining", refining)
    result = map_log(drive(), JobOptions(tmp_path, "stopped"), Console(quiet=True))
    assert rounds == [0, 1]
    assert result.interrupted
    assert (result.summary["complete"], result.summary["refined"]) == (True, False)
    assert "The refinement was interrupted" in (tmp_path / "report.html").read_text()


def test_stop_before_any_scan_is_a_plain_interrupt(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        map_log(Stopped(0), JobOptions(tmp_path, "stopped"), Console(quiet=True))
    assert not list(tmp_path.iterdir())


def test_first_request_waits_and_the_second_ends() -> None:
    before = signal.getsignal(signal.SIGINT)
    with Interrupt() as interrupt:
        assert not interrupt.requested
        signal.raise_signal(signal.SIGINT)
        assert interrupt.requested
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before


def interrupted(out: Path, wait: float) -> set[str]:
    """Files that a demo leaves when Ctrl-C comes `wait` seconds after it has begun."""
    process = subprocess.Popen([*PROGRAM, "demo", "-o", str(out), "--seconds", "900"], env=environment(),
                               stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        deadline = time.monotonic() + 60
        while not out.exists() and time.monotonic() < deadline:
            time.sleep(0.05)
        time.sleep(wait)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130, errors
    assert "Traceback" not in errors
    assert errors.splitlines()[-1].startswith(("clew: interrupted", "interrupted: "))
    return {p.name for p in out.iterdir()}


def test_process_that_is_interrupted_writes_all_files_or_none_and_exits_with_130(tmp_path: Path) -> None:
    """None if Ctrl-C comes before the first scan: then a little later again."""
    for wait in (1.5, 3.0, 6.0, 12.0):
        out = tmp_path / str(wait)
        written = interrupted(out, wait)
        if written:
            break
    assert written == {*FILES, "truth.tum"}
    summary = json.loads((out / "summary.json").read_text())
    assert summary["complete"] is False
    assert 0 < summary["scans"] == len(read_tum(out / "trajectory.tum")[0]) < 4501
