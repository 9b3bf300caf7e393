"""A gyro in the laser pipeline: what it is found to be worth, what it is good for; a broken one does not hurt."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from clew.cli.job import sensor_lines
from clew.errors import InputError
from clew.evaluate import absolute_trajectory_error
from clew.geometry import se2, wrap
from clew.io import open_log, write_bag
from clew.motion import GyroHeading, TurnRates
from clew.scan import LaserScan
from clew.sim import GyroModel, LaserModel, OdometryModel, SimulatedLog, simulate_kind
from clew.slam import Slam, SlamConfig
from clew.slam.prediction import MotionPredictor
from clew.slam.sensor import SensorModel
from clew.view import report_of_run

Array = NDArray[np.float64]
GYRO = GyroModel(density=0.001, bias=0.02, delay=0.015)
TOLD = np.diag([1e5, 1e5, 1e6])  # information of a match among many surfaces


@cache
def drive_with_imu() -> SimulatedLog:
    return simulate_kind("hall", 4, duration=35.0, rate=4.0, laser=LaserModel(beams=181), gyro=GYRO,
                         odometry=OdometryModel.bad())


def run(log: SimulatedLog, *, odometry: bool = True, rates: Callable[[Array], Array] | None = lambda r: r) -> Slam:
    slam = Slam(use_odometry=odometry)
    for m in log.measurements():
        if isinstance(m, TurnRates):
            if rates is not None:
                slam.add(TurnRates(m.timestamps, rates(m.rates)))
        elif odometry or isinstance(m, LaserScan):
            slam.add(m)
    return slam


def far(log: SimulatedLog, slam: Slam) -> float:
    """Error of the trajectory, metres, after alignment."""
    run = slam.trajectory
    error = absolute_trajectory_error(log.timestamps, log.T_world_robot, run.timestamps, run.T_world_robot)
    return error.translation.rmse


@cache
def without_gyro(odometry: bool) -> float:
    log = drive_with_imu()
    return far(log, run(log, odometry=odometry, rates=None))


def test_bias_noise_and_clock_are_found() -> None:
    gyro = run(drive_with_imu()).sensor["gyro"]
    assert isinstance(gyro, dict)
    assert abs(gyro["bias_rad_per_second"] - 0.02) < 4 * gyro["bias_deviation_rad_per_second"] + 1e-3
    assert gyro["bias_deviation_rad_per_second"] < 1e-3
    assert gyro["stamped_late_seconds"] == pytest.approx(0.015, abs=0.005)
    assert gyro["noise_rad_per_sqrt_second"] < 0.004
    assert gyro["matches_without_it"] == 0


@pytest.mark.parametrize("odometry", [True, False])
@pytest.mark.parametrize("rates", [lambda r: 0.0 * r, lambda r: -r, np.degrees,
                                   lambda r: np.random.default_rng(1).standard_normal(len(r))],
                         ids=["stuck", "inverted", "degrees", "noise"])  # fmt: skip
def test_a_broken_gyro_does_not_hurt(rates: Callable[[Array], Array], odometry: bool) -> None:
    log = drive_with_imu()
    slam = run(log, odometry=odometry, rates=rates)
    assert far(log, slam) < without_gyro(odometry) + 0.01
    gyro = slam.sensor["gyro"]
    assert isinstance(gyro, dict)
    assert gyro["matches_without_it"] > 10
    (doubt,) = slam.sensor["doubts"]  # type: ignore[misc]
    # neither the terminal nor the report tells what was found of it
    lines = sensor_lines(slam.sensor)  # type: ignore[arg-type]
    assert [line for line in lines if "gyro" in line] == [doubt]
    found = report_of_run(slam, slam.map(), "log")
    assert doubt in [note.text[0].lower() + note.text[1:-1] for note in found.notes if note.level == "check"]
    assert not [name for section in found.sections for name, _ in section.facts if "Gyro" in name]


@pytest.mark.parametrize(("slope", "doubt"), [
    (1.0, None), (-1.0, "upside down"), (57.3, "degrees a second"), (-57.3, "degrees a second"), (-2.5, "broken"),
    (0.0, "broken"), (20.0, "broken"),
])
def test_what_is_wrong_with_a_gyro_is_told_by_its_slope(slope: float, doubt: str | None) -> None:
    sensor = SensorModel(SlamConfig())
    sensor.see(LaserScan(0.0, np.full(181, 2.0), -1.5, 0.017, 0.1, 8.0))
    for turn in turns(60):
        sensor.gyro.add(np.array([0.25, slope * turn, 0.0]), turn, 1.0, 1e-6)
    doubts = sensor.report().get("doubts", [])
    assert isinstance(doubts, list)
    assert len(doubts) == (0 if doubt is None else 1)
    assert doubt is None or doubt in doubts[0]


class Turning:
    """A robot on the spot, with a gyro that is right; odometry may be or may not."""

    def __init__(self, odometry: Callable[[int], float] | None) -> None:
        config = SlamConfig()
        self.sensor = SensorModel(config)
        self.predictor = MotionPredictor(config, self.sensor)
        self.told = odometry
        self.k, self.heading, self.odom = 0, 0.0, np.zeros(3)
        self.predictor.start(0.0, None if odometry is None else self.odom, GyroHeading(0.0, 0.0, 0.0, 0))

    def turn(self, turn: float) -> tuple[Array, float]:
        """A turn between two scans, which the returns then confirm: predicted ``(3,)``, and its deviation."""
        self.k += 1
        self.heading += turn
        now = 0.25 * self.k
        if self.told is not None:
            self.odom = se2.compose(self.odom, np.array([0.0, 0.0, turn + self.told(self.k)]))
        heading = GyroHeading(now, self.heading, turn / 0.25, 0)
        odom = None if self.told is None else self.odom
        found = self.predictor.predict(now, odom, heading)
        step = np.array([0.0, 0.0, turn])
        self.predictor.moved(now, odom, step, TOLD, heading)
        self.predictor.keyframe(odom, step, TOLD, heading)
        return found.increment, float(np.sqrt(found.covariance[2, 2]))


def turns(count: int) -> Iterator[float]:
    rng = np.random.default_rng(2)
    yield from rng.choice([0.0, 0.15, -0.15], count)


def test_wheels_that_slip_in_a_turn_are_not_believed_against_the_gyro() -> None:
    robot = Turning(lambda k: 0.0)
    for turn in turns(60):
        robot.turn(turn)
    robot.told = lambda k: 0.4
    increment, deviation = robot.turn(0.1)
    assert increment[2] == pytest.approx(0.1, abs=0.002)
    assert deviation < 0.004


def test_a_gyro_tells_turns_where_there_is_no_odometry() -> None:
    robot = Turning(None)
    for turn in turns(60):
        robot.turn(turn)
    for turn in (0.3, -0.3, 0.3):  # the last velocity would be wrong by as much each time
        increment, deviation = robot.turn(turn)
        assert increment[2] == pytest.approx(turn, abs=0.01)
        assert deviation < 0.02


def test_turns_within_a_sweep_are_taken_out_by_the_gyro() -> None:
    """A beam without return tells by how much it was turned."""
    laser = LaserModel(300, np.radians(358.8), range_min=0.02, range_max=12.0, sweep=0.1)
    log = simulate_kind("hall", 46, duration=30.0, rate=8.0, laser=laser, gyro=GYRO)
    heading = np.unwrap(log.T_world_robot[:, 2])

    def error(use: bool) -> float:
        slam, errors = Slam(), []
        for m in log.measurements():
            if isinstance(m, TurnRates) and not use:
                continue
            slam.add(m)
            if isinstance(m, LaserScan) and m.timestamp > 15.0:
                assert slam.last_scan is not None
                assert slam.last_scan.bearings is not None
                beam = np.flatnonzero(~np.isfinite(m.ranges))[-1]
                begin, end = np.interp([m.timestamp, m.timestamp + beam * m.time_increment], log.timestamps, heading)
                errors.append(wrap(slam.last_scan.bearings[beam] - m.angles[beam]) - (end - begin))
        return float(np.sqrt(np.mean(np.square(errors))))

    assert error(True) < 0.4 * error(False)


@pytest.mark.parametrize("style", ["mcap", "ros1"])
def test_from_the_simulator_over_a_bag_into_a_map(tmp_path: Path, style: str) -> None:
    pytest.importorskip("rosbags")
    log = simulate_kind("loop", 2, duration=20.0, rate=4.0, laser=LaserModel(beams=181), gyro=GYRO)
    write_bag(tmp_path / "log", log, style)
    slam = Slam()
    for measurement in open_log(tmp_path / "log").measurements():
        slam.add(measurement)
    direct = run(log)
    found, expected = slam.sensor["gyro"], direct.sensor["gyro"]
    assert isinstance(found, dict)
    assert isinstance(expected, dict)
    assert abs(found["turns"] - expected["turns"]) <= 2  # ranges were rounded
    assert found["bias_rad_per_second"] == pytest.approx(expected["bias_rad_per_second"], abs=5e-4)
    assert far(log, slam) < 1.5 * far(log, direct) + 0.02


@pytest.mark.parametrize("readings", [TurnRates(np.array([0.0, 1.0]), np.array([0.0])),
                                      TurnRates(np.array([0.0]), np.array([np.nan]))])
def test_turn_rates_that_are_no_numbers_are_refused(readings: TurnRates) -> None:
    with pytest.raises(InputError, match="turn rates"):
        Slam().add(readings)
