"""IMUs in ROS bags: mounting, choice of the topic, damage, and back again."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from clew.errors import InputError
from clew.io import Log, log_health, open_log, write_bag
from clew.io.log import ReadReport
from clew.io.recorded import RecordedLog, tabulate
from clew.motion import TurnRates
from clew.scan import LaserScan
from clew.sim import GyroModel, LaserModel, simulate_kind

pytest.importorskip("rosbags")
from ros_bags import KINDS, Bag, new_bag


def log_of(gyro: np.ndarray) -> RecordedLog:
    """A scan, and turn rates ``(G, 3)``."""
    scans = tabulate([LaserScan(1.0, np.ones(5), -1.0, 0.5, 0.1, 8.0)], [1])
    return RecordedLog(Path("log"), scans, np.zeros((0, 5)), ReadReport(), gyro=gyro)


def rates_of(log: Log) -> list[float]:
    return [rate for m in log.measurements() if isinstance(m, TurnRates) for rate in m.rates.tolist()]


def with_scans(bag: Bag) -> None:
    for k in range(4):
        bag.odometry(1.0 + k, 0.0, 0.0)
        bag.scan(1.0 + k, [1.0, 2.0])


@pytest.mark.parametrize("kind", KINDS)
def test_rates_come_before_the_scan_that_is_next(tmp_path: Path, kind: str) -> None:
    path, bag = new_bag(tmp_path, kind)
    for k in range(25):
        bag.imu(0.95 + 0.1 * k, (0.0, 0.0, 0.01 * k))
    with_scans(bag)
    bag.close()
    log = open_log(path)
    assert log.has_gyro
    assert log.report.used["gyro"] == 25
    assert not log.report.skipped
    seen = [type(m).__name__ for m in log.measurements()]
    assert seen == 4 * ["Odometry", "TurnRates", "LaserScan"]
    for gyro, scan in zip(list(log.measurements())[1::3], list(log.measurements())[2::3], strict=True):
        assert isinstance(gyro, TurnRates)
        assert scan.timestamp - 1.0 < gyro.timestamp
        assert gyro.timestamps[-1] <= scan.timestamp
    np.testing.assert_allclose(rates_of(log), 0.01 * np.arange(25), atol=1e-12)


def rotated(roll: float, yaw: float, rate: float) -> tuple[float, float, float]:
    """A turn about the vertical in the frame of an IMU that is rolled and then turned on the robot."""
    return 0.0, rate * math.sin(roll), rate * math.cos(roll)


@pytest.mark.parametrize("roll", [0.0, math.pi, math.pi / 2, 0.3, -2.0])
@pytest.mark.parametrize("yaw", [0.0, 1.2])
def test_a_tilted_imu_is_turned_right_by_the_transforms(tmp_path: Path, roll: float, yaw: float) -> None:
    path, bag = new_bag(tmp_path, "mcap")
    bag.transform("base_footprint", "base_link", 0.1, 0.0, 0.4)
    bag.transform("base_link", "imu", 0.2, 0.1, yaw, roll=roll)
    for k in range(4):
        bag.imu(1.0 + 0.1 * k, rotated(roll, yaw, 0.1 * k), force=(0.0, 0.0, 9.81))  # what gravity says is not asked
    with_scans(bag)
    bag.close()
    np.testing.assert_allclose(rates_of(open_log(path)), [0.0, 0.1, 0.2, 0.3], atol=1e-9)


@pytest.mark.parametrize("unit", [9.81, 1.0])
@pytest.mark.parametrize("roll", [0.0, math.pi, 0.3])
def test_without_transforms_gravity_tells_how_it_is_mounted(tmp_path: Path, roll: float, unit: float) -> None:
    path, bag = new_bag(tmp_path, "sqlite3")
    for k in range(9):
        bump = 3.0 if k == 4 else 0.0
        force = (bump, unit * math.sin(roll), unit * math.cos(roll))
        bag.imu(1.0 + 0.1 * k, rotated(roll, 0.0, 0.1 * k), force=force)
    with_scans(bag)
    bag.close()
    np.testing.assert_allclose(rates_of(open_log(path)), 0.1 * np.arange(9), atol=1e-9)


def test_an_imu_of_which_nothing_is_known_lies_flat(tmp_path: Path) -> None:
    path, bag = new_bag(tmp_path, "ros1")
    for k in range(4):
        bag.imu(1.0 + 0.1 * k, (5.0, -5.0, 0.1 * k), force=(0.2, 0.1, -0.1))  # gravity was taken out
    with_scans(bag)
    bag.close()
    np.testing.assert_allclose(rates_of(open_log(path)), [0.0, 0.1, 0.2, 0.3], atol=1e-12)


def test_the_topic_that_holds_turn_rates_is_chosen(tmp_path: Path) -> None:
    path, bag = new_bag(tmp_path, "mcap")
    for k in range(300):
        time = 1.0 + 0.01 * k
        bag.imu(time, (0.0, 0.0, 7.0), topic="/imu")  # stuck
        bag.imu(time, (0.0, 0.0, 0.01 * k), topic="/imu/data", known=False)
        bag.imu(time, (0.0, 0.0, -0.01 * k), topic="/imu/data_raw")
        bag.imu(time, (0.0, 0.0, 0.02 * k), topic="/another")
    with_scans(bag)
    bag.close()
    log = open_log(path)
    np.testing.assert_allclose(rates_of(log), -0.01 * np.arange(300), atol=1e-12)
    assert log.report.skipped == {"topic /imu (its first turn rates do not change)": 300,
                                  "topic /imu/data (tells no turn rates)": 300, "topic /another": 300}
    np.testing.assert_allclose(rates_of(open_log(path, imu_topic="/another")), 0.02 * np.arange(300), atol=1e-12)
    with pytest.raises(InputError, match=r"no topic /none of type sensor_msgs/msg/Imu"):
        open_log(path, imu_topic="/none")
    (tmp_path / "a.clf").write_text("FLASER 1 1 0 0 0 0 0 0 1 h 1\n")
    with pytest.raises(InputError, match="topics are for ROS bags"):
        open_log(tmp_path / "a.clf", imu_topic="/imu")


def test_a_gyro_that_begins_at_rest_is_read(tmp_path: Path) -> None:
    """Many drivers tell nothing below a threshold: a robot that stands has readings that are all the same."""
    path, bag = new_bag(tmp_path, "mcap")
    rates = np.maximum(np.arange(600) - 300, 0) * 0.001
    for k, rate in enumerate(rates.tolist()):
        bag.imu(1.0 + 0.005 * k, (0.0, 0.0, rate))
    with_scans(bag)
    bag.close()
    log = open_log(path)
    np.testing.assert_allclose(rates_of(log), rates, atol=1e-12)
    assert not log.report.skipped


def test_an_imu_that_tells_orientation_alone_is_not_called_broken(tmp_path: Path) -> None:
    path, bag = new_bag(tmp_path, "sqlite3")
    for k in range(30):
        bag.imu(1.0 + 0.1 * k, (0.0, 0.0, 0.0), known=False)
    with_scans(bag)
    bag.close()
    log = open_log(path)
    assert not log.has_gyro
    assert log.report.skipped == {"topic /imu (tells no turn rates)": 30}
    with pytest.raises(InputError, match=r"/imu tells no turn rates; choose another IMU, or none"):
        open_log(path, imu_topic="/imu")


def test_readings_after_the_last_scan_are_not_lost(tmp_path: Path) -> None:
    path, bag = new_bag(tmp_path, "mcap")
    for k in range(60):
        bag.imu(0.95 + 0.1 * k, (0.0, 0.0, 0.01 * k))
    with_scans(bag)
    bag.odometry(5.0, 0.0, 0.0)
    bag.close()
    log = open_log(path)
    np.testing.assert_allclose(rates_of(log), 0.01 * np.arange(60), atol=1e-12)
    write_bag(tmp_path / "again", log, "sqlite3")
    again = open_log(tmp_path / "again")
    assert again.report.used == log.report.used
    np.testing.assert_allclose(rates_of(again), rates_of(log), atol=1e-12)


def test_turn_rates_before_1970_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"has the time -0\.5.* s; bags hold none before 1970"):
        write_bag(tmp_path / "out", log_of(np.array([[-0.5, 0.1, 0.0]])), "mcap")


def test_damaged_readings_are_left_out_and_counted(tmp_path: Path) -> None:
    path, bag = new_bag(tmp_path, "mcap")
    times = [1.0, 1.2, 1.1, 1.1, 1.3, 9e8]
    for k, time in enumerate(times):
        bag.imu(time, (0.0, 0.0, float(k)))
    bag.imu(1.4, (0.0, 0.0, math.nan))
    bag.imu(1.5, (0.0, 0.0, 1.0), known=False)
    with_scans(bag)
    bag.close()
    log = open_log(path)
    assert rates_of(log) == [0.0, 2.0, 1.0, 4.0]
    assert log.report.skipped == {"broken Imu": 1, "Imu without turn rates": 1, "second turn rate of one moment": 1,
                                  "turn rate with a time far from all others": 1}


def test_rates_within_a_sweep_come_before_its_scan_from_simulator_and_bag_alike(tmp_path: Path) -> None:
    laser = LaserModel(beams=21, sweep=0.15)
    simulated = simulate_kind("loop", 1, duration=4.0, laser=laser, gyro=GyroModel(rate=50.0))
    write_bag(tmp_path / "log", simulated, "sqlite3")
    for source in (simulated, open_log(tmp_path / "log")):
        latest = 0.0
        for m in source.measurements():
            if isinstance(m, TurnRates):
                latest = m.timestamps[-1]
            elif isinstance(m, LaserScan) and m.timestamp < 3.5:
                assert m.time_increment * len(m.ranges) == pytest.approx(0.15, rel=0.06)
                assert m.timestamp + 0.13 < latest <= m.timestamp + 0.16


@pytest.mark.parametrize("kind", KINDS)
def test_a_simulated_imu_comes_back_from_a_bag(tmp_path: Path, kind: str) -> None:
    simulated = simulate_kind("loop", 1, duration=4.0, laser=LaserModel(beams=21), gyro=GyroModel(rate=50.0))
    assert simulated.gyro is not None
    path = tmp_path / ("log.bag" if kind == "ros1" else "log")
    write_bag(path, simulated, kind)
    log = open_log(path)
    assert not log.report.skipped
    np.testing.assert_allclose(rates_of(log), simulated.gyro.rates[: log.report.used["gyro"]])
    assert log.report.used["gyro"] == len(simulated.gyro.rates)
    again = log_health(log).gyro
    assert again is not None
    assert again.stream.rate == pytest.approx(50.0, rel=1e-3)
    assert not [problem for problem in log_health(log).problems if "gyro" in problem]


def test_health_tells_a_stuck_a_saturated_and_a_rare_gyro(tmp_path: Path) -> None:
    def problems(rates: list[float], every: float) -> list[str]:
        path = tmp_path / f"{len(list(tmp_path.iterdir()))}"
        bag = Bag(path, "sqlite3")
        for k, rate in enumerate(rates):
            bag.imu(1.0 + every * k, (0.0, 0.0, rate))
        with_scans(bag)
        bag.close()
        return [problem for problem in log_health(open_log(path)).problems if problem.startswith("gyro")]

    noise = 0.01 * np.random.default_rng(1).standard_normal(150)
    assert problems(noise.tolist(), 0.02) == []
    assert "100 % of the readings repeat" in problems([0.0] * 150, 0.02)[0]
    assert problems([0.1], 0.02) == ["gyro: only one reading"]
    clipped = np.clip(noise * 100, -1.0, 1.0)
    assert "57 degrees a second, the end of its scale" in problems(clipped.tolist(), 0.02)[0]
    assert problems(noise[:12].tolist(), 0.25) == ["gyro: only 4 readings a second"]


@pytest.mark.parametrize("bias", [0.0, 1.4, 2.0])
@pytest.mark.parametrize("noise", [0.3, 1.5])
def test_a_coarse_gyro_is_not_at_the_end_of_its_scale(bias: float, noise: float) -> None:
    """Steps of 1/16.4 degrees a second, as of a usual chip; few of them are met where the robot stands."""
    rng = np.random.default_rng(3)
    step = np.radians(1.0 / 16.4)
    standing = bias + noise * rng.standard_normal(4000)
    driving = standing + 600.0 * np.clip(2.0 * np.sin(np.arange(4000) / 150.0), -1.0, 1.0)
    clipped = np.clip(2.0 * driving, -900.0, 899.0)  # the two ends of a scale are not the same
    for levels, readings in ((standing, 0), (driving, 0), (np.append(standing, driving), 0), (clipped, 1500)):
        rates = step * np.round(levels)
        gyro = np.column_stack([np.arange(len(rates)) / 100.0, rates, np.arange(len(rates))])
        health = log_health(log_of(gyro)).gyro
        assert health is not None
        assert health.saturated >= readings
        assert (health.saturated > 0) == (readings > 0)
