"""Clouds that the tests of this room share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.scan import LaserScan, ScanPoints, extract_points
from clew.sim import cast_rays
from clew.sim.world import box, pillar

Array = NDArray[np.float64]

ROOM = np.concatenate([box(-4.0, -3.0, 5.0, 4.0), box(2.0, 1.0, 3.0, 2.2), pillar(-2.0, 1.5, 0.4, 24)])
CORRIDOR = np.array([[[-60.0, -1.2], [60.0, -1.2]], [[-60.0, 1.2], [60.0, 1.2]]])
T_ROBOT_SENSOR = np.array([0.2, -0.1, 0.3])


def scan_of(segments: Array, T_world_sensor: Array, *, sigma: float = 0.0, seed: int = 0, beams: int = 361,
            view: float = 2 * np.pi, mounted: Array | None = None) -> LaserScan:
    """What a laser at a pose sees, with noise of its own."""
    angles = -view / 2 + view / (beams - 1) * np.arange(beams)
    ranges = cast_rays(segments, T_world_sensor[None], angles)[0]
    ranges = ranges + sigma * np.random.default_rng(seed).standard_normal(beams)
    at = np.zeros(3) if mounted is None else mounted
    return LaserScan(0.0, ranges, float(angles[0]), view / (beams - 1), 0.05, 30.0, at)


def cloud_of(segments: Array, T_world_sensor: Array, *, sigma: float = 0.0, seed: int = 0) -> ScanPoints:
    """Its returns in its own frame."""
    return extract_points(scan_of(segments, T_world_sensor, sigma=sigma, seed=seed))


def random_cloud(rng: np.random.Generator, count: int, extent: float = 3.0, blobs: float = 0.3) -> ScanPoints:
    """Points without any order, with normals in all directions; some hold along their surface too."""
    angle = rng.uniform(-np.pi, np.pi, count)
    along = np.where(rng.random(count) < blobs, rng.uniform(0.4, 1.0, count), 0.0)
    return ScanPoints(rng.uniform(-extent, extent, (count, 2)), np.stack([np.cos(angle), np.sin(angle)], axis=1),
                      along, rng.uniform(0.1, 1.0, count))


EMPTY = ScanPoints(np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0), np.zeros(0))
