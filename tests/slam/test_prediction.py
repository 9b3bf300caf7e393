"""Which of odometry and the last velocity predicts, and that neither confirms itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2
from clew.sim import LaserModel, OdometryModel, simulate_kind
from clew.slam import SlamConfig
from clew.slam.prediction import MotionPredictor
from clew.slam.sensor import SensorModel
from slam.drives import errors, mapped, truth_of

Array = NDArray[np.float64]

TOLD = np.diag([1e5, 1e5, 1e6])  # information of a match among many surfaces
ACROSS = np.diag([0.0, 1e5, 1e6])  # and of one along a bare street
STEP = np.array([0.2, 0.0, 0.0])
#: Twice as bad as worn wheels that slip.
WORSE = OdometryModel(0.06, 0.04, 0.006, 0.1, 0.04, 0.08, 0.03)


class Drive:
    """A robot that goes straight on, two times a second; odometry with errors of its own."""

    def __init__(self, noise: float, share: float = 1.0) -> None:
        config = SlamConfig()
        self.predictor = MotionPredictor(config, SensorModel(config))
        self._noise, self._share = noise, share
        self._rng = np.random.default_rng(1)
        self._time, self._odom = 0.0, np.zeros(3)
        self.predictor.start(self._time, self._odom)

    def go(self, step: Array, information: Array, *, matched: Array | None = None) -> Array:
        """One step; what the returns say is the truth, or what is given. Returns the prediction ``(3,)``."""
        self._time += 0.5
        told = self._share * step + self._noise * self._rng.standard_normal(3) * [1.0, 1.0, 0.1]
        self._odom = se2.compose(self._odom, told)
        prediction = self.predictor.predict(self._time, self._odom).increment
        self.predictor.moved(self._time, self._odom, step if matched is None else matched, information)
        return prediction


def test_noisy_odometry_predicts_on_though_the_last_velocity_does_better() -> None:
    drive = Drive(noise=0.05)
    for _ in range(40):
        drive.go(STEP, TOLD)
    assert not drive.predictor.trusts_odometry
    assert drive.predictor.follows_odometry
    for _ in range(3):  # the robot has stopped, where only odometry can tell
        assert abs(drive.go(np.zeros(3), ACROSS, matched=STEP)[0]) < 0.15


def test_odometry_that_stands_still_is_left_aside() -> None:
    drive = Drive(noise=0.0, share=0.0)
    for _ in range(40):
        drive.go(STEP, TOLD)
    assert not drive.predictor.follows_odometry
    assert np.allclose(drive.go(STEP, TOLD), STEP, atol=1e-6)


def test_predictions_are_not_compared_where_returns_do_not_tell() -> None:
    drive = Drive(noise=0.02)
    for _ in range(40):
        drive.go(STEP, TOLD)
    assert drive.predictor.trusts_odometry
    for _ in range(60):  # the match is but the last velocity, which so confirms itself
        drive.go(0.0 * STEP, ACROSS, matched=STEP)
    assert drive.predictor.trusts_odometry


def test_a_street_without_marks_is_as_long_as_odometry_has_it() -> None:
    """Nine metres on, the robot passes a bare front; there it once was taken to stand for five metres."""
    laser = LaserModel(beams=181, range_max=25.0)
    log = simulate_kind("campus", 12, duration=30.0, rate=3.0, laser=laser, odometry=WORSE)
    off, _ = errors(mapped(log).trajectory.T_world_robot, truth_of(log))
    assert off.max() < 1.0
