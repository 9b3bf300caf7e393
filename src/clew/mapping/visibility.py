"""Returns that a few recent scans contradict, by the rays of these alone: quick enough for every scan while driving.

`moving_returns` knows the whole log and counts in cells of a grid; here each return is looked up among the beams of
each other scan (a range image in the plane; Pomerleau et al., "Long-term 3D map maintenance in dynamic environments",
ICRA 2014). What counts as seen through is the same: a ray that passes with room to spare.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew import _native
from clew.geometry import se2
from clew.mapping.moving import MovingOptions, usable_ranges
from clew.mapping.rays import FREE_RANGE, MAX_RANGE
from clew.scan import LaserScan, resample

Array = NDArray[np.float64]
Counts = NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class View:
    """What one scan saw, and how far each of its beams is trusted to have seen through.

    Attributes:
        T_map_sensor: ``(3,)``.
        first_angle, increment: of its evenly spaced beams, radians.
        ranges: ``(n,)`` metres; not finite where there is no return.
        clear: ``(n,)`` metres.
    """

    T_map_sensor: Array
    first_angle: float
    increment: float
    ranges: Array
    clear: Array


def view_of(scan: LaserScan, T_map_robot: Array, options: MovingOptions | None = None) -> View:
    """The view of a scan from a place ``(3,)``; one whose beams all point one way sees nothing."""
    o = options or MovingOptions()
    even, _ = resample(scan)
    pose = se2.compose(T_map_robot, np.asarray(scan.T_robot_sensor, dtype=np.float64))
    if even.angle_increment == 0.0:
        return View(pose, 0.0, 1.0, np.zeros(0), np.zeros(0))
    ranges = usable_ranges([even])
    clear = _native.mapping.clear_lengths(
        np.zeros((1, 3)), np.array([0, len(ranges)]), np.array([even.angle_min]), np.array([even.angle_increment]),
        ranges, np.zeros(1, np.int32), MAX_RANGE, FREE_RANGE, o.width, o.margin,
    )  # fmt: skip
    return View(pose, even.angle_min, even.angle_increment, ranges, clear)


class Views:
    """Several views in one frame, ready to be asked about many places."""

    def __init__(self, views: Sequence[View], options: MovingOptions | None = None) -> None:
        self._options = options or MovingOptions()
        self._T_sensor_map = se2.inverse(np.array([view.T_map_sensor for view in views]).reshape(-1, 3))
        self._offsets = np.cumsum([0, *(len(view.ranges) for view in views)])
        self._first_angle = np.array([view.first_angle for view in views])
        self._increment = np.array([view.increment for view in views])
        self._ranges = np.concatenate([np.empty(0), *(view.ranges for view in views)])
        self._clear = np.concatenate([np.empty(0), *(view.clear for view in views)])

    def __len__(self) -> int:
        return len(self._T_sensor_map)

    def looks_at(self, points: Array, T_map_points: Array | None = None) -> tuple[Counts, Counts]:
        """How many views saw something at the place of each point, and how many saw through it.

        Args:
            points: ``(n, 2)`` metres.
            T_map_points: ``(3,)`` frame of the points; that of the views unless given.

        Returns:
            Both ``(n,)``. What lies within `MovingOptions.margin` of a return was seen; a view from which the place
            was hidden or out of sight counts for neither.
        """
        poses = self._T_sensor_map if T_map_points is None else se2.compose(self._T_sensor_map, T_map_points)
        return _native.mapping.see(
            poses, self._offsets, self._first_angle, self._increment, self._ranges, self._clear,
            np.ascontiguousarray(points, dtype=np.float64), self._options.margin,
        )  # fmt: skip


def contradicted(seen: Counts, through: Counts, options: MovingOptions | None = None) -> NDArray[np.bool_]:
    """Which places were seen through so often, and seen so seldom, that what is there does not stay."""
    o = options or MovingOptions()
    return np.asarray((through >= o.looks) & (seen <= o.seen * (seen + through)))
