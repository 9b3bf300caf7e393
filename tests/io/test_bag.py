"""ROS bags: real ones, and small ones written here with the `rosbags` library."""

from __future__ import annotations

import importlib.util
import math
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from carmen_lines import DATA
from clew.errors import ClewError, InputError, MissingDependencyError
from clew.io import open_log
from clew.motion import Odometry
from clew.scan import LaserScan

pytest.importorskip("rosbags")
from ros_bags import KINDS, new_bag

BAGS = ["csail400_ros1_bz2.bag", "csail400_ros1_none.bag", "csail400_ros2_db3", "csail400_ros2_mcap",
        "csail400_ros2_db3/csail400_ros2_db3.db3", "csail400_ros2_mcap/csail400_ros2_mcap.mcap"]


@pytest.mark.parametrize("name", BAGS)
def test_real_bags_hold_the_log_they_were_made_from(name: str) -> None:
    path, log_path = DATA / "bags" / name, DATA / "lidar" / "mit-csail.clf.bz2"
    if not path.exists() or not log_path.exists():
        pytest.skip(f"needs the real bag {path} and log {log_path}")
    bag = open_log(path)
    assert bag.scan_count == 400
    assert bag.has_odometry
    assert not bag.report.skipped
    for read, original in zip(bag.measurements(), open_log(log_path).measurements(), strict=False):
        assert read.timestamp == pytest.approx(original.timestamp, abs=1e-6)
        if isinstance(read, Odometry):
            assert isinstance(original, Odometry)
            np.testing.assert_allclose(read.T_odom_robot, original.T_odom_robot, atol=1e-6)
        else:
            assert isinstance(original, LaserScan)
            np.testing.assert_allclose(read.ranges, original.ranges, atol=1e-5)
            np.testing.assert_allclose(read.angles, original.angles, atol=1e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_order_ranges_and_the_place_of_the_laser(tmp_path: Path, kind: str) -> None:
    path, bag = new_bag(tmp_path, kind)
    bag.transform("base_footprint", "base_link", 0.0, 0.0, math.pi / 2)
    bag.transform("base_link", "laser", 0.3, 0.1, -math.pi / 4)
    bag.odometry(1.0, 1.0, 0.25)
    bag.scan(3.0, [1.0, 0.05, 9.0, math.inf, math.nan], received=3.5)
    bag.scan(2.0, [1.0, 2.0, 8.0, 0.0, -1.0], received=3.6)
    bag.scan(2.0, [1.0, 2.0, 8.0, 0.0, -1.0], received=3.7)
    bag.odometry(2.0, 2.0, -0.5)
    bag.scan(0.0, [1.0], received=4.0)
    bag.close()
    log = open_log(path)
    measurements = list(log.measurements())
    assert [(type(m).__name__, m.timestamp) for m in measurements] == [
        ("Odometry", 1.0), ("Odometry", 2.0), ("LaserScan", 2.0), ("LaserScan", 3.0), ("LaserScan", 4.0)]
    scans = [m for m in measurements if isinstance(m, LaserScan)]
    np.testing.assert_array_equal(scans[0].ranges, [1, 2, np.inf, np.nan, np.nan])
    np.testing.assert_array_equal(scans[1].ranges, [1, np.nan, np.inf, np.inf, np.nan])
    assert (scans[0].angle_min, scans[0].angle_increment) == (-1.0, 0.5)
    assert scans[0].range_min == pytest.approx(0.1)
    assert scans[0].range_max == 8.0
    np.testing.assert_allclose(scans[0].T_robot_sensor, [-0.1, 0.3, math.pi / 4], atol=1e-12)
    assert isinstance(measurements[1], Odometry)
    np.testing.assert_allclose(measurements[1].T_odom_robot, [2.0, 0.0, -0.5], atol=1e-12)
    assert log.report.skipped == {"duplicate scan": 1}


def test_a_laser_upside_down_sweeps_the_other_way(tmp_path: Path) -> None:
    path, bag = new_bag(tmp_path, "sqlite3")
    bag.transform("base_link", "laser", 0.2, 0.0, 0.5, roll=math.pi, topic="/tf")
    bag.scan(1.0, [1.0, 2.0])
    bag.close()
    log = open_log(path)
    scan, = log.measurements()
    assert isinstance(scan, LaserScan)
    assert not log.has_odometry
    assert (scan.angle_min, scan.angle_increment) == (1.0, -0.5)
    np.testing.assert_allclose(scan.T_robot_sensor, [0.2, 0.0, 0.5], atol=1e-12)


@pytest.mark.parametrize(("stated", "believed"), [(0.0, 0.0), (0.04, 0.04), (0.1, 0.0), (math.nan, 0.0), (-0.01, 0.0)])
def test_the_time_between_beams_is_believed_where_a_sweep_ends_before_the_next(
    tmp_path: Path, stated: float, believed: float
) -> None:
    path, bag = new_bag(tmp_path, "mcap")
    for k in range(4):
        bag.scan(1.0 + 0.1 * k, [1.0, 2.0], time_increment=stated)
    bag.close()
    for scan in open_log(path).measurements():
        assert isinstance(scan, LaserScan)
        assert scan.time_increment == pytest.approx(believed, abs=1e-6)


def test_robot_and_laser_on_two_branches_of_the_tree(tmp_path: Path) -> None:
    path, bag = new_bag(tmp_path, "mcap")
    bag.transform("base_link", "base_footprint", 1.0, 0.0, math.pi / 2)
    bag.transform("base_link", "laser", 1.0, 0.5, 0.0)
    bag.odometry(1.0, 0.0, 0.0)
    bag.scan(1.0, [1.0, 2.0])
    bag.close()
    _, scan = open_log(path).measurements()
    assert isinstance(scan, LaserScan)
    np.testing.assert_allclose(scan.T_robot_sensor, [0.5, 0.0, -math.pi / 2], atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_topics(tmp_path: Path, kind: str) -> None:
    path, bag = new_bag(tmp_path, kind)
    bag.scan(1.0, [1.0, 2.0], topic="/back")
    bag.scan(1.0, [3.0, 4.0])
    bag.odometry(1.0, 0.0, 0.0, topic="/wheels")
    bag.close()
    log = open_log(path)
    assert log.has_odometry
    assert [m.ranges[0] for m in log.measurements() if isinstance(m, LaserScan)] == [3.0]
    assert log.report.skipped == {"topic /back": 1}
    log = open_log(path, scan_topic="/back", odometry_topic="/wheels")
    assert [m.ranges[0] for m in log.measurements() if isinstance(m, LaserScan)] == [1.0]
    with pytest.raises(InputError, match=r"no topic /none .* it has: /back \(sensor_msgs/msg/LaserScan\), "):
        open_log(path, scan_topic="/none")
    if kind != "ros1":
        stored = next(p for p in path.iterdir() if p.suffix != ".yaml")
        shutil.copy(stored, tmp_path / "renamed")
        assert open_log(tmp_path / "renamed").scan_count == 1


def test_a_bag_without_scans(tmp_path: Path) -> None:
    path, bag = new_bag(tmp_path, "mcap")
    bag.odometry(1.0, 0.0, 0.0)
    bag.close()
    with pytest.raises(InputError, match=r"LaserScan; it has: /odom"):
        open_log(path)


def test_topics_are_for_bags(tmp_path: Path) -> None:
    (tmp_path / "a.clf").write_text("FLASER 1 1 0 0 0 0 0 0 1 h 1\n")
    with pytest.raises(InputError, match="topics"):
        open_log(tmp_path / "a.clf", scan_topic="/scan")


@pytest.mark.parametrize("kind", KINDS)
def test_damaged_bags_give_an_answer_or_an_error(tmp_path: Path, kind: str) -> None:
    path, bag = new_bag(tmp_path, kind)
    for time in range(1, 20):
        bag.odometry(float(time), 0.1 * time, 0.0)
        bag.scan(float(time), [1.0] * 20)
    bag.close()
    file = path if kind == "ros1" else next(p for p in path.iterdir() if p.suffix != ".yaml")
    whole, rng = file.read_bytes(), np.random.default_rng(7)
    answers = 0
    errors: list[str] = []
    for trial in range(60):
        data = bytearray(whole)
        for _ in range(int(rng.integers(1, 20))):
            data[int(rng.integers(len(data)))] = int(rng.integers(256))
        file.write_bytes(data[: int(rng.integers(20, len(data)))] if trial % 3 == 0 else data)
        try:
            answers += 1 if list(open_log(file).measurements()) else 0
        except ClewError as error:
            errors.append(str(error))
    assert answers > 5
    assert errors
    assert not any("\n" in error for error in errors)


def test_missing_and_incompatible_library_are_told_apart(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, bag = new_bag(tmp_path, "ros1")
    bag.scan(1.0, [1.0])
    bag.close()
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "rosbags.highlevel", None)
        with pytest.raises(MissingDependencyError, match=r"does not fit .* pip install 'clew\[bags\]'"):
            open_log(path)
    with monkeypatch.context() as patch:
        patch.setattr(importlib.util, "find_spec", lambda name: None)
        with pytest.raises(MissingDependencyError, match=r"missing; .* pip install 'clew\[bags\]'"):
            open_log(path)
    assert open_log(path).scan_count == 1
