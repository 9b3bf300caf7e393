"""Logs whose odometry is made worse: noise, slipping wheels, halts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from clew.geometry import se2
from clew.motion import Odometry, TurnRates
from clew.scan import LaserScan
from clew.sim.odometry import OdometryModel
from clew.sim.world import Array


class Measured(Protocol):
    """Whatever yields scans, odometry and turn rates in the order of time."""

    def measurements(self) -> Iterator[LaserScan | Odometry | TurnRates]: ...


@dataclass(frozen=True)
class Slips:
    """What wheels do now and then.

    Attributes:
        per_metre: how often, on average.
        distance: metres that the wheels turn and the robot does not go, on average.
        turn: deviation of the turn that comes with it, radians.
    """

    per_metre: float = 0.05
    distance: float = 0.15
    turn: float = 0.08


def disturbed(log: Measured, noise: OdometryModel, seed: int, slips: Slips | None = None
              ) -> Iterator[LaserScan | Odometry | TurnRates]:
    """The measurements of a log, its odometry with further errors; same arguments, same stream.

    Args:
        log: recorded or simulated.
        noise: errors that come to those which the odometry has.
        seed: of them.
        slips: and slips, unless None.
    """
    rng = np.random.default_rng(seed)
    before: Array | None = None
    pose = np.zeros(3)
    for measurement in log.measurements():
        if not isinstance(measurement, Odometry):
            yield measurement
            continue
        now = measurement.T_odom_robot
        if before is None:
            pose = now
        else:
            step = noise.perturb(se2.between(before, now)[None], rng)[0]
            way = float(np.hypot(step[0], step[1]))
            if slips is not None and rng.random() < slips.per_metre * way:
                slip = np.array([rng.exponential(slips.distance), 0.0, slips.turn * rng.standard_normal()])
                step = se2.compose(step, slip)
            pose = se2.compose(pose, step)
        before = now
        yield Odometry(measurement.timestamp, pose)
