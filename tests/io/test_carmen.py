"""CARMEN logs: every kind of record, order, duplicates, damage."""

from __future__ import annotations

import bz2
import gzip
import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from carmen_lines import DATA, flaser, odom, robotlaser, write
from clew.errors import InputError
from clew.io import Log, open_log
from clew.motion import Odometry
from clew.scan import LaserScan


def scans(log: Log) -> list[LaserScan]:
    return [m for m in log.measurements() if isinstance(m, LaserScan)]


def odometry(log: Log) -> list[Odometry]:
    return [m for m in log.measurements() if isinstance(m, Odometry)]


@pytest.mark.parametrize(("name", "count", "lines", "duration", "offset", "beams", "step"), [
    ("intel", 13631, 26915, 2691.29636, 0.0, 180, 1.0),
    ("fr079", 4934, 8951, 1061.449953, -0.04, 360, 0.5),
    ("mit-csail", 1988, 0, 423.997024, 0.0, 361, 0.5),
])
def test_real_logs(name: str, count: int, lines: int, duration: float, offset: float, beams: int,
                   step: float) -> None:
    path = DATA / "lidar" / f"{name}.clf.bz2"
    if not path.exists():
        pytest.skip(f"needs the real log {path}")
    log = open_log(path)
    measurements = list(log.measurements())
    assert log.scan_count == count == sum(isinstance(m, LaserScan) for m in measurements)
    assert len(measurements) == 2 * count + lines
    assert log.report.used == {"scans": count, "odometry": count + lines}
    assert not log.report.skipped
    assert log.duration == pytest.approx(duration, abs=1e-5)
    times = np.array([m.timestamp for m in measurements])
    assert np.all(np.diff(times) >= 0)
    pairs = [(a, b) for a, b in itertools.pairwise(measurements) if isinstance(b, LaserScan)]
    assert all(isinstance(before, Odometry) and before.timestamp == scan.timestamp for before, scan in pairs)
    seen = [scan for _, scan in pairs]
    ranges = np.array([scan.ranges for scan in seen])
    assert ranges.shape == (count, beams)
    assert np.isinf(ranges).mean() > 0.01
    assert np.max(ranges[np.isfinite(ranges)]) < 80
    sensor = np.array([[*s.T_robot_sensor, s.angle_min, s.angle_increment] for s in seen])
    np.testing.assert_allclose(sensor, [[offset, 0, 0, -math.pi / 2, math.radians(step)]] * count, atol=1e-12)


@pytest.mark.parametrize(("beams", "step"), [(180, 1.0), (181, 1.0), (360, 0.5), (361, 0.5), (90, 2.0)])
def test_flaser_looks_half_a_turn_from_the_right(tmp_path: Path, beams: int, step: float) -> None:
    scan, = scans(open_log(write(tmp_path, flaser(5.0, [1.0] * beams))))
    assert scan.angle_min == pytest.approx(-math.pi / 2)
    assert scan.angle_increment == pytest.approx(math.radians(step))


def test_resolution_of_the_parameters_counts_where_it_explains_the_beams(tmp_path: Path) -> None:
    parameters = ["PARAM laser_front_laser_resolution 0.25 host 0", "PARAM laser_front_laser_fov 100 host 0"]
    records = [flaser(5.0, [1.0] * 401), flaser(6.0, [1.0] * 181)]
    narrow, wide = scans(open_log(write(tmp_path, *parameters, *records)))
    assert math.degrees(narrow.angle_min) == pytest.approx(-50)
    assert math.degrees(narrow.angle_increment) == pytest.approx(0.25)
    assert math.degrees(wide.angle_min) == pytest.approx(-90)
    assert math.degrees(wide.angle_increment) == pytest.approx(1)


