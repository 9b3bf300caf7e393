"""What is said of the state of a log, against logs whose faults are planted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from carmen_lines import DATA, flaser, odom, write
from clew.io import LogHealth, log_health, open_log, stream_health
from clew.sim import LaserModel, simulate_kind


def healthy(times: list[float]) -> list[str]:
    """A robot that drives 0.1 m a scan."""
    return [flaser(t, [1.0] * 181, robot=(0.1 * k, 0, 0), laser=(0.1 * k, 0, 0)) for k, t in enumerate(times)]


def health_of(folder: Path, *lines: str) -> LogHealth:
    return log_health(open_log(write(folder, *lines)))


def test_log_without_fault_has_no_problems(tmp_path: Path) -> None:
    health = health_of(tmp_path, *healthy([100 + 0.2 * k for k in range(51)]))
    assert health.problems == ()
    assert health.duration == pytest.approx(10.0)
    assert health.scans.rate == pytest.approx(5.0)
    assert health.odometry is not None
    assert health.odometry.count == health.scans.count == 51
    assert health.distance == pytest.approx(5.0)
    assert health.laser.beams == {181: 51}
    assert np.degrees([health.laser.field_of_view, health.laser.resolution]) == pytest.approx([180.0, 1.0])
    assert health.laser.no_return == health.laser.invalid == 0.0


def test_gaps_are_found_where_they_are_and_do_not_lower_the_rate(tmp_path: Path) -> None:
    times = [100 + 0.2 * k + (7.0 if k > 20 else 0.0) for k in range(51)]
    health = health_of(tmp_path, *healthy(times))
    np.testing.assert_allclose(health.scans.gaps, [[104.0, 7.2]])
    assert health.scans.rate == pytest.approx(5.0, rel=1e-3)
    assert any("7.2 s (4.0 s after the first scan)" in problem for problem in health.problems)


def test_steps_back_of_the_clock_are_those_of_the_file(tmp_path: Path) -> None:
    times = [100 + 0.2 * k for k in range(51)]
    times[30], times[31] = times[31], times[30]
    health = health_of(tmp_path, *healthy(times))
    np.testing.assert_allclose(health.scans.steps_back, [[106.2, 0.2]])
    assert any("laser: the clock steps back once in the file, by at most 0.2 s" in p for p in health.problems)


def test_late_stamps_make_the_way_zigzag(tmp_path: Path) -> None:
    """Every second reading is stamped a second too early."""
    lines = healthy([100 + 0.2 * k for k in range(51)])
    lines[::2] = [odom(100 + 0.2 * k - 1.0, (0.1 * k, 0, 0)) for k in range(0, 51, 2)]
    health = health_of(tmp_path, *lines)
    assert health.distance == pytest.approx(5.0)
    assert health.distance_by_time > 10
    assert any("zigzags" in problem for problem in health.problems)


def test_jumps_of_odometry_are_told_and_not_driven(tmp_path: Path) -> None:
    lines = healthy([100 + 0.2 * k for k in range(51)])
    lines[40:] = [flaser(100 + 0.2 * k, [1.0] * 181, robot=(500 + 0.1 * k, 0, 0)) for k in range(40, 51)]
    health = health_of(tmp_path, *lines)
    np.testing.assert_allclose(health.jumps, [[108.0, 500.1]])
    assert health.distance == pytest.approx(4.9)


def test_beams_that_change_and_beams_without_return(tmp_path: Path) -> None:
    ranges = {180: [1.0] * 90 + [81.83] * 90, 181: [2.0] * 181}
    lines = [flaser(100 + 0.2 * k, ranges[181 if k in (10, 11) else 180]) for k in range(20)]
    health = health_of(tmp_path, *lines, lines[-1], "FLASER 3 1.0")
    assert health.laser.beams == {180: 18, 181: 2}
    assert health.laser.beam_changes == 2
    assert health.laser.no_return == pytest.approx(18 * 90 / (18 * 180 + 2 * 181))
    assert health.laser.longest == 2.0
    assert sum(health.skipped.values()) == 2
    assert "duplicate scan" in health.skipped
    assert any("18 of 180, 2 of 181" in problem for problem in health.problems)


def test_simulated_logs_are_examined_too() -> None:
    """`RecordedLog.of` has to make the tables from the measurements."""
    log = simulate_kind("office", 5, duration=10.0, rate=3.0, laser=LaserModel(beams=181))
    health = log_health(log)
    assert health.scans.count == log.scan_count
    assert health.duration == pytest.approx(log.duration)
    assert health.laser.no_return == pytest.approx(np.mean(np.isinf(log.ranges)))
    steps = np.hypot(*np.diff(log.T_odom_robot[:, :2], axis=0).T)
    assert health.distance == pytest.approx(steps.sum())
    assert health.problems == ()


@pytest.mark.parametrize("count", [0, 1])
def test_streams_too_short_for_a_rate(count: int) -> None:
    stream = stream_health("laser", np.zeros(count))
    assert (stream.count, stream.rate, len(stream.gaps), len(stream.steps_back)) == (count, 0.0, 0, 0)


def test_the_intel_log_is_told_to_be_stamped_late() -> None:
    path = DATA / "lidar" / "intel.clf.bz2"
    if not path.exists():
        pytest.skip(f"needs the real log {path}")
    health = log_health(open_log(path))
    assert len(health.scans.steps_back) == 631
    assert health.distance == pytest.approx(508, abs=2)
    assert health.distance_by_time > 600
