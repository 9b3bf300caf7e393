"""Increments of an odometry that has integrated the wheels itself."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.errors import InputError
from clew.geometry import se2
from clew.motion.noise import OdometryNoise
from clew.motion.step import MotionStep

Array = NDArray[np.float64]


def increment_motion(T_odom_robot: ArrayLike, noise: OdometryNoise | None = None) -> MotionStep:
    """Motions from each pose of an odometry to the next.

    Args:
        T_odom_robot: ``(N + 1, 3)`` poses that the odometry tells, in its own frame.
        noise: defaults to `OdometryNoise`.

    Returns:
        ``N`` motions; the control of their Jacobian is the increment ``(x, y, theta)`` in the frame of the pose before.

    Raises:
        InputError: fewer than two poses, or numbers that are not finite.
    """
    poses = np.asarray(T_odom_robot, np.float64)
    if poses.ndim != 2 or poses.shape[1] != 3 or len(poses) < 2:
        raise InputError(f"increment_motion: at least two poses (N, 3) are needed, got shape {poses.shape}")
    if not np.isfinite(poses).all():
        row = int(np.argmin(np.isfinite(poses).all(axis=1)))
        raise InputError(f"increment_motion: pose {row} is not finite; leave it out")
    increment = se2.between(poses[:-1], poses[1:])
    by_control = np.zeros((len(increment), 3, 3))
    cos, sin = np.cos(increment[:, 2]), np.sin(increment[:, 2])
    by_control[:, 0, 0] = by_control[:, 1, 1] = cos
    by_control[:, 0, 1], by_control[:, 1, 0] = sin, -sin
    by_control[:, 2, 2] = 1.0
    return MotionStep(increment, by_control, (noise or OdometryNoise()).covariance(increment))
