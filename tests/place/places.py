"""Submaps and queries of known places."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.place import Closure, Submap, VerificationOptions, build_submap, verify
from clew.scan import AlignmentOptions, LaserScan, ScanPoints, extract_points
from clew.sim import LaserModel, cast_rays
from clew.sim.world import box, pillar

Array = NDArray[np.float64]

#: A room without symmetry, seen from anywhere inside.
ROOM = np.concatenate([box(-4.0, -3.0, 5.0, 4.0), box(2.0, 1.0, 3.0, 2.2), pillar(-2.0, 1.5, 0.4, 24),
                       box(-3.5, -2.8, -2.0, -2.2)])
#: Another one.
OTHER = np.concatenate([box(-3.0, -5.0, 3.0, 2.5), pillar(1.5, -3.0, 0.5, 24), box(-2.8, -1.0, -1.5, 0.0)])
#: A bare corridor, longer than the laser sees.
CORRIDOR = np.array([[[-80.0, -1.2], [80.0, -1.2]], [[-80.0, 1.2], [80.0, 1.2]]])
#: A corridor with the same pillar every two metres.
PERIODIC = np.concatenate([CORRIDOR, *(box(x, 1.08, x + 0.3, 1.2) for x in np.arange(-60.0, 60.0, 2.0))])

LASER = LaserModel(beams=361, field_of_view=2 * np.pi, range_max=25.0)


def points_of(segments: Array, pose: Array, seed: int) -> ScanPoints:
    """Returns of one scan at a pose of the robot, whose laser sits at its centre."""
    ranges = LASER.measure(cast_rays(segments, pose[None], LASER.angles, 30.0), np.random.default_rng(seed))[0]
    return extract_points(LaserScan(0.0, ranges, LASER.angle_min, LASER.angle_increment, 0.05, LASER.range_max))


def submap_of(segments: Array, count: int = 5) -> Submap:
    """Submap of scans along a line of 1 m about the origin, anchored there."""
    poses = np.column_stack([np.linspace(-0.5, 0.5, count), np.zeros(count), np.linspace(-0.2, 0.2, count)])
    clouds = [points_of(segments, pose, seed) for seed, pose in enumerate(poses)]
    return build_submap(7, clouds, poses, np.zeros((count, 3)))


def matched(submap: Submap, query: ScanPoints, T_predicted: Array, half: tuple[float, float, float] = (1.5, 1.5, 0.4),
            *, may_slide: bool = False, **options: float) -> Closure:
    """The verdict on a query within a window, with next to no prior."""
    return verify(submap, query, 30, T_predicted, T_predicted, np.array(half), np.eye(3), 0.9,
                  VerificationOptions(**options), AlignmentOptions(), may_slide=may_slide)
