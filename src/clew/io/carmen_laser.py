"""What a CARMEN log tells about its laser: beam directions, longest range, place on the robot."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: A SICK LMS writes 8183 to 8191 for "no reading": centimetres where it measures to 80 m, millimetres to 8 m.
_LMS_CODES = ((81.825, 81.925), (8.1825, 8.1925))
#: Poses that are a laser's and its robot's stand still to each other within this.
_RIGID_METRES, _RIGID_RADIANS = 0.02, math.radians(1.0)


def flaser_beams(count: Indices, parameters: Mapping[str, float]) -> tuple[Array, Array]:
    """First direction and increment, ``(N,)`` each, of `FLASER` scans, which do not state them.

    A front laser sees half a turn in even fractions of a degree and may leave out the last beam:
    180 and 181 beams are 1 degree apart, 360 and 361 half a degree; the first points to the right.
    The resolution and field of view of the `PARAM` lines are used where they explain the number of beams.
    """
    beams = count.astype(np.float64)
    steps = np.where(count % 2 == 1, beams - 1, beams)
    increment = math.pi / np.maximum(steps, 1)
    first = np.full(len(count), -math.pi / 2)
    resolution = math.radians(parameters.get("laser_front_laser_resolution", 0.0))
    view = math.radians(parameters.get("laser_front_laser_fov", 0.0))
    if resolution > 0 and 0 < view <= 2 * math.pi + 1e-6:
        fits = np.abs(view / resolution - steps) <= 0.5
        increment = np.where(fits, resolution, increment)
        first = np.where(fits, -view / 2, first)
    return first, increment


def robotlaser_beams(count: Indices, start: Array, view: Array, resolution: Array) -> tuple[Array, Array]:
    """First direction and increment, ``(N,)`` each, from the headers of `ROBOTLASER1` scans.

    A header whose resolution does not fit its own field of view and number of beams gives way to the latter.
    """
    gaps = np.maximum(count - 1, 1)
    usable_view = np.isfinite(view) & (view > 0) & (view <= 2 * math.pi + 0.01)
    usable = np.isfinite(resolution) & (resolution > 0) & (resolution * gaps <= 2 * math.pi + 0.01)
    fits = usable & (~usable_view | (np.abs(resolution * gaps - view) <= 0.1 * view + resolution))
    fallback_first, fallback = flaser_beams(count, {})
    increment = np.where(fits, resolution, np.where(usable_view, view / gaps, fallback))
    first = np.where(np.isfinite(start) & (np.abs(start) <= 2 * math.pi + 0.01), start, fallback_first)
    return first, increment


def longest_return(ranges: Array, beam: Indices) -> float:
    """Least range that stands for "no return", judged by the readings themselves; ``inf`` if none does.

    A laser that meets nothing writes the end of its scale, again and again and in many directions:
    it stands out ten times above every other reading near the end. A SICK LMS has several such codes.

    Args:
        ranges: ``(R,)`` raw readings of one laser.
        beam: ``(R,)`` number of the beam that each reading belongs to.
    """
    positive = np.isfinite(ranges) & (ranges > 0)
    if not np.any(positive):
        return math.inf
    top = float(np.max(ranges[positive]))
    values, counts = np.unique(ranges[positive & (ranges >= 0.9 * top)], return_counts=True)
    for low, high in _LMS_CODES:
        if low <= top <= high:
            return float(values[values >= low][0])
    directions = len(np.unique(beam[ranges == top]))
    others = len(np.unique(ranges[positive])) - 1
    stands_out = counts[-1] >= 10 * int(np.max(counts[:-1], initial=0))
    return top if directions >= 5 and others >= 10 and stands_out else math.inf


def laser_offset(laser: Array, robot: Array, parameters: Mapping[str, float]) -> Array:
    """Pose ``(3,)`` of the laser on the robot, from the two poses of each record.

    Where the two stand still to each other over the log, that is the answer, also when it is zero: in logs
    whose two poses are the same, ranges and poses were recorded as of one point, and this point is what their
    readers and their published corrections call the robot, whatever `robot_frontlaser_offset` says. The
    parameter counts where the records do not tell: no second pose, or a first one that a mapper corrected.

    Args:
        laser, robot: ``(N, 3)`` poses in one frame; ``nan`` where a record has only one.
        parameters: `PARAM` values by name.
    """
    from_parameters = np.array([parameters.get("robot_frontlaser_offset", 0.0),
                                parameters.get("robot_frontlaser_side_offset", 0.0),
                                parameters.get("robot_frontlaser_angular_offset", 0.0)])
    both = np.isfinite(robot).all(axis=1)
    if not np.any(both):
        return from_parameters
    step = laser[both, :2] - robot[both, :2]
    cos, sin = np.cos(robot[both, 2]), np.sin(robot[both, 2])
    turn = laser[both, 2] - robot[both, 2]
    relative = np.column_stack([cos * step[:, 0] + sin * step[:, 1], cos * step[:, 1] - sin * step[:, 0],
                                np.arctan2(np.sin(turn), np.cos(turn))])
    middle = np.median(relative, axis=0)
    spread = np.quantile(np.abs(relative - middle), 0.9, axis=0)
    if max(spread[0], spread[1]) > _RIGID_METRES or spread[2] > _RIGID_RADIANS:
        return from_parameters
    # Poses are printed with six digits: less than a tenth of a millimetre or milliradian is none.
    return np.where(np.abs(middle) < 1e-4, 0.0, np.round(middle, 6))
