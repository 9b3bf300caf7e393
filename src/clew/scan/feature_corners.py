"""Corners of buildings: where two walls meet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew.geometry import wrap
from clew.scan.feature_lines import Lines

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Corners:
    """``K`` corners in the frames of the robot.

    Attributes:
        scan: ``(K,)`` index of the scan.
        positions: ``(K, 2)`` metres.
        covariances: ``(K, 2, 2)``.
        orientations: ``(K,)`` direction from the corner in the middle between its walls, radians.
        openings: ``(K,)`` angle between the walls on the side of the robot, in (0, 2 pi): less than pi in the corner
            of a room, more at the corner of a pillar.
        lines: ``(K, 2)`` indices of the two lines.
    """

    scan: Index
    positions: Array
    covariances: Array
    orientations: Array
    openings: Array
    lines: Index

    def __len__(self) -> int:
        return len(self.scan)


def find_corners(lines: Lines, *, least_angle: float = np.radians(30.0), gap: float = 0.25) -> Corners:
    """Corners between lines that follow each other in a scan.

    Args:
        lines: from `find_lines`.
        least_angle: between the two walls, radians.
        gap: greatest distance of the corner from the end of either line, metres; walls that merely hide each other
            do not meet.
    """
    pairs = np.arange(max(len(lines) - 1, 0))
    a, b = lines.parameters[pairs], lines.parameters[pairs + 1]
    sine = np.sin(b[:, 0] - a[:, 0])
    near = (lines.scan[pairs] == lines.scan[pairs + 1]) & (np.abs(sine) > np.sin(least_angle))
    pairs, a, b, sine = pairs[near], a[near], b[near], sine[near]
    points = np.stack([
        (a[:, 1] * np.sin(b[:, 0]) - b[:, 1] * np.sin(a[:, 0])) / sine,
        (b[:, 1] * np.cos(a[:, 0]) - a[:, 1] * np.cos(b[:, 0])) / sine,
    ], axis=1)  # fmt: skip
    end_a, end_b = lines.ends[pairs, 1], lines.ends[pairs + 1, 0]
    meet = np.maximum(np.hypot(*(points - end_a).T), np.hypot(*(points - end_b).T)) < gap
    pairs, points = pairs[meet], points[meet]
    both = np.stack([pairs, pairs + 1], axis=1)
    return Corners(lines.scan[pairs], points, _covariances(lines, both, points), *_shape(lines, both, points), both)


def _covariances(lines: Lines, both: Index, points: Array) -> Array:
    """``A dp = d(rho) - (n' p) d(alpha)`` for the two lines, with ``A`` of their normals."""
    alpha = lines.parameters[both, 0]  # (K, 2)
    normals = np.stack([np.cos(alpha), np.sin(alpha)], axis=2)
    lever = points[:, None, 1] * np.cos(alpha) - points[:, None, 0] * np.sin(alpha)
    row = np.stack([-lever, np.ones_like(lever)], axis=2)
    variances = np.einsum("kli,klij,klj->kl", row, lines.covariances[both], row)
    inverse = np.linalg.inv(normals)
    return np.asarray((inverse * variances[:, None, :]) @ np.swapaxes(inverse, 1, 2))


def _shape(lines: Lines, both: Index, points: Array) -> tuple[Array, Array]:
    """Orientations and openings, from the far ends of both walls; beams run counter-clockwise."""
    before, after = lines.ends[both[:, 0], 0] - points, lines.ends[both[:, 1], 1] - points
    from_angle, to_angle = np.arctan2(after[:, 1], after[:, 0]), np.arctan2(before[:, 1], before[:, 0])
    opening = np.mod(to_angle - from_angle, 2 * np.pi)
    return wrap(from_angle + opening / 2), opening
