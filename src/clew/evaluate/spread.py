"""How far returns lie from the wall that all other scans see: the thickness of the map, without truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

FACING = 0.8  # least cosine between normals of one side of one wall
LEAST_POINTS = 8  # that make a wall, of two scans or more
THIN = 0.35  # a wall's points spread at most this much across it, as a share of along it
AT_ONCE = 500


@dataclass(frozen=True)
class WallSpread:
    """Distances of returns from the line through the returns of other scans around them.

    Attributes:
        used: returns that have a wall around them.
        unused: returns that have none (clutter, or seen by no other scan).
        median: of the absolute distance, metres.
        rms: root of the mean square of the distances, metres.
    """

    used: int
    unused: int
    median: float
    rms: float

    def to_dict(self) -> dict[str, object]:
        """Plain numbers, metres; None where no return has a wall."""
        numbers = {"median_m": self.median, "rms_m": self.rms}
        return {"used": self.used, "unused": self.unused,
                **{name: None if np.isnan(value) else value for name, value in numbers.items()}}


def wall_spread(points: Array, normals: Array, scans: Indices, *, radius: float = 0.15,
                limit: int = 8000) -> WallSpread:
    """Spread of returns about their walls.

    For a return, the wall is the line (by total least squares) through the returns of other scans within `radius` that
    face the same way. Where these are no line, the return is left out.

    Args:
        points: ``(n, 2)`` returns of all scans in the world, metres.
        normals: ``(n, 2)`` unit normals of their surfaces, towards the sensor.
        scans: ``(n,)`` number of the scan of each; scans between which the robot hardly moved should be thinned out.
        radius: metres.
        limit: so many returns are judged at most, evenly spaced; all of them make walls.

    Raises:
        InputError: shapes do not fit, or a number is not finite.
    """
    if points.ndim != 2 or points.shape[1] != 2 or normals.shape != points.shape or scans.shape != points.shape[:1]:
        raise InputError("wall_spread: give points (n, 2), normals (n, 2) and scans (n,)")
    if not (np.isfinite(points).all() and np.isfinite(normals).all()):
        raise InputError("wall_spread: points and normals must be finite")
    from scipy.spatial import cKDTree  # slow to import, and seldom needed

    tree = cKDTree(points)
    count = min(limit, len(points))
    judged = np.linspace(0, max(len(points) - 1, 0), count).round().astype(np.int64)
    parts = [_distances(tree, points, normals, scans, judged[i:i + AT_ONCE], radius)
             for i in range(0, count, AT_ONCE)]
    distances = np.concatenate([np.zeros(0), *parts])
    if not len(distances):
        return WallSpread(0, count, float("nan"), float("nan"))
    return WallSpread(len(distances), count - len(distances), float(np.median(np.abs(distances))),
                      float(np.sqrt(np.mean(distances**2))))


def _distances(tree: cKDTree, points: Array, normals: Array, scans: Indices, judged: Indices, radius: float) -> Array:
    """Signed distances of those returns that have a wall."""
    from scipy.spatial import cKDTree

    near = cKDTree(points[judged]).sparse_distance_matrix(tree, radius, output_type="ndarray")
    owner, partner = near["i"], near["j"]
    own = judged[owner]
    same = (scans[partner] != scans[own]) & (np.sum(normals[partner] * normals[own], axis=1) >= FACING)
    owner, partner = owner[same], partner[same]

    def total(values: Array) -> Array:
        return np.asarray(np.bincount(owner, values, len(judged)), dtype=np.float64)

    offset = points[partner] - points[judged[owner]]  # the return itself is the origin
    number = total(np.ones(len(owner)))
    n = np.maximum(number, 1.0)
    mean = np.stack([total(offset[:, axis]) for axis in range(2)], axis=1) / n[:, None]
    xx, xy, yy = (total(offset[:, a] * offset[:, b]) / n - mean[:, a] * mean[:, b] for a, b in ((0, 0), (0, 1), (1, 1)))
    root = np.hypot(0.5 * (xx - yy), xy)
    along = np.sqrt(np.maximum(0.5 * (xx + yy) + root, 0.0))
    across = np.sqrt(np.maximum(0.5 * (xx + yy) - root, 0.0))
    direction = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    distance = -np.sin(direction) * mean[:, 0] + np.cos(direction) * mean[:, 1]
    earliest, latest = np.full(len(judged), np.iinfo(np.int64).max), np.full(len(judged), -1)
    np.minimum.at(earliest, owner, scans[partner])
    np.maximum.at(latest, owner, scans[partner])
    wall = (number >= LEAST_POINTS) & (latest > earliest) & (across <= THIN * along)
    return np.asarray(distance[wall])
