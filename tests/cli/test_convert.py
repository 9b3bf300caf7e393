"""``clew convert``: there and back again gives the same; what makes no sense is refused in one line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from carmen_lines import DATA
from clew.geometry import SE2
from clew.io import (
    log_health,
    open_log,
    read_csv,
    read_graph,
    read_kitti,
    read_ros_map,
    read_tum,
    write_ros_map,
    write_tum,
)
from clew.motion import Odometry
from clew.scan import LaserScan
from clew.sim import write_carmen
from clew.slam.pose_graph import chi2
from cli.commands import Command, drive
from cli.test_bad_input import assert_refused
from cli.test_info import G2O, TORO, planar

SPATIAL = np.array([[0.1, -2.0, 3.0, 0.0, 0.0, 0.0, 1.0], [1.0, 2.0, 3.0, 0.1, 0.2, 0.3, np.sqrt(1 - 0.14)],
                    [5.0, 0.0, -1.0, 0.5, -0.5, 0.5, 0.5]])


def convert(clew_command: Command, *arguments: object) -> dict[str, object]:
    done = clew_command("convert", *arguments, "--json")
    assert (done.code, done.err) == (0, "")
    return json.loads(done.out)


def test_graph_to_toro_and_back_is_the_same_graph(tmp_path: Path, clew_command: Command) -> None:
    (tmp_path / "a.g2o").write_text("".join(line + "\n" for line in G2O.splitlines()
                                            if line.startswith(("VERTEX_SE2", "EDGE_SE2 "))))
    for source, target in (("a.g2o", "b.graph"), ("b.graph", "c.g2o.gz"), ("c.g2o.gz", "d.g2o")):
        assert convert(clew_command, tmp_path / source, tmp_path / target)["notes"] == []
    first, last = (read_graph(tmp_path / name).graph for name in ("a.g2o", "d.g2o"))
    np.testing.assert_array_equal(first.keys(), last.keys())
    np.testing.assert_array_equal(first.values(SE2).array, last.values(SE2).array)
    for a, b in zip(first.blocks(), last.blocks(), strict=True):
        np.testing.assert_array_equal(a.measurement, b.measurement)
        np.testing.assert_array_equal(a.information, b.information)


@pytest.mark.parametrize("name", ["graphs3d/cubicle.g2o", "graphs2d/FR079_P_toro.graph", "graphs2d/intel.g2o"])
def test_real_graphs_keep_their_cost(name: str, tmp_path: Path, clew_command: Command) -> None:
    path = DATA / name
    if not path.exists():
        pytest.skip(f"needs the real graph {path}")
    notes = convert(clew_command, path, tmp_path / "a.graph")["notes"]
    assert bool(notes) == ("cubicle" in name)  # its information is indefinite
    convert(clew_command, tmp_path / "a.graph", tmp_path / "b.g2o")
    assert chi2(read_graph(tmp_path / "b.g2o").graph) == pytest.approx(chi2(read_graph(path).graph), rel=1e-9)


def test_trajectories_go_round(tmp_path: Path, clew_command: Command) -> None:
    stamps = np.array([0.25, 1e9 + 0.123456, 1e9 + 7.0])
    write_tum(tmp_path / "a.tum", stamps, SPATIAL)
    assert convert(clew_command, tmp_path / "a.tum", tmp_path / "b.csv")["notes"] == []
    convert(clew_command, tmp_path / "b.csv", tmp_path / "c.tum")
    assert (tmp_path / "c.tum").read_bytes() == (tmp_path / "a.tum").read_bytes()
    np.testing.assert_allclose(read_csv(tmp_path / "b.csv")[1], SPATIAL, atol=1e-9)
    assert convert(clew_command, tmp_path / "b.csv", tmp_path / "d.kitti")["notes"] == ["lost: times"]
    np.testing.assert_allclose(read_kitti(tmp_path / "d.kitti"), SPATIAL, atol=1e-9)
    assert "made up: times" in str(convert(clew_command, tmp_path / "d.kitti", tmp_path / "e.tum")["notes"])
    counted, poses = read_tum(tmp_path / "e.tum")
    np.testing.assert_array_equal(counted, [0, 1, 2])
    np.testing.assert_allclose(poses, SPATIAL, atol=1e-9)


def test_graph_becomes_a_trajectory_in_the_order_of_ids(tmp_path: Path, clew_command: Command) -> None:
    (tmp_path / "a.g2o").write_text("VERTEX_SE2 5 1 0 0\nVERTEX_SE2 2 7 0 0\n")
    assert "ids stand for the times" in str(convert(clew_command, tmp_path / "a.g2o", tmp_path / "b.tum")["notes"])
    stamps, poses = read_tum(tmp_path / "b.tum")
    np.testing.assert_array_equal(stamps, [2, 5])
    np.testing.assert_array_equal(poses[:, 0], [7, 1])


@pytest.mark.parametrize("way", [
    ["b.log"], ["b.clf.bz2"], ["b.bag"], ["b.db3"], ["b.mcap"], ["b.bag", "c.mcap", "d.log.gz"]], ids=" ".join)
def test_logs_go_round(way: list[str], tmp_path: Path, clew_command: Command) -> None:
    if any(name.endswith(("bag", "db3", "mcap")) for name in way):
        pytest.importorskip("rosbags")
    write_carmen(drive(), tmp_path / "a.log")
    last = tmp_path / "a.log"
    for name in way:
        assert convert(clew_command, last, tmp_path / name)["notes"]
        last = tmp_path / name
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(["a.log", *way])
    same_measurements(tmp_path / "a.log", last)


def same_measurements(first: Path, second: Path) -> None:
    """Both logs yield the same in the order of recording."""
    logs = [list(open_log(path, order="recorded").measurements()) for path in (first, second)]
    assert len(logs[0]) == len(logs[1])
    for a, b in zip(*logs, strict=True):
        assert a.timestamp == pytest.approx(b.timestamp, abs=2e-6)
        if isinstance(a, Odometry):
            assert isinstance(b, Odometry)
            np.testing.assert_allclose(a.T_odom_robot, b.T_odom_robot, atol=1e-9)
        else:
            assert isinstance(a, LaserScan)
            assert isinstance(b, LaserScan)
            np.testing.assert_allclose(a.ranges, b.ranges, rtol=1e-6)
            np.testing.assert_allclose(a.angles, b.angles, atol=1e-6)
            np.testing.assert_allclose(a.T_robot_sensor, b.T_robot_sensor, atol=1e-4)


def test_a_ros_2_bag_may_be_a_folder(tmp_path: Path, clew_command: Command) -> None:
    pytest.importorskip("rosbags")
    write_carmen(drive(), tmp_path / "a.log")
    convert(clew_command, tmp_path / "a.log", tmp_path / "bag", "--to", "sqlite3")
    assert (tmp_path / "bag" / "metadata.yaml").exists()
    same_measurements(tmp_path / "a.log", tmp_path / "bag")
    assert_refused(clew_command("convert", tmp_path / "a.log", tmp_path / "bag", "--to", "sqlite3"))


def test_late_stamps_of_a_real_log_survive(tmp_path: Path, clew_command: Command) -> None:
    """The order of the file is the true one; neither a bag nor a CARMEN log may lose it."""
    path = DATA / "lidar" / "intel.clf.bz2"
    if not path.exists():
        pytest.skip(f"needs the real log {path}")
    pytest.importorskip("rosbags")
    convert(clew_command, path, tmp_path / "a.mcap")
    convert(clew_command, tmp_path / "a.mcap", tmp_path / "b.log")
    before, after = (log_health(open_log(p)) for p in (path, tmp_path / "b.log"))
    assert len(after.scans.steps_back) == len(before.scans.steps_back) == 631
    assert after.distance == pytest.approx(before.distance, abs=1e-6)
    assert after.skipped == {}


def test_maps_go_round(tmp_path: Path, clew_command: Command) -> None:
    cells = np.array([[0.0, 1.0, np.nan, 0.0], [1.0, np.nan, 0.0, 0.0]])
    write_ros_map(tmp_path / "a.yaml", cells, 0.05, np.array([-1.5, 2.0, 0.3]))
    convert(clew_command, tmp_path / "a.yaml", tmp_path / "b.png")
    convert(clew_command, tmp_path / "b.png", tmp_path / "c.yaml")
    assert (tmp_path / "c.pgm").read_bytes() == (tmp_path / "a.pgm").read_bytes()
    first, last = (read_ros_map(tmp_path / name) for name in ("a.yaml", "c.yaml"))
    np.testing.assert_array_equal(first.occupancy, last.occupancy)
    np.testing.assert_array_equal(first.origin, last.origin)
    assert first.resolution == last.resolution
    text = (tmp_path / "a.yaml").read_text().replace("a.pgm", "b.png")
    (tmp_path / "d.yaml").write_text(text)  # ROS lets a map's image be a PNG
    np.testing.assert_array_equal(read_ros_map(tmp_path / "d.yaml").occupancy, cells)


def test_same_input_same_bytes(tmp_path: Path, clew_command: Command) -> None:
    pytest.importorskip("rosbags")
    write_carmen(drive(), tmp_path / "a.log")
    (tmp_path / "a.graph").write_text(TORO)
    pairs = [("a.log", "log.gz"), ("a.log", "bag"), ("a.log", "mcap"), ("a.graph", "g2o.gz")]
    for source, ending in pairs:
        for place in "xy":
            convert(clew_command, tmp_path / source, tmp_path / f"{place}.{ending}")
        assert (tmp_path / f"x.{ending}").read_bytes() == (tmp_path / f"y.{ending}").read_bytes(), ending


@pytest.mark.parametrize(("target", "word"), [
    ("b.g2o", "cannot become g2o"), ("b.xyz", "choose .tum"), ("b", "choose .tum"), ("b.csv.gz", "choose .tum"),
    ("none/b.csv", "does not exist"), ("a.tum", "is the file to read"), ("b.mcap", "cannot become mcap")])
def test_what_makes_no_sense_is_refused(target: str, word: str, tmp_path: Path, clew_command: Command) -> None:
    write_tum(tmp_path / "a.tum", *planar())
    before = (tmp_path / "a.tum").read_bytes()
    done = clew_command("convert", tmp_path / "a.tum", tmp_path / target)
    assert_refused(done)
    assert word in done.err
    assert [p.name for p in tmp_path.iterdir()] == ["a.tum"]
    assert (tmp_path / "a.tum").read_bytes() == before


def test_an_option_that_does_not_fit_is_refused(tmp_path: Path, clew_command: Command) -> None:
    write_tum(tmp_path / "a.tum", *planar())
    assert_refused(clew_command("convert", tmp_path / "a.tum", tmp_path / "b", "--to", "carmen"))
    assert_refused(clew_command("convert", tmp_path / "a.tum", tmp_path / "b", "--to", "nonsense"))
    (tmp_path / "folder").mkdir()
    assert_refused(clew_command("convert", tmp_path / "folder", tmp_path / "b.tum"))
    assert_refused(clew_command("convert", tmp_path / "a.tum", tmp_path / "folder", "--to", "csv"))


def test_text_tells_what_was_done(tmp_path: Path, clew_command: Command) -> None:
    write_tum(tmp_path / "a.tum", *planar())
    done = clew_command("convert", tmp_path / "a.tum", tmp_path / "b.kitti")
    assert done.out.splitlines()[0].endswith("b.kitti (kitti): 5 poses")
    assert done.out.splitlines()[1] == "! lost: times"
    assert clew_command("convert", tmp_path / "a.tum", tmp_path / "b.kitti", "-q").out == ""
