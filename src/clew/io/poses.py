"""Planar and spatial poses as the text formats need them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.geometry import SE2, SE3, so3

Array = NDArray[np.float64]


def to_spatial(poses: Array) -> Array:
    """SE3 storage ``(N, 7)`` of SE2 ``(N, 3)`` or SE3 ``(N, 7)`` poses.

    Raises:
        InputError: the array has another shape or holds something that is no pose.
    """
    poses = np.asarray(poses, dtype=np.float64)
    if poses.ndim != 2 or poses.shape[1] not in (3, 7):
        raise InputError(f"poses of shape {poses.shape}: give (N, 3) for the plane or (N, 7) for space")
    if not np.isfinite(poses).all():
        row = int(np.flatnonzero(~np.isfinite(poses).all(axis=1))[0])
        raise InputError(f"pose {row} is not finite; leave it out")
    if poses.shape[1] == 3:
        return SE3.from_planar(SE2.from_array(poses)).array
    return SE3.from_array(poses).array


def quaternions_of_angles(roll: Array, pitch: Array, yaw: Array) -> Array:
    """Unit quaternions ``(N, 4)`` of ``Rz(yaw) Ry(pitch) Rx(roll)``."""
    sr, cr = np.sin(roll / 2), np.cos(roll / 2)
    sp, cp = np.sin(pitch / 2), np.cos(pitch / 2)
    sy, cy = np.sin(yaw / 2), np.cos(yaw / 2)
    return so3.canonical(np.stack([sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy,
                                   cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy], axis=1))


def angles_of_quaternions(quaternions: Array) -> Array:
    """Roll, pitch and yaw ``(N, 3)`` of unit quaternions: ``R = Rz(yaw) Ry(pitch) Rx(roll)``."""
    x, y, z, w = quaternions.T
    return np.stack([np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
                     np.arcsin(np.clip(2 * (w * y - z * x), -1, 1)),
                     np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))], axis=1)
