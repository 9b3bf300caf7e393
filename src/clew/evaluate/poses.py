"""Trajectories as arrays: checks, a common kind of pose, poses at given times."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.geometry import ManifoldFunctions, se2, se3

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: A spatial pose that is off the plane by less than this (metres, quaternion components) is a planar one.
_PLANAR = 1e-9


def as_trajectory(timestamps: Array, poses: Array, what: str) -> tuple[Array, Array]:
    """Timestamps and poses, checked and in the order of time.

    Of several poses with the same timestamp the first is kept.

    Args:
        timestamps: ``(N,)`` seconds.
        poses: ``(N, 3)`` SE2 or ``(N, 7)`` SE3 storage.
        what: name for error messages.

    Raises:
        InputError: shapes do not fit, a value is not finite, or there is no pose.
    """
    timestamps, poses = np.asarray(timestamps, dtype=np.float64), np.asarray(poses, dtype=np.float64)
    check_poses(poses, what)
    if timestamps.shape != poses.shape[:1]:
        raise InputError(f"{what}: {len(poses)} poses with timestamps of shape {timestamps.shape}: "
                         "give one a pose")
    if len(timestamps) == 0:
        raise InputError(f"{what}: there is no pose in it")
    if not np.isfinite(timestamps).all():
        index = int(np.flatnonzero(~np.isfinite(timestamps))[0])
        raise InputError(f"{what}: timestamp {index} is not finite")
    unique, first = np.unique(timestamps, return_index=True)
    return unique, poses[first]


def check_poses(poses: Array, what: str) -> None:
    """Refuse an array that is not ``(N, 3)`` or ``(N, 7)`` finite numbers.

    Raises:
        InputError: it is not.
    """
    if poses.ndim != 2 or poses.shape[1] not in (3, 7):
        raise InputError(f"{what}: poses of shape {poses.shape}: give (N, 3) for the plane, (N, 7) for space")
    if not np.isfinite(poses).all():
        index = int(np.flatnonzero(~np.isfinite(poses).all(axis=1))[0])
        raise InputError(f"{what}: pose {index} is not finite")


def functions_of(poses: Array) -> ManifoldFunctions:
    """The functions of the group that the storage ``(..., 3)`` or ``(..., 7)`` belongs to."""
    return se2 if poses.shape[-1] == 3 else se3


def in_common(a: Array, b: Array) -> tuple[Array, Array]:
    """Both sets of poses in SE2 storage if all of them lie in the plane, otherwise both in SE3 storage.

    Files hold planar trajectories as spatial poses; errors and alignments of these are taken in the plane.
    """
    if _is_planar(a) and _is_planar(b):
        return _to_plane(a), _to_plane(b)
    return _to_space(a), _to_space(b)


def _is_planar(poses: Array) -> bool:
    return poses.shape[1] == 3 or bool((np.abs(poses[:, 2:5]) < _PLANAR).all())


def _to_plane(poses: Array) -> Array:
    if poses.shape[1] == 3:
        return poses
    return se2.canonical(np.column_stack([poses[:, :2], 2 * np.arctan2(poses[:, 5], poses[:, 6])]))


def _to_space(poses: Array) -> Array:
    if poses.shape[1] == 7:
        return poses
    zero = np.zeros((len(poses), 3))
    half = poses[:, 2] / 2
    return se3.canonical(np.column_stack([poses[:, :2], zero, np.sin(half), np.cos(half)]))


def translations(poses: Array) -> Array:
    """``(N, 2)`` or ``(N, 3)`` positions, metres."""
    return poses[:, :2] if poses.shape[1] == 3 else poses[:, :3]


def rotation_angles(poses: Array) -> Array:
    """``(N,)`` size of each rotation, radians in [0, pi]."""
    if poses.shape[1] == 3:
        return np.asarray(np.abs(poses[:, 2]))
    return 2.0 * np.asarray(np.arctan2(np.linalg.norm(poses[:, 3:6], axis=1), np.abs(poses[:, 6])))


def travelled(poses: Array) -> Array:
    """``(N,)`` metres from the first pose along the trajectory."""
    steps = np.linalg.norm(np.diff(translations(poses), axis=0), axis=1)
    return np.concatenate([np.zeros(1), np.cumsum(steps)])


def nearest_in_time(timestamps: Array, at: Array) -> Indices:
    """Index of the nearest of the sorted `timestamps` for each time of `at`; of two as near the earlier."""
    right = np.clip(np.searchsorted(timestamps, at), 0, len(timestamps) - 1)
    left = np.maximum(right - 1, 0)
    return np.where(np.abs(at - timestamps[left]) <= np.abs(timestamps[right] - at), left, right)


def poses_at(timestamps: Array, poses: Array, at: Array,
             tolerance: float) -> tuple[Array, NDArray[np.bool_]]:
    """Poses at given times, and for which of these there is one.

    There is one where a pose of the trajectory is no further away in time than the tolerance. It is
    interpolated between its neighbours in time with constant velocity; at either end of the trajectory it is
    the nearest pose.

    Args:
        timestamps: ``(N,)`` seconds, increasing.
        poses: ``(N, 3)`` or ``(N, 7)``.
        at: ``(M,)`` seconds.
        tolerance: seconds.

    Returns:
        ``(M, 3)`` or ``(M, 7)`` poses, and ``(M,)`` True where they can be used.
    """
    group = functions_of(poses)
    known = np.abs(timestamps[nearest_in_time(timestamps, at)] - at) <= tolerance
    if len(timestamps) == 1:
        return np.repeat(poses, len(at), axis=0), known
    left = np.clip(np.searchsorted(timestamps, at, side="right") - 1, 0, len(timestamps) - 2)
    share = np.clip((at - timestamps[left]) / (timestamps[left + 1] - timestamps[left]), 0.0, 1.0)
    step = group.log(group.between(poses[left], poses[left + 1]))
    return group.compose(poses[left], group.exp(share[:, None] * step)), known


def associate(first: Array, second: Array, tolerance: float) -> tuple[Indices, Indices]:
    """Pairs of the same moment in two sorted series of timestamps.

    A pair are two timestamps each of which is the nearest to the other, no further apart than the tolerance;
    so each is used once at most.

    Returns:
        ``(M,)`` indices into `first` and ``(M,)`` into `second`, both increasing.
    """
    candidates = nearest_in_time(second, first)
    mutual = nearest_in_time(first, second)[candidates] == np.arange(len(first))
    near = np.abs(second[candidates] - first) <= tolerance
    chosen = np.flatnonzero(mutual & near)
    return chosen, candidates[chosen]
