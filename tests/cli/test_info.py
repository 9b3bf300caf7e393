"""``clew info``: what is said of each kind of file, and what becomes of files of no kind."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from carmen_lines import DATA
from clew.geometry import se2
from clew.io import FileKind, Relations, file_kind, write_csv, write_kitti, write_relations, write_ros_map, write_tum
from clew.sim import write_carmen
from cli.commands import Command, drive
from cli.test_bad_input import assert_refused, binary, blank, empty, false_bag, missing, prose, truncated

TORO = """VERTEX2 0 0 0 0
VERTEX2 1 1 0 0
VERTEX2 2 2 0 0
EDGE2 0 1 1 0 0 1 0 1 1 0 0
EDGE2 1 2 1 0 0 1 0 1 1 0 0
EDGE2 0 2 2 0 0 1 0 1 1 0 0
"""
G2O = """VERTEX_SE2 0 0 0 0
VERTEX_SE2 1 1 0 0
VERTEX_SE2 9 1 0 0
VERTEX_XY 2 2 1
EDGE_SE2 0 1 1 0 0 1 0 0 1 0 1
EDGE_SE2_XY 1 2 1 1 1 0 1
EDGE_SE2_XY 1 3 1 1 1 0 1
STRANGE 1 2 3
FIX 0
"""


CIRCLES = """# a drive with features
STEP image.0001 0.0 -0.5 0.2 0.0004 0.00001 0.0009 0.0 0.0 0.0001
LANDMARK_C 0.3 -4.0 0.9 0.01 0.001 0.04 7
STEP image.0002 0.0 -0.25 0.0 0.0004 0.00001 0.0009 0.0 0.0 0.0001
LANDMARK_C 0.0 -2.0 0.9 0.01 0.001 0.04 7
LANDMARK_C 1.0 -2.0 0.9 0.01 0.001 0.04 -1
REMARK what is that
"""


def planar(count: int = 5) -> tuple[np.ndarray, np.ndarray]:
    """Times and poses of a robot that drives a metre a second."""
    stamps = np.arange(count) + 1000.0
    return stamps, np.column_stack([np.arange(count), np.zeros((count, 2))]).astype(float)


def one_of_each(folder: Path) -> dict[FileKind, Path]:
    """A small file of each kind of text."""
    stamps, poses = planar()
    write_carmen(drive(), folder / "a")
    (folder / "b").write_text(G2O)
    (folder / "c").write_text(TORO)
    write_tum(folder / "d", stamps, poses)
    write_kitti(folder / "e", poses)
    write_csv(folder / "f", stamps, poses)
    write_relations(folder / "g", Relations(stamps[:1], stamps[1:2], np.array([[1.0, 0, 0, 0, 0, 0, 1]])))
    write_ros_map(folder / "h.yaml", np.array([[0.0, 1.0, np.nan], [0.0, 0.0, 0.0]]), 0.1, np.zeros(2))
    (folder / "i").write_text(CIRCLES)
    kinds = [FileKind.CARMEN, FileKind.G2O, FileKind.TORO, FileKind.TUM, FileKind.KITTI, FileKind.CSV,
             FileKind.RELATIONS, FileKind.ROS_MAP, FileKind.CIRCLES]
    return dict(zip(kinds, [folder / name for name in ("a", "b", "c", "d", "e", "f", "g", "h.yaml", "i")], strict=True))


def test_kinds_are_told_by_content_and_not_by_name(tmp_path: Path) -> None:
    for kind, path in one_of_each(tmp_path).items():
        assert file_kind(path) is kind


def test_each_kind_is_described_for_people_and_for_programs(tmp_path: Path, clew_command: Command) -> None:
    for kind, path in one_of_each(tmp_path).items():
        done = clew_command("info", path)
        assert (done.code, done.err) == (0, ""), kind
        assert kind.value in done.out
        assert all(line == line.rstrip() for line in done.out.splitlines())
        data = json.loads(clew_command("info", path, "--json").out)
        assert data["format"] == kind.name.lower()
        assert "problems" in data
        assert clew_command("info", path, "-q").out == ""


def test_log_is_described_as_it_was_simulated(tmp_path: Path, clew_command: Command) -> None:
    write_carmen(drive(), tmp_path / "log")
    data = json.loads(clew_command("info", tmp_path / "log", "--json").out)
    assert data["scans"]["count"] == drive().scan_count
    assert data["duration_s"] == pytest.approx(drive().duration, abs=1e-3)
    assert data["laser"]["beams"] == {"181": drive().scan_count}
    assert data["problems"] == []
    assert f"{drive().scan_count} scans" in clew_command("info", tmp_path / "log").out


def test_graph_is_described_with_its_faults(tmp_path: Path, clew_command: Command) -> None:
    (tmp_path / "graph").write_text(G2O)
    data = json.loads(clew_command("info", tmp_path / "graph", "--json").out)
    assert (data["poses"], data["landmarks"], data["fixed"], data["dimension"]) == (3, 2, 1, 2)
    assert data["parts"] == [4, 1]  # vertex 9 hangs on nothing
    assert data["edges"] == {"relative poses between neighbours (odometry)": 1, "points seen": 2}
    text = " ".join(data["problems"])
    for word in ("2 parts", "without a value of their own: 1, first 3", "STRANGE"):
        assert word in text


def test_drive_with_features_is_described(tmp_path: Path, clew_command: Command) -> None:
    (tmp_path / "drive").write_text(CIRCLES)
    data = json.loads(clew_command("info", tmp_path / "drive", "--json").out)
    numbers = [data[name] for name in ("poses", "features", "named", "landmarks", "poses_without")]
    assert numbers == [3, 3, 2, 1, 1]
    assert data["distance_m"] == pytest.approx(0.75)
    assert data["problems"] == ["left out: 1 x line of the unknown kind REMARK"]
    assert "at most 4.01 m" in clew_command("info", tmp_path / "drive").out


def test_trajectory_is_measured(tmp_path: Path, clew_command: Command) -> None:
    stamps, poses = planar(6)
    stamps[3] = stamps[2]
    turned = se2.compose(np.array([1.0, 2.0, 0.5]), poses)
    write_tum(tmp_path / "t", stamps, turned)
    data = json.loads(clew_command("info", tmp_path / "t", "--json").out)
    assert data["distance_m"] == pytest.approx(5.0)
    assert (data["poses"], data["duration_s"], data["planar"]) == (6, 5.0, True)
    assert data["problems"] == ["1 pose at a time that another pose has"]


def test_output_folder_is_described_by_its_summary(tmp_path: Path, clew_command: Command) -> None:
    (tmp_path / "summary.json").write_text('{"scans": 1234, "skipped": {"bad line": 3}}')
    done = clew_command("info", tmp_path)
    assert "1,234" in done.out
    assert "bad line 3" in done.out
    (tmp_path / "summary.json").write_text("{broken")
    assert_refused(clew_command("info", tmp_path))


@pytest.mark.parametrize("make", [missing, empty, blank, prose, binary, false_bag, truncated])
def test_what_is_of_no_kind_is_refused_in_one_line(make: object, tmp_path: Path, clew_command: Command) -> None:
    assert callable(make)
    path = make(tmp_path)
    done = clew_command("info", path)
    assert_refused(done)
    assert path.name in done.err


def test_pipes_and_folders_of_no_kind_are_refused(tmp_path: Path, clew_command: Command) -> None:
    os.mkfifo(tmp_path / "pipe")
    kinds = ((tmp_path / "pipe", "is a pipe"), (Path("/dev/null"), "device"), (tmp_path, "a folder that is no"))
    for path, word in kinds:
        done = clew_command("info", path)
        assert_refused(done)
        assert word in done.err


def test_several_files_make_a_list(tmp_path: Path, clew_command: Command) -> None:
    (tmp_path / "a").write_text(G2O)
    (tmp_path / "b").write_text(TORO)
    both = json.loads(clew_command("info", tmp_path / "a", tmp_path / "b", "--json").out)
    assert [data["format"] for data in both] == ["g2o", "toro"]


REAL = {
    "lidar/fr079.clf.bz2": "carmen", "lidar/fr079.reference.tum": "tum", "graphs2d/manhattan.g2o": "g2o",
    "graphs2d/FR079_P_toro.graph": "toro", "graphs3d/cubicle.g2o": "g2o", "bags/csail400_ros2_mcap": "ros2_mcap",
    "bags/csail400_ros1_bz2.bag": "ros1_bag", "bags/csail400_ros2_db3/csail400_ros2_db3.db3": "ros2_sqlite",
    "landmarks/MRCLAM_Dataset6": "mrclam", "landmarks/dlr.circles": "circles",
    "landmarks/victoriaPark-noassoc.g2o.gz": "g2o",
    "multirobot/example_4robots/0.g2o": "g2o", "false_closures/B25b_0.150.g2o": "g2o",
}  # fmt: skip


@pytest.mark.parametrize("name", REAL)
def test_real_files_are_described(name: str, clew_command: Command) -> None:
    path = DATA / name
    if not path.exists():
        pytest.skip(f"needs the real file {path}")
    if "bags" in name:
        pytest.importorskip("rosbags")
    done = clew_command("info", path, "--json")
    assert done.code == 0, done.err
    data = json.loads(done.out)
    assert data["format"] == REAL[name]
    if "cubicle" in name:
        assert "5,021 edges" in " ".join(data["problems"])
    if "manhattan" in name:
        assert "no vertices" in " ".join(data["problems"])
    if "bags" in name:
        assert data["scans"]["count"] == 400
        assert {topic["name"] for topic in data["topics"]} == {"/scan", "/odom"}
