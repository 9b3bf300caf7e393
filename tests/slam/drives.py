"""Short simulated drives and what comes of them, made once."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2
from clew.motion import Odometry
from clew.place import Closure
from clew.scan import LaserScan
from clew.sim import LaserModel, OdometryModel, SimulatedLog, drive, loop, simulate, simulate_kind, tour
from clew.slam import Slam

Array = NDArray[np.float64]
LASER = LaserModel(beams=181)


@cache
def round_trip() -> SimulatedLog:
    """Almost twice round a corridor of 44 m: 75 m, closures all along the second round."""
    world = loop(1, length=44.0)
    return simulate(world, drive(tour(world, 1, 75.0), rate=4.0, duration=80.0), LASER, OdometryModel.medium(), 1)


@cache
def outing(kind: str) -> SimulatedLog:
    """Half a minute in a world of a kind."""
    return simulate_kind(kind, 3, duration=30.0, rate=3.0, laser=LASER)


def truth_of(log: SimulatedLog) -> Array:
    """``(N, 3)`` true poses from where the robot stood at the first scan."""
    return se2.between(log.T_world_robot[0], log.T_world_robot)


def mapped(log: SimulatedLog, *, use_odometry: bool = True, refine: bool = False) -> Slam:
    """The estimate of a whole log."""
    slam = Slam(use_odometry=use_odometry)
    for measurement in log.measurements():
        slam.add(measurement)
    if refine:
        slam.refine()
    return slam


def measurements(log: SimulatedLog, first: int, last: int) -> list[LaserScan | Odometry]:
    """Odometry and scan of some moments of a log."""
    return [m for k in range(first, last) for m in (Odometry(float(log.timestamps[k]), log.T_odom_robot[k]),
                                                    log.scan(k))]


def errors(estimate: Array, truth: Array) -> tuple[Array, Array]:
    """Metres and radians ``(N,)``, poses of both in one frame."""
    off = se2.between(truth, estimate)
    return np.hypot(off[:, 0], off[:, 1]), np.abs(off[:, 2])


def closure_error(closure: Closure, slam: Slam, log: SimulatedLog) -> Array:
    """What a closure measured seen from the truth, ``(3,)``."""
    stamps = slam.every_keyframe.timestamps[[closure.target, closure.source]]
    target, source = log.T_world_robot[np.searchsorted(log.timestamps, stamps)]
    return se2.between(se2.between(target, source), closure.T_target_source)
