"""``clew run`` on a small log: all files, consistent with each other, the same again."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

import clew
from clew.geometry import SE2, se2
from clew.io import open_log, read_graph, read_ros_map, read_tum
from clew.sim import write_carmen
from clew.slam.pose_graph import chi2
from cli.commands import FILES, Command, as_process, drive

KEYS = {"scans", "keyframes", "closures_accepted", "closures_rejected", "log_seconds", "wall_seconds",
        "realtime_factor", "peak_memory_mb", "chi2", "version", "skipped", "complete",
        "uncertainty_95"}


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a log and what a process made of it."""
    folder = tmp_path_factory.mktemp("run")
    write_carmen(drive(), folder / "robot.log")
    done = as_process("run", folder / "robot.log", "-o", folder / "out", "--json")
    assert done.code == 0, done.err
    assert json.loads(done.out) == json.loads((folder / "out" / "summary.json").read_text())
    assert "Traceback" not in done.err
    return folder


def planar(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Timestamps and poses ``(N, 3)`` of a TUM file."""
    stamps, poses = read_tum(path)
    return stamps, np.column_stack([poses[:, :2], 2 * np.arctan2(poses[:, 5], poses[:, 6])])


def summary_of(folder: Path) -> dict[str, object]:
    return json.loads((folder / "summary.json").read_text())


def test_all_files_are_there_and_no_others(finished: Path) -> None:
    assert {p.name for p in (finished / "out").iterdir()} == set(FILES)
    assert all(p.stat().st_size > 0 for p in (finished / "out").iterdir())
    for picture in ("map.png", "overview.png"):
        assert (finished / "out" / picture).read_bytes().startswith(b"\x89PNG")


def test_trajectory_has_a_pose_for_every_scan_near_the_truth(finished: Path) -> None:
    stamps, poses = planar(finished / "out" / "trajectory.tum")
    log = open_log(finished / "robot.log")
    assert len(stamps) == log.scan_count == summary_of(finished / "out")["scans"]
    np.testing.assert_allclose(stamps, drive().timestamps, atol=1e-6)
    truth = se2.between(drive().T_world_robot[0], drive().T_world_robot)
    assert np.hypot(*(poses - truth)[:, :2].T).max() < 0.1


def test_graph_is_that_of_the_summary(finished: Path) -> None:
    out, summary = finished / "out", summary_of(finished / "out")
    graph = read_graph(out / "graph.g2o").graph
    assert len(graph) == summary["keyframes"]
    assert chi2(graph) == pytest.approx(summary["chi2"], rel=1e-4, abs=1e-6)
    stamps, poses = planar(out / "keyframes.tum")
    assert len(stamps) == summary["keyframes"]
    np.testing.assert_allclose(graph.values(SE2).array, poses, atol=1e-5)


def test_map_is_read_back_and_holds_the_trajectory_in_its_free_space(finished: Path) -> None:
    grid = read_ros_map(finished / "out" / "map.yaml")
    assert grid.resolution == 0.05
    _, poses = planar(finished / "out" / "trajectory.tum")
    columns, rows = np.floor((poses[:, :2] - grid.origin[:2]) / grid.resolution).astype(int).T
    assert np.mean(grid.occupancy[rows, columns] == 0.0) > 0.85  # the laser looks ahead, not at where it starts
    assert not np.any(grid.occupancy[rows, columns] == 1.0)
    assert 50 < np.count_nonzero(grid.occupancy == 1.0) < grid.occupancy.size / 10
    size = summary_of(finished / "out")["map_size_m"]
    np.testing.assert_allclose(size, np.array(grid.occupancy.shape[::-1]) * 0.05, atol=0.01)


def test_summary_says_what_happened(finished: Path) -> None:
    summary = summary_of(finished / "out")
    assert set(summary) >= KEYS
    assert summary["version"] == clew.__version__
    assert summary["complete"] is True
    assert summary["skipped"] == {}
    assert summary["log_seconds"] == pytest.approx(np.ptp(drive().timestamps), abs=0.01)
    assert summary["realtime_factor"] == pytest.approx(summary["log_seconds"] / summary["wall_seconds"], rel=0.02)
    assert 50 < summary["peak_memory_mb"] < 2000
    with (finished / "out" / "closures.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    confirmed = sum(row["verdict"] == "confirmed" for row in rows)
    redundant = sum(row["verdict"] == "redundant" for row in rows)
    assert [summary[f"closures_{kind}"] for kind in ("accepted", "redundant", "rejected")] == [
        confirmed, redundant, len(rows) - confirmed - redundant]


def test_second_run_makes_the_same_bytes(finished: Path, clew_command: Command) -> None:
    assert clew_command("run", finished / "robot.log", "-o", finished / "again", "-q").code == 0
    for name in FILES:
        if name != "summary.json":
            assert (finished / "again" / name).read_bytes() == (finished / "out" / name).read_bytes(), name
    timed = ("wall_seconds", "estimate_seconds", "realtime_factor", "peak_memory_mb")
    first, second = ({k: v for k, v in summary_of(finished / f).items() if k not in timed} for f in ("out", "again"))
    assert first == second


def test_quiet_is_quiet_and_options_count(finished: Path, clew_command: Command) -> None:
    done = clew_command("run", finished / "robot.log", "-o", finished / "raw", "-q", "--no-refine", "--no-odometry",
                        "--resolution", "0.2")
    assert (done.code, done.out, done.err) == (0, "", "")
    summary = summary_of(finished / "raw")
    assert summary["refined"] is False
    assert read_ros_map(finished / "raw" / "map.yaml").resolution == 0.2


def test_a_few_bad_lines_are_left_out_and_counted(finished: Path, clew_command: Command) -> None:
    lines = (finished / "robot.log").read_text().splitlines()
    lines[5] = lines[5][: len(lines[5]) // 2]
    lines[9] = lines[9].replace("0.", "zero", 3)
    lines[20:20] = ["", "# a remark", "FLASER", "FLASER 3 1.0 2.0"]
    (finished / "damaged.log").write_text("\n".join(lines) + "\n")
    assert clew_command("run", finished / "damaged.log", "-o", finished / "damaged", "-q").code == 0
    summary = summary_of(finished / "damaged")
    assert summary["scans"] == drive().scan_count - 2
    assert sum(summary["skipped"].values()) >= 4


def test_ranges_that_are_not_numbers_are_no_returns(finished: Path, clew_command: Command) -> None:
    lines = (finished / "robot.log").read_text().splitlines()
    for at in (3, 10, 11, 30):
        fields = lines[at].split()
        fields[2:100:3] = ["nan"] * len(fields[2:100:3])
        lines[at] = " ".join(fields)
    (finished / "nan.log").write_text("\n".join(lines) + "\n")
    assert clew_command("run", finished / "nan.log", "-o", finished / "nan", "-q").code == 0
    assert summary_of(finished / "nan")["scans"] == drive().scan_count
