"""Errors of a whole trajectory against the true one.

Sturm, Engelhard, Endres, Burgard, Cremers: A benchmark for the evaluation of RGB-D SLAM systems (IROS 2012).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.evaluate.poses import (
    as_trajectory,
    associate,
    functions_of,
    in_common,
    rotation_angles,
    translations,
    travelled,
)
from clew.evaluate.statistics import ErrorStatistics
from clew.geometry import so3

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class AbsoluteError:
    """Distance of an aligned trajectory from the truth.

    Attributes:
        used: pairs of poses of the same moment.
        unused: poses of the trajectory without a true one near enough in time.
        translation: metres.
        rotation: radians.
        T_truth_estimate: ``(3,)`` or ``(7,)`` alignment: maps the trajectory's frame to that of the truth.
    """

    used: int
    unused: int
    translation: ErrorStatistics
    rotation: ErrorStatistics
    T_truth_estimate: Array

    def to_dict(self) -> dict[str, object]:
        """Plain numbers; translations in metres, rotations in degrees."""
        return {"used": self.used, "unused": self.unused, "translation_m": self.translation.to_dict(),
                "rotation_deg": self.rotation.to_dict(180 / np.pi),
                "T_truth_estimate": self.T_truth_estimate.tolist()}


@dataclass(frozen=True)
class RelativeError:
    """Drift of a trajectory over a fixed distance or time.

    Attributes:
        used: pairs of poses that are `delta` apart.
        delta: metres or seconds.
        along: what `delta` measures, ``"distance"`` or ``"time"``.
        translation: metres a pair.
        rotation: radians a pair.
    """

    used: int
    delta: float
    along: Literal["distance", "time"]
    translation: ErrorStatistics
    rotation: ErrorStatistics

    def to_dict(self) -> dict[str, object]:
        """Plain numbers; translations in metres, rotations in degrees."""
        unit = "m" if self.along == "distance" else "s"
        return {"used": self.used, f"delta_{unit}": self.delta, "translation_m": self.translation.to_dict(),
                "rotation_deg": self.rotation.to_dict(180 / np.pi)}


def align(truth: Array, estimate: Array) -> Array:
    """Rigid motion, without scale, that brings points closest to the true ones in the sense of least squares.

    Umeyama: Least-squares estimation of transformation parameters between two point patterns (PAMI 1991), eq.
        40-42.

    Args:
        truth: ``(N, 2)`` or ``(N, 3)`` points, metres.
        estimate: points of the same moments in another frame, the same shape.

    Returns:
        ``(3,)`` or ``(7,)`` pose ``T_truth_estimate``.

    Raises:
        InputError: shapes do not fit, or there is no point.
    """
    if truth.shape != estimate.shape or truth.ndim != 2 or truth.shape[1] not in (2, 3) or len(truth) == 0:
        raise InputError(f"align: points of shapes {truth.shape} and {estimate.shape}: "
                         "must be equal, (N, 2) or (N, 3)")
    middle_truth, middle = truth.mean(axis=0), estimate.mean(axis=0)
    u, _, vt = np.linalg.svd((truth - middle_truth).T @ (estimate - middle))
    signs = np.ones(truth.shape[1])
    signs[-1] = np.sign(np.linalg.det(u) * np.linalg.det(vt))
    rotation = (u * signs) @ vt
    shift = middle_truth - rotation @ middle
    if truth.shape[1] == 2:
        return np.array([*shift, np.arctan2(rotation[1, 0], rotation[0, 0])])
    return np.concatenate([shift, so3.from_matrix(rotation)])


def absolute_trajectory_error(truth_timestamps: Array, truth: Array, timestamps: Array, poses: Array, *,
                              tolerance: float = 0.05) -> AbsoluteError:
    """Distance from the truth after the best rigid alignment of the positions.

    Args:
        truth_timestamps: ``(K,)`` seconds.
        truth: ``(K, 3)`` or ``(K, 7)`` true poses.
        timestamps: ``(N,)`` seconds.
        poses: ``(N, 3)`` or ``(N, 7)`` poses of the trajectory.
        tolerance: poses of the same moment are no further apart in time, seconds.

    Raises:
        InputError: arrays that do not fit, or fewer than two pairs of the same moment.
    """
    _, true, own, unused = _matched(truth_timestamps, truth, timestamps, poses, tolerance)
    T_truth_estimate = align(translations(true), translations(own))
    group = functions_of(true)
    error = group.between(true, group.compose(T_truth_estimate, own))
    return AbsoluteError(len(true), unused, ErrorStatistics.of(np.linalg.norm(translations(error), axis=1)),
                         ErrorStatistics.of(rotation_angles(error)), T_truth_estimate)


def relative_pose_error(truth_timestamps: Array, truth: Array, timestamps: Array, poses: Array, *,
                        delta: float = 10.0, along: Literal["distance", "time"] = "distance",
                        tolerance: float = 0.05) -> RelativeError:
    """Error of the motion from each pose to the first one that is `delta` further along the truth.

    Args:
        truth_timestamps: ``(K,)`` seconds.
        truth: ``(K, 3)`` or ``(K, 7)`` true poses.
        timestamps: ``(N,)`` seconds.
        poses: ``(N, 3)`` or ``(N, 7)`` poses of the trajectory.
        delta: metres for ``along="distance"``, seconds for ``along="time"``.
        along: what `delta` measures.
        tolerance: poses of the same moment are no further apart in time, seconds.

    Raises:
        InputError: arrays that do not fit, fewer than two pairs of the same moment, or a delta that is not
            positive.
    """
    if not delta > 0.0:
        raise InputError(f"delta of {delta:g}: must be positive")
    times, true, own, _ = _matched(truth_timestamps, truth, timestamps, poses, tolerance)
    progress = travelled(true) if along == "distance" else times
    # A hair less, so that evenly spaced poses are found in spite of rounding.
    goal = np.searchsorted(progress, progress + delta * (1 - 1e-9))
    start = np.flatnonzero(goal < len(progress))
    goal = goal[start]
    group = functions_of(true)
    error = group.between(group.between(true[start], true[goal]), group.between(own[start], own[goal]))
    return RelativeError(len(start), delta, along,
                         ErrorStatistics.of(np.linalg.norm(translations(error), axis=1)),
                         ErrorStatistics.of(rotation_angles(error)))


def _matched(truth_timestamps: Array, truth: Array, timestamps: Array, poses: Array,
             tolerance: float) -> tuple[Array, Array, Array, int]:
    """Times, true and own poses of the same moments, and the number of own poses that are left over."""
    truth_timestamps, truth = as_trajectory(truth_timestamps, truth, "truth")
    timestamps, poses = as_trajectory(timestamps, poses, "trajectory")
    if not tolerance >= 0.0:
        raise InputError(f"tolerance of {tolerance:g} s: must not be negative")
    truth, poses = in_common(truth, poses)
    of_truth, of_own = associate(truth_timestamps, timestamps, tolerance)
    if len(of_own) < 2:
        raise InputError(f"{len(of_own)} poses of trajectory and truth are within {tolerance:g} s of "
                         f"each other (trajectory from {timestamps[0]:.3f} to {timestamps[-1]:.3f} s, "
                         f"truth from {truth_timestamps[0]:.3f} to {truth_timestamps[-1]:.3f} s): "
                         "give the truth of this log, or a greater tolerance")
    return truth_timestamps[of_truth], truth[of_truth], poses[of_own], len(poses) - len(of_own)
