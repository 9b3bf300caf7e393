"""Bad input: exit code 2, one line that helps, no traceback, nothing left behind."""

from __future__ import annotations

import bz2
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from clew.sim import write_carmen
from cli.commands import Command, Outcome, as_process, drive


def good_log(folder: Path) -> Path:
    write_carmen(drive(), folder / "good.log")
    return folder / "good.log"


def missing(folder: Path) -> Path:
    return folder / "nothing.log"


def empty(folder: Path) -> Path:
    (folder / "empty.log").write_bytes(b"")
    return folder / "empty.log"


def blank(folder: Path) -> Path:
    (folder / "blank.log").write_text("\n\n   \n")
    return folder / "blank.log"


def prose(folder: Path) -> Path:
    (folder / "letter.txt").write_text("Dear reader,\nthis is no log at all.\n" * 20)
    return folder / "letter.txt"


def binary(folder: Path) -> Path:
    (folder / "noise.bin").write_bytes(np.random.default_rng(0).bytes(5000))
    return folder / "noise.bin"


def false_bag(folder: Path) -> Path:
    (folder / "broken.bag").write_bytes(b"#ROSBAG V2.0\n" + bytes(200))
    return folder / "broken.bag"


def truncated(folder: Path) -> Path:
    packed = bz2.compress(b"# nothing but remarks\n" * 5000)
    (folder / "cut.log.bz2").write_bytes(packed[: len(packed) // 2])
    return folder / "cut.log.bz2"


def graph(folder: Path) -> Path:
    (folder / "graph.g2o").write_text("VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n")
    return folder / "graph.g2o"


def no_scan(folder: Path) -> Path:
    lines = [f"ODOM {0.1 * k} 0 0 0 0 0 {k:.6f} host {k:.6f}" for k in range(20)]
    (folder / "wheels.log").write_text("\n".join(lines) + "\n")
    return folder / "wheels.log"


def a_folder(folder: Path) -> Path:
    (folder / "inside").mkdir()
    return folder / "inside"


def astray(folder: Path) -> Path:
    """A robot that sees nothing and, by its odometry, drives hundreds of kilometres."""
    ranges = " ".join(["81.91"] * 181)
    rows = [f"FLASER 181 {ranges} {12000 * k} {12000 * k} 0 {12000 * k} {12000 * k} 0 {3600 * k} host {3600 * k}"
            for k in range(30)]
    (folder / "astray.log").write_text("\n".join(rows) + "\n")
    return folder / "astray.log"


def assert_refused(done: Outcome) -> None:
    assert done.code == 2
    assert done.out == ""
    assert done.err.count("\n") == 1
    assert done.err.startswith("clew: ")
    assert "Traceback" not in done.err


@pytest.mark.parametrize("make", [missing, empty, blank, prose, binary, false_bag, truncated, graph, no_scan, a_folder])
def test_what_is_no_log_is_refused(make: Callable[[Path], Path], tmp_path: Path, clew_command: Command) -> None:
    path = make(tmp_path)
    done = clew_command("run", path, "-o", tmp_path / "out")
    assert_refused(done)
    assert path.name in done.err
    assert not list((tmp_path / "out").glob("*"))


@pytest.mark.skipif(not Path("/dev/zero").is_char_device(), reason="needs a device that never ends")
@pytest.mark.parametrize("command", [("run", "-o", "out"), ("optimize",), ("info",), ("merge", "-o", "out")])
def test_devices_are_refused(command: tuple[str, ...], tmp_path: Path, clew_command: Command,
                             monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    done = clew_command(command[0], "/dev/zero", *command[1:])
    assert_refused(done)
    assert "is a device" in done.err


def test_truncated_log_is_used_as_far_as_it_goes(tmp_path: Path, clew_command: Command) -> None:
    lines = good_log(tmp_path).read_bytes().splitlines(keepends=True)
    first, second = (bz2.compress(b"".join(part)) for part in (lines[:31], lines[31:]))
    (tmp_path / "cut.bz2").write_bytes(first + second[: len(second) // 2])
    assert clew_command("run", tmp_path / "cut.bz2", "-o", tmp_path / "out", "-q").code == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["scans"] == 30
    assert summary["skipped"]


def test_scans_without_odometry_need_the_option(tmp_path: Path, clew_command: Command) -> None:
    """No text log lacks odometry, so the job is given one from memory."""
    from rich.console import Console

    from clew.cli.mapping_job import JobOptions, map_log
    from clew.errors import InputError
    from clew.motion import Odometry

    class Blind:
        report, scan_count, duration = drive().report, drive().scan_count, drive().duration

        def measurements(self) -> object:
            return (m for m in drive().measurements() if not isinstance(m, Odometry))

    console = Console(quiet=True)
    with pytest.raises(InputError, match="--no-odometry") as caught:
        map_log(Blind(), JobOptions(tmp_path, "blind"), console)  # type: ignore[arg-type]  # a log of our own
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())
    result = map_log(Blind(), JobOptions(tmp_path, "blind", odometry=False), console)  # type: ignore[arg-type]  # a log of our own
    assert result.summary["scans"] == drive().scan_count


def test_output_folder_that_is_a_file_is_refused(tmp_path: Path, clew_command: Command) -> None:
    log = good_log(tmp_path)
    for out in (log, log / "below"):
        before = log.read_bytes()
        done = clew_command("run", log, "-o", out)
        assert_refused(done)
        assert log.read_bytes() == before


def test_map_that_does_not_fit_leaves_nothing_half_written(tmp_path: Path, clew_command: Command) -> None:
    done = clew_command("run", astray(tmp_path), "-o", tmp_path / "out", "-q")
    assert_refused(done)
    assert "does not fit into memory" in done.err
    assert not list((tmp_path / "out").glob("*"))


@pytest.mark.parametrize("arguments", [
    ["run", "LOG", "-o", "OUT", "--nonsense"], ["run", "LOG"], ["run", "-o", "OUT"], ["nonsense"], ["--nonsense"],
    ["run", "LOG", "LOG", "-o", "OUT"], ["run", "LOG", "-o", "OUT", "--resolution", "much"],
    ["run", "LOG", "-o", "OUT", "--resolution", "0"], ["run", "LOG", "-o", "OUT", "--resolution", "nan"],
    ["run", "LOG", "-o", "OUT", "--scan-topic", "/scan"], ["demo", "--seconds", "1", "-o", "OUT"],
    ["demo", "--seconds", "nan", "-o", "OUT"], ["demo", "--seed", "-3", "-o", "OUT"], ["evaluate", "LOG"],
    ["evaluate", "nothing.tum", "--truth", "nothing.tum"], ["optimize", "nothing.g2o", "-o", "OUT"],
], ids=" ".join)
def test_wrong_options_are_refused(arguments: list[str], tmp_path: Path, clew_command: Command) -> None:
    places = {"LOG": good_log(tmp_path), "OUT": tmp_path / "out"}
    done = clew_command(*(places.get(a, a) for a in arguments))
    assert_refused(done)
    assert not list((tmp_path / "out").glob("*"))


def test_a_process_ends_the_same_way(tmp_path: Path) -> None:
    for arguments in (["run", prose(tmp_path), "-o", tmp_path / "out"], ["run", "--nonsense"]):
        assert_refused(as_process(*arguments))
