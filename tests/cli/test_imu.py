"""Bags with an IMU on the command line."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from clew.io import write_bag
from clew.motion import Odometry, TurnRates
from clew.sim import GyroModel, LaserModel, SimulatedLog, simulate_kind
from cli.commands import Command

pytest.importorskip("rosbags")
from ros_bags import new_bag


class WithoutOdometry:
    """A log whose robot has no wheel encoders; of the readings of its gyro, one in so many."""

    def __init__(self, log: SimulatedLog, every: int = 1) -> None:
        self.every = every
        self.path, self.report, self.scan_count, self.duration = log.path, log.report, log.scan_count, log.duration
        self.has_odometry, self.has_gyro = False, True
        self._log = log

    def measurements(self) -> Iterator[object]:
        for m in self._log.measurements():
            if isinstance(m, TurnRates):
                m = TurnRates(m.timestamps[:: self.every], m.rates[:: self.every])
            if not isinstance(m, Odometry):
                yield m


@pytest.fixture(scope="module")
def log() -> SimulatedLog:
    return simulate_kind("hall", 3, duration=25.0, rate=3.0, laser=LaserModel(beams=181),
                         gyro=GyroModel(bias=-0.01, density=0.001))


def test_a_bag_with_an_imu_is_mapped_and_the_gyro_is_told_of(
    log: SimulatedLog, tmp_path: Path, clew_command: Command
) -> None:
    write_bag(tmp_path / "log.mcap", log, "mcap")
    done = clew_command("run", tmp_path / "log.mcap", "-o", tmp_path / "out", "--json")
    assert done.code == 0, done.err
    gyro = json.loads(done.out)["sensor"]["gyro"]
    assert gyro["bias_rad_per_second"] == pytest.approx(-0.01, abs=0.002)
    assert "gyro: bias -0.5" in done.err
    done = clew_command("run", tmp_path / "log.mcap", "-o", tmp_path / "without", "--json", "--no-imu")
    assert "gyro" not in json.loads(done.out)["sensor"]
    done = clew_command("info", tmp_path / "log.mcap")
    assert "gyro" in done.out
    assert "100 a second" in done.out
    assert "/imu" in done.out
    done = clew_command("info", tmp_path / "log.mcap", "--json")
    assert json.loads(done.out)["gyro"]["rate_hz"] == pytest.approx(100.0)
    done = clew_command("convert", tmp_path / "log.mcap", tmp_path / "log.clf")
    assert "turn rates of the gyro" in done.out


def test_a_bag_without_odometry_is_mapped_by_scans_and_gyro(
    log: SimulatedLog, tmp_path: Path, clew_command: Command
) -> None:
    write_bag(tmp_path / "log.bag", WithoutOdometry(log), "ros1")
    done = clew_command("run", tmp_path / "log.bag", "-o", tmp_path / "out", "--json")
    assert done.code == 0, done.err
    assert "no odometry: motion is estimated from scans and gyro" in done.err
    assert json.loads(done.out)["sensor"]["gyro"]["matches_without_it"] == 0
    done = clew_command("run", tmp_path / "log.bag", "-o", tmp_path / "out", "--no-imu")
    assert done.code == 2
    assert "but no odometry" in done.err
    assert "the map is made from scans and gyro" in clew_command("info", tmp_path / "log.bag").out
    done = clew_command("run", tmp_path / "log.bag", "-o", tmp_path / "out", "--imu-topic", "/none")
    assert done.code == 2
    assert "has no topic /none of type sensor_msgs/msg/Imu" in done.err


def test_a_gyro_that_cannot_stand_in_for_odometry_is_named(
    log: SimulatedLog, tmp_path: Path, clew_command: Command
) -> None:
    write_bag(tmp_path / "log.bag", WithoutOdometry(log, every=50), "ros1")
    done = clew_command("run", tmp_path / "log.bag", "-o", tmp_path / "out")
    assert done.code == 2
    assert "but no odometry (gyro: only 3 readings a second): record odometry too" in " ".join(done.err.split())
    assert "map with --no-odometry, from the scans alone" in " ".join(
        clew_command("info", tmp_path / "log.bag").out.split())
    done = clew_command("run", tmp_path / "log.bag", "-o", tmp_path / "out", "--no-imu")
    assert "(its gyro is left out by --no-imu)" in " ".join(done.err.split())
    path, bag = new_bag(tmp_path, "mcap")
    for k in range(30):
        bag.imu(1.0 + 0.1 * k, (0.0, 0.0, 0.0), known=False)
        bag.scan(1.0 + 0.1 * k, [1.0, 2.0])
    bag.close()
    done = clew_command("run", path, "-o", tmp_path / "out")
    assert done.code == 2
    assert "(left out: 30 messages of topic /imu (tells no turn rates))" in " ".join(done.err.split())
