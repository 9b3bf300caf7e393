"""``--live``: how it is asked for, what is printed where, and how it ends."""

from __future__ import annotations

import http.client
import json
import re
import signal
import subprocess
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from rich.console import Console

from clew.cli.mapping_job import JobOptions, map_log
from clew.sim import write_carmen
from clew.view.live import BrowserViewer
from cli.commands import PROGRAM, Command, drive, environment
from cli.test_bad_input import assert_refused
from cli.test_interrupt import Stopped

ADDRESS = re.compile(r"live view: (http://127\.0\.0\.1:\d+/[\w-]{32,}/)\n")


@pytest.fixture
def log(tmp_path: Path) -> Path:
    write_carmen(drive(), tmp_path / "robot.log")
    return tmp_path / "robot.log"


@pytest.mark.parametrize("asked", [["--live"], ["--live", "browser"], ["--live=browser"]], ids=" ".join)
def test_address_goes_to_standard_error_and_the_summary_to_standard_output(
    asked: list[str], log: Path, tmp_path: Path, clew_command: Command
) -> None:
    done = clew_command("run", log, *asked, "--no-open", "-o", tmp_path / "out", "--json")
    assert done.code == 0
    assert json.loads(done.out)["scans"] == drive().scan_count
    address = ADDRESS.search(done.err)
    assert address
    with pytest.raises(OSError, match="refused"):  # the server ends with the run
        http.client.HTTPConnection("127.0.0.1", urlsplit(address[1]).port or 0, timeout=2).connect()


def test_files_are_the_same_with_and_without(log: Path, tmp_path: Path, clew_command: Command) -> None:
    for name, more in (("plain", []), ("shown", ["--live", "--no-open"])):
        assert clew_command("run", log, "-o", tmp_path / name, "-q", *more).code == 0
    for name in ("trajectory.tum", "graph.g2o", "map.pgm", "report.html"):
        assert (tmp_path / "plain" / name).read_bytes() == (tmp_path / "shown" / name).read_bytes()


@pytest.mark.parametrize("asked", [["--live=nonsense"], ["--live", "--live-host", "203.0.113.1"],
                                   ["--live", "--live-port", "70000"], ["--live", "none/x.rrd"]], ids=" ".join)
def test_what_cannot_be_shown_is_refused(asked: list[str], log: Path, tmp_path: Path, clew_command: Command) -> None:
    if asked[-1].endswith(".rrd"):
        pytest.importorskip("rerun")
    done = clew_command("run", log, *asked, "--no-open", "-o", tmp_path / "out")
    assert_refused(done)
    assert not list((tmp_path / "out").glob("*"))


def test_recording_for_rerun(log: Path, tmp_path: Path, clew_command: Command) -> None:
    pytest.importorskip("rerun")
    done = clew_command("run", log, "-o", tmp_path / "out", "-q", "--live", tmp_path / "run.rrd")
    assert (done.code, done.out) == (0, "")
    assert (tmp_path / "run.rrd").stat().st_size > 5000


def test_page_that_is_kept_is_served_until_interrupt(log: Path, tmp_path: Path) -> None:
    command = [*PROGRAM, "run", str(log), "-o", str(tmp_path / "out"), "--live", "--live-keep"]
    blind = {**environment(), "DISPLAY": "", "WAYLAND_DISPLAY": ""}
    with subprocess.Popen(command, env=blind, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stderr is not None
            address = ADDRESS.fullmatch(process.stderr.readline())
            assert address
            while "stays open" not in process.stderr.readline():
                assert process.poll() is None
            url = urlsplit(address[1])
            connection = http.client.HTTPConnection("127.0.0.1", url.port or 0, timeout=10)
            connection.request("GET", url.path + "events")
            text = connection.getresponse().read().decode()
            connection.close()
            assert text.startswith("event: last\n")
            assert '"stage":"finished"' in text
            process.send_signal(signal.SIGINT)
            out, _ = process.communicate(timeout=20)
        finally:
            process.kill()
    assert process.returncode == 0
    assert out == ""


def test_run_that_is_stopped_says_so_on_the_page(tmp_path: Path) -> None:
    with BrowserViewer() as viewer:
        map_log(Stopped(20), JobOptions(tmp_path, "stopped"), Console(quiet=True), viewer=viewer)
        frame = viewer.feed.newest()
    assert (frame.stage, frame.last, frame.scans) == ("interrupted", True, 20)
    assert viewer.feed.newest().stage == "interrupted"
