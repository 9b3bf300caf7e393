"""Errors of MRCLAM robots against their covariances; used by `landmarks.py`.

What no measurement of the robots tells has no part in their covariances, and is treated here:

- the frame: covariances are taken about the alignment of the positions that the errors are seen in. It is a similarity:
  the scale is one number for a whole run, of which no band of a mean can be told; its error is given by itself, as
  multiples of its own deviation;
- where the motion capture's body frame is mounted on each robot, three numbers, and how much later its clock is (or
  earlier the camera's picture was taken than it is stamped), one: taken out by weighted fits;
- the noise of its headings: told from the motion capture alone, as the scatter between its heading and the direction
  in which its positions move while the robot drives straight on; added to the variance of headings.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew.evaluate import Consistency, align, associate, consistency, normalised_squares
from clew.geometry import se2, wrap
from clew.io import SightingLog
from clew.slam.landmarks import LandmarkMap, RobotEstimate
from clew.slam.landmarks.model import SCALE_UNCERTAINTY
from clew.solve import aligned_covariances

Array = NDArray[np.float64]

WINDOW = 1.5  # seconds before and after a moment that tell the direction of travel
LEAST_WAY, MOST_TURN = 0.2, 0.1  # metres and radians within: a straight drive


@dataclass(frozen=True)
class Errors:
    """How one robot's errors compare with its covariances.

    Attributes:
        position, heading: normalised squared errors and their bands.
        scale: share by which the trajectory is too small.
        scale_deviation: what it should scatter by.
        mounting: ``(3,)`` metres, metres, radians of the motion capture's body frame on the robot.
        later: seconds that the motion capture is ahead of the robot's stamps.
        truth_heading: standard deviation of the motion capture's heading, radians.
    """

    position: Consistency
    heading: Consistency
    scale: float
    scale_deviation: float
    mounting: Array
    later: float
    truth_heading: float


def errors_of(found: LandmarkMap, robot: RobotEstimate, log: SightingLog) -> Errors:
    """Compare a robot's trajectory with the motion capture."""
    assert log.truth is not None
    _, rows = associate(log.truth[:, 0], robot.timestamps, 0.05)
    stamps, poses = robot.timestamps[rows], robot.T_world_robot[rows]
    aligned = aligned_covariances(found.solution, robot.keys[rows], scale=True)
    covariances = aligned.poses
    first, rate = _errors(log.truth, stamps, poses, np.zeros(3))[:2]
    calm = np.abs(rate) < 2.0  # radians a second; more are jumps of the motion capture
    later = float(np.polyfit(rate[calm], first[calm, 2] - np.median(first[calm, 2]), 1)[0])
    error, _, _ = _errors(log.truth, stamps - later, poses, np.zeros(3))
    mounting = np.append(_offset(error, covariances, poses), np.median(error[:, 2]))
    error, _, size = _errors(log.truth, stamps - later, poses, mounting)
    noise = heading_noise(log.truth)
    covariances[:, 2, 2] += noise**2
    return Errors(
        consistency(normalised_squares(error[:, :2], covariances[:, :2, :2]), 2),
        consistency(wrap(error[:, 2]) ** 2 / covariances[:, 2, 2], 1),
        size - 1.0, float(np.hypot(np.sqrt(aligned.alignment[3, 3]), SCALE_UNCERTAINTY)), mounting, later, noise,
    )  # fmt: skip


def _errors(truth: Array, stamps: Array, poses: Array, mounting: Array) -> tuple[Array, Array, float]:
    """Errors ``(N, 3)`` of poses after a similarity, the true turn rate ``(N,)``, and the size of the truth."""
    headings = np.unwrap(truth[:, 3])
    columns = [truth[:, 1], truth[:, 2], headings, np.gradient(headings, truth[:, 0])]
    at = np.stack([np.interp(stamps, truth[:, 0], column) for column in columns], axis=1)
    centres = se2.compose(at[:, :3], se2.inverse(mounting))
    moved = se2.compose(align(centres[:, :2], poses[:, :2]), poses)
    middle = centres[:, :2].mean(axis=0)
    arms = moved[:, :2] - middle
    size = float(np.sum(arms * (centres[:, :2] - middle)) / np.sum(arms**2))
    moved[:, :2] = middle + size * arms
    return se2.local(moved, centres), at[:, 3], size


def _offset(error: Array, covariances: Array, poses: Array) -> Array:
    """Constant offset ``(2,)`` in the robot's frame, beside a similarity of the whole, that fits errors best."""
    centred = poses.copy()
    centred[:, :2] -= poses[:, :2].mean(axis=0)
    back = se2.inverse(centred)
    motions = np.concatenate([se2.adjoint(back)[:, :2], -back[:, :2, None]], axis=2)
    regressors = np.concatenate([motions, np.broadcast_to(np.eye(2), (len(poses), 2, 2))], axis=2)
    weights = np.linalg.pinv(covariances[:, :2, :2])
    normal = np.einsum("nki,nkl,nlj->ij", regressors, weights, regressors)
    right = np.einsum("nki,nkl,nl->i", regressors, weights, error[:, :2])
    return np.asarray(np.linalg.solve(normal, right)[4:])


def heading_noise(truth: Array) -> float:
    """Standard deviation of the headings of a motion capture ``(G, 4)``, radians, from its own positions."""
    stamps, headings = truth[:, 0], np.unwrap(truth[:, 3])
    begin, end = (np.searchsorted(stamps, stamps + shift) for shift in (-WINDOW, WINDOW))
    good = np.flatnonzero((stamps > stamps[0] + WINDOW) & (stamps < stamps[-1] - WINDOW))[::10]
    begin, end = begin[good], end[good]
    way = truth[end, 1:3] - truth[begin, 1:3]
    whole = stamps[end] - stamps[begin] < 2.2 * WINDOW
    turn = np.array([np.ptp(headings[a:b]) for a, b in zip(begin, end, strict=True)])
    straight = whole & (np.hypot(*way.T) > LEAST_WAY) & (turn < MOST_TURN)
    sums = np.append(0.0, np.cumsum(headings))
    mean = (sums[end] - sums[begin]) / (end - begin)
    apart = wrap(np.arctan2(way[:, 1], way[:, 0]) - mean)[straight]
    return float(np.std(apart - np.median(apart)))
