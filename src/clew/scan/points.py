"""Returns of a scan as points with surface normals, ready for matching."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew import _native
from clew.scan.laser import LaserScan

Array = NDArray[np.float64]

MOST_NEIGHBOURS = 64  # on each side
FLAT = 0.1  # radians; neighbours whose normals are this perpendicular to the line between them lie on one straight wall
FILLING_WEIGHT = 0.01  # of a point between two returns: where surfels are merged, returns rule


@dataclass(frozen=True)
class CleaningOptions:
    """How returns are cleaned and their surfaces estimated.

    Attributes:
        range_limit: returns further away are left out, metres; grazing far returns say little and cost much.
        radius: neighbours within this distance make the surface of a return, metres (the next two on each side
            wherever they are). Normals from smaller neighbourhoods are so noisy that a bare corridor would seem to
            tell how far along it the robot is.
        gap_base, gap_per_metre: a step between neighbouring returns longer than
            ``gap_base + gap_per_metre * range`` ends the surface.
        spacing: returns closer together than this share their weight, metres, so that a wall right beside
            the robot does not outvote the rest of the room.
        filling: neighbouring returns on one wall that are further apart get points between them where others are
            matched against them (`fill_surfaces`), metres.
        blob: ratio of a neighbourhood's minor to major deviation from which it counts as no line.
    """

    range_limit: float = 40.0
    radius: float = 0.25
    gap_base: float = 0.06
    gap_per_metre: float = 0.06
    spacing: float = 0.05
    filling: float = 0.1
    blob: float = 0.4


@dataclass(frozen=True)
class ScanPoints:
    """Points with normals in one frame.

    Attributes:
        points: ``(n, 2)`` metres.
        normals: ``(n, 2)`` unit normals, towards the side from which the surface was seen.
        along: ``(n,)`` in [0, 1], how much a point also holds along its surface: 0 on a line, 1 in a blob.
        weights: ``(n,)`` in (0, 1].
    """

    points: Array
    normals: Array
    along: Array
    weights: Array

    def __len__(self) -> int:
        return int(self.points.shape[0])

    def select(self, rows: NDArray[np.bool_]) -> ScanPoints:
        """Those of the points for which ``(n,)`` a mask is True."""
        return ScanPoints(self.points[rows], self.normals[rows], self.along[rows], self.weights[rows])

    def transformed(self, pose: Array) -> ScanPoints:
        """The same points seen from the frame in which `pose` ``(3,)`` holds the present one."""
        c, s = np.cos(pose[2]), np.sin(pose[2])
        rotation_t = np.array([[c, s], [-s, c]])
        return ScanPoints(self.points @ rotation_t + pose[:2], self.normals @ rotation_t, self.along, self.weights)


def concatenate(clouds: Sequence[ScanPoints]) -> ScanPoints:
    """One cloud of several in the same frame."""
    return ScanPoints(
        np.concatenate([c.points for c in clouds]),
        np.concatenate([c.normals for c in clouds]),
        np.concatenate([c.along for c in clouds]),
        np.concatenate([c.weights for c in clouds]),
    )


def gathered(clouds: Sequence[ScanPoints], poses: Array) -> ScanPoints:
    """One cloud of several, each at its pose ``(M, 3)`` in a common frame."""
    cloud = concatenate(clouds)
    lengths = [len(c) for c in clouds]
    cos, sin = np.repeat(np.cos(poses[:, 2]), lengths), np.repeat(np.sin(poses[:, 2]), lengths)
    points, normals = np.empty_like(cloud.points), np.empty_like(cloud.normals)
    for given, turned in ((cloud.points, points), (cloud.normals, normals)):
        turned[:, 0] = cos * given[:, 0] - sin * given[:, 1]
        turned[:, 1] = sin * given[:, 0] + cos * given[:, 1]
    points += np.repeat(poses[:, :2], lengths, axis=0)
    return ScanPoints(points, normals, cloud.along, cloud.weights)


def extract_points(scan: LaserScan, options: CleaningOptions | None = None) -> ScanPoints:
    """Returns of a scan in the robot's frame, without invalid, too far and isolated ones.

    An isolated return, with no neighbour on its surface, is mostly a mixed pixel at an edge or dust.
    """
    return extract_returns(scan, options)[0]


def extract_returns(
    scan: LaserScan, options: CleaningOptions | None = None
) -> tuple[ScanPoints, NDArray[np.int32]]:
    """`extract_points`, with the beam ``(n,)`` of each."""
    o = options or CleaningOptions()
    cloud, beams = _native.scan.extract_returns(
        np.ascontiguousarray(scan.ranges, dtype=np.float64), np.ascontiguousarray(scan.angles, dtype=np.float64),
        np.ascontiguousarray(scan.T_robot_sensor, dtype=np.float64), scan.range_min, min(scan.range_max, o.range_limit),
        MOST_NEIGHBOURS, o.radius, o.gap_base, o.gap_per_metre, o.blob, abs(scan.angle_increment) / o.spacing,
    )  # fmt: skip
    return ScanPoints(*cloud), beams


def fill_surfaces(cloud: ScanPoints, options: CleaningOptions | None = None) -> ScanPoints:
    """A scan with points put between neighbouring returns on one straight wall, for others to be matched against.

    Far and grazing walls are sampled so sparsely that a scan taken half a metre on finds no partners there but where
    the same beams met: it would seem that the robot stood still. The points put in tell nothing new: a filled scan must
    not be the one that is moved, and where `merge_surfels` finds returns beside them these decide.

    Args:
        cloud: as `extract_points` returns it, in the order of its beams.
        options: those of the extraction: `filling`, and where a surface ends.
    """
    o = options or CleaningOptions()
    between = _native.scan.between_returns(
        cloud.points, cloud.normals, cloud.along, cloud.weights, o.filling, o.gap_base, o.gap_per_metre, FLAT,
        FILLING_WEIGHT,
    )  # fmt: skip
    return concatenate([cloud, ScanPoints(*between)])