@pytest.mark.parametrize("remissions", [(), (7.0, 8.0, 9.0), None])
def test_robotlaser_record(tmp_path: Path, remissions: tuple[float, ...] | None) -> None:
    line = robotlaser(7.25, [1.0, 2.0, 80.0, "nan", 0.0], start=-0.5, view=1.0, resolution=0.25, maximum=50.0,
                      remissions=remissions, laser=(1.0, 2.3, math.pi / 2), robot=(1.0, 2.0, math.pi / 2))
    log = open_log(write(tmp_path, line))
    reading, scan = log.measurements()
    assert isinstance(scan, LaserScan)
    assert isinstance(reading, Odometry)
    assert scan.timestamp == reading.timestamp == 7.25
    np.testing.assert_array_equal(scan.ranges, [1.0, 2.0, np.inf, np.nan, np.nan])
    np.testing.assert_allclose(scan.angles, [-0.5, -0.25, 0.0, 0.25, 0.5])
    assert scan.range_max == 50.0
    np.testing.assert_allclose(scan.T_robot_sensor, [0.3, 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(reading.T_odom_robot, [1.0, 2.0, math.pi / 2])


def test_beams_that_change_within_a_log(tmp_path: Path) -> None:
    log = open_log(write(tmp_path, robotlaser(1.0, [2.0] * 180, view=3.124139), robotlaser(2.0, [3.0] * 181)))
    first, second = scans(log)
    assert len(first.ranges) == 180
    assert len(second.ranges) == 181
    assert first.angle_increment == second.angle_increment == 0.017453
    assert np.all(second.ranges == 3.0)


def test_header_that_contradicts_itself_gives_way_to_the_field_of_view(tmp_path: Path) -> None:
    scan, = scans(open_log(write(tmp_path, robotlaser(1.0, [2.0] * 361, resolution=0.017453))))
    assert math.degrees(scan.angle_increment) == pytest.approx(0.5, abs=1e-4)


def test_time_order_and_odometry_before_its_scan(tmp_path: Path) -> None:
    log = open_log(write(tmp_path, odom(3.0, (3, 0, 0)), flaser(2.0, [1.0] * 180, robot=(2, 0, 0)),
                         odom(1.0, (1, 0, 0)), flaser(4.0, [1.0] * 180, robot=(4, 0, 0)),
                         odom(2.0, (2.5, 0, 0))))
    seen = [(type(m).__name__, m.timestamp) for m in log.measurements()]
    assert seen == [("Odometry", 1.0), ("Odometry", 2.0), ("Odometry", 2.0), ("LaserScan", 2.0),
                    ("Odometry", 3.0), ("Odometry", 4.0), ("LaserScan", 4.0)]
    assert [o.T_odom_robot[0] for o in odometry(log)] == [1, 2.5, 2, 3, 4]


def test_order_of_recording_where_it_is_the_smoother_one(tmp_path: Path) -> None:
    late = [1.0, 2.0, 5.5, 4.0, 5.0, 3.5]  # the robot drives on, the recorder stamps some late
    lines = [flaser(t, [1.0] * 180, robot=(i, 0, 0)) for i, t in enumerate(late)]
    path = write(tmp_path, *lines, odom(5.6, (6, 0, 0)))

    def seen(order: str) -> list[float]:
        return [float(o.T_odom_robot[0]) for o in odometry(open_log(path, order=order))]

    assert seen("time") == [0, 1, 5, 3, 4, 2, 6]
    assert seen("recorded") == seen("auto") == [0, 1, 2, 3, 4, 5, 6]
    log = open_log(path, order="auto")
    assert [s.timestamp for s in scans(log)] == late
    assert log.duration == 4.5
    shuffled = write(tmp_path, *(lines[i] for i in (3, 0, 5, 1, 4, 2)))
    log = open_log(shuffled, order="recorded")
    assert [s.timestamp for s in scans(log)] == [4.0, 1.0, 3.5, 2.0, 5.0, 5.5]
    mixed = [flaser(float(i), [1.0] * 180, robot=(i, 0, 0)) for i in (3, 0, 5, 1, 4, 2)]
    stamped = write(tmp_path, *mixed)
    assert [s.timestamp for s in scans(open_log(stamped, order="auto"))] == [0, 1, 2, 3, 4, 5]
    with pytest.raises(InputError, match="choose one of time, recorded, auto"):
        open_log(path, order="random")


def test_the_intel_log_was_recorded_in_the_true_order() -> None:
    path = DATA / "lidar" / "intel.clf.bz2"
    if not path.exists():
        pytest.skip(f"needs the real log {path}")

    def length(order: str) -> float:
        pairs = itertools.pairwise(open_log(path, order=order).measurements())
        poses = [a.T_odom_robot for a, b in pairs if isinstance(a, Odometry) and isinstance(b, LaserScan)]
        return float(np.sum(np.linalg.norm(np.diff(np.array(poses)[:, :2], axis=0), axis=1)))

    assert length("auto") == pytest.approx(508.35, abs=0.1)
    assert length("time") > 650


def test_duplicates_are_dropped_and_counted(tmp_path: Path) -> None:
    one, other = flaser(2.0, [1.0] * 180), flaser(2.0, [1.5] * 180)
    log = open_log(write(tmp_path, one, odom(2.0), one, other, odom(5.0), odom(5.0), one))
    assert log.scan_count == 2
    assert log.report.skipped == {"duplicate scan": 2, "duplicate odometry": 2}
    assert sorted(o.timestamp for o in odometry(log)) == [2.0, 2.0, 5.0]


def test_a_scan_written_in_both_formats_counts_once(tmp_path: Path) -> None:
    log = open_log(write(tmp_path, flaser(2.0, [1.23] * 180), robotlaser(2.0, [1.234] * 180)))
    scan, = scans(log)
    assert scan.ranges[0] == 1.234


def test_laser_offset_comes_from_the_two_poses(tmp_path: Path) -> None:
    lines = ["PARAM robot_frontlaser_offset 0.3 host 0"]
    same = [flaser(t, [1.0] * 180, laser=(t, 0, 0.1 * t), robot=(t, 0, 0.1 * t)) for t in range(1, 6)]
    ahead = [flaser(t, [1.0] * 180, robot=(t, 0, 0.1 * t), laser=(
        t + 0.2 * math.cos(0.1 * t), 0.2 * math.sin(0.1 * t), 0.1 * t)) for t in range(1, 6)]
    corrected = [flaser(t, [1.0] * 180, robot=(t, 0, 0), laser=(t + 0.1 * t * t, 0.3 * t, 0))
                 for t in range(1, 6)]
    for records, expected in ((same, 0.0), (ahead, 0.2), (corrected, 0.3)):
        log = open_log(write(tmp_path, *lines, *records))
        assert scans(log)[0].T_robot_sensor == pytest.approx([expected, 0, 0], abs=1e-6)
        assert odometry(log)[2].T_odom_robot[0] == 3.0  # the robot's pose, not the corrected one


def test_record_with_one_pose_uses_the_parameter(tmp_path: Path) -> None:
    record = "FLASER 3 1.0 2.0 3.0 5 6 0.5 12.5 host 0.1"
    log = open_log(write(tmp_path, "PARAM robot_frontlaser_offset 0.3 host 0", record))
    assert scans(log)[0].T_robot_sensor == pytest.approx([0.3, 0, 0])
    assert scans(log)[0].timestamp == 12.5
    np.testing.assert_array_equal(odometry(log)[0].T_odom_robot, [5, 6, 0.5])


@pytest.mark.parametrize("sentinel", [81.83, 81.91, 50.0, 8.191, 5.6])
def test_the_value_that_means_no_return_is_found(tmp_path: Path, sentinel: float) -> None:
    rng = np.random.default_rng(3)
    lines = []
    for t in range(20):
        ranges = np.round(rng.uniform(0.5, 0.95 * sentinel, 180), 2)
        ranges[rng.random(180) < 0.1] = sentinel
        lines.append(flaser(float(t + 1), ranges.tolist()))
    log = open_log(write(tmp_path, *lines))
    everything = np.concatenate([s.ranges for s in scans(log)])
    assert 0.05 < np.mean(np.isinf(everything)) < 0.15
    assert np.max(everything[np.isfinite(everything)]) < sentinel
    assert all(s.range_max == sentinel for s in scans(log))


@pytest.mark.parametrize("scale", [1.0, 0.1])
def test_all_codes_of_a_sick_laser_mean_no_return(tmp_path: Path, scale: float) -> None:
    codes = [round(81.83 * scale, 4), round(81.87 * scale, 4), round(81.91 * scale, 4)]
    scan, = scans(open_log(write(tmp_path, flaser(1.0, [1.0, 7.99, *codes, 8.0]))))
    np.testing.assert_array_equal(scan.ranges, [1.0, 7.99, np.inf, np.inf, np.inf, 8.0])


def test_far_walls_are_no_missing_returns(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    lines = [flaser(t + 1.0, np.round(12 + rng.normal(0, 0.02, 180), 2).tolist()) for t in range(50)]
    assert not any(np.isinf(s.ranges).any() for s in scans(open_log(write(tmp_path, *lines))))


def test_damaged_lines_are_counted_not_fatal(tmp_path: Path) -> None:
    good = [flaser(float(t), [1.0] * 180) for t in range(1, 9)]
    bad = [good[0][:300], "ODOM 1 2", "FLASER x", "\x01\x02\x03 4", "RLASER 2 1 1 0 0 0 0 0 0 1 h 1",
           "SYNC a", "FLASER 2 1.0 oops 0 0 0 0 0 0 3.0 h 1", "FLASER 1 1.0 0 0 nan 0 0 0 3.0 h 1"]
    log = open_log(write(tmp_path, *good[:4], *bad, *good[4:], flaser(9.9e8, [1.0] * 180)))
    assert log.scan_count == 8
    assert log.report.skipped == {"broken FLASER": 4, "broken ODOM": 1, "unreadable line": 1, "RLASER": 1,
                                  "SYNC": 1, "scan with a time far from all others": 1}


def test_logger_time_where_the_records_have_none(tmp_path: Path) -> None:
    lines = [f"FLASER 1 1.5 0 0 0 0 0 0 0.0 host {t}" for t in (1.5, 2.5)]
    assert [s.timestamp for s in scans(open_log(write(tmp_path, *lines)))] == [1.5, 2.5]


@pytest.mark.parametrize("pack", [gzip.compress, bz2.compress])
def test_packed_logs_by_content_whole_and_cut_off(tmp_path: Path, pack: object) -> None:
    assert callable(pack)
    rng = np.random.default_rng(1)
    text = "\n".join(flaser(t + 1.0, rng.uniform(1, 9, 60).tolist()) for t in range(900)).encode()
    path = tmp_path / "log.txt"
    path.write_bytes(pack(text[:9000]) + pack(text[9000:]))
    assert open_log(path).scan_count == 900
    path.write_bytes(pack(text, 1)[:-1000])
    log = open_log(path)
    assert 100 < log.scan_count < 900
    assert log.report.skipped["packed file ends early or is damaged: rest of the file"] == 1


@pytest.mark.parametrize(("content", "says"), [
    (b"", "empty"), (b"# nothing\n", "no laser scan"), (odom(1.0).encode(), "no laser scan"),
    (bytes(range(256)) * 20, "binary"), (b"PK\x03\x04 zip", "zip"), (b"BZh9 no", "damaged"),
    (b"hello world, this\n\xff\xfe is (no) log\n\xe4 \xe5" * 9, "cannot be read|no laser scan"),
    (b"VERTEX_SE2 0 0 0 0\n", "pose graph"), (b"\x1f\x8b\x08", "damaged"),
])
def test_files_that_are_no_logs(tmp_path: Path, content: bytes, says: str) -> None:
    path = tmp_path / "a.clf"
    path.write_bytes(content)
    with pytest.raises(InputError, match=says) as error:
        open_log(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_missing_files_and_folders(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        open_log(tmp_path / "none.clf")
    with pytest.raises(InputError, match="folder"):
        open_log(tmp_path)
