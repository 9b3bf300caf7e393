"""Laser scans at known poses as one batch of rays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.geometry import se2
from clew.scan import LaserScan

Array = NDArray[np.float64]

#: Returns from farther away do not enter a map unless asked for (metres): at 30 m neighbouring beams of half
#: a degree are five cells apart, and a single return through a window would stretch the grid.
MAX_RANGE = 30.0

#: Longest free ray of a beam without return (metres; Cartographer's `missing_data_ray_length`). Such a beam
#: says little: glass, black surfaces and sunlight swallow beams at any distance.
FREE_RANGE = 5.0

#: A return that is left out still says that its ray was free up to this far before it (metres): whoever stood there
#: leaves no trace, and a return that was left out wrongly does not erase its wall.
EXCLUDED_MARGIN = 0.15


@dataclass(frozen=True, eq=False)
class RayBatch:
    """Rays of ``S`` scans with ``B`` beams in all; scan ``s`` owns the beams ``offsets[s]:offsets[s + 1]``.

    Attributes:
        T_world_sensor: ``(S, 3)`` pose of the sensor at each scan (x, y in metres, theta in radians).
        offsets: ``(S + 1,)`` first beam of each scan, and ``B``.
        endpoints: ``(B, 2)`` where each ray ends, in the sensor frame, metres.
        hit: ``(B,)`` True where the ray ends at a surface; False where it is only known to have met nothing.

    Raises:
        InputError: the shapes do not fit together, or a pose or endpoint is not finite.
    """

    T_world_sensor: Array
    offsets: NDArray[np.int64]
    endpoints: Array
    hit: NDArray[np.bool_]

    def __post_init__(self) -> None:
        for name, dtype in (("T_world_sensor", np.float64), ("offsets", np.int64), ("endpoints", np.float64),
                            ("hit", np.bool_)):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), dtype=dtype))
        scans, beams = len(self.T_world_sensor), len(self.endpoints)
        if (self.T_world_sensor.shape != (scans, 3) or self.offsets.shape != (scans + 1,)
                or self.endpoints.shape != (beams, 2) or self.hit.shape != (beams,)):
            raise InputError(
                "a ray batch needs poses (S, 3), offsets (S + 1,), endpoints (B, 2) and hit (B,), not "
                f"{self.T_world_sensor.shape}, {self.offsets.shape}, {self.endpoints.shape}, "
                f"{self.hit.shape}")
        if self.offsets[0] != 0 or self.offsets[-1] != beams or np.any(np.diff(self.offsets) < 0):
            raise InputError(f"the offsets of a ray batch must rise from 0 to its {beams} beams")
        for name in ("T_world_sensor", "endpoints"):
            if not np.isfinite(getattr(self, name)).all():
                raise InputError(f"{name} of a ray batch must be finite")

    def __len__(self) -> int:
        return len(self.T_world_sensor)


def rays_from_scans(
    scans: Sequence[LaserScan],
    T_world_robot: Array,
    *,
    max_range: float | None = None,
    free_range: float = FREE_RANGE,
    exclude: Sequence[NDArray[np.bool_]] | None = None,
) -> RayBatch:
    """Rays of scans taken at known robot poses.

    A return beyond `max_range` becomes a free ray of that length. A beam without return (``inf``) becomes a
    free ray as long as the shorter of the nearest returns on either side, and no longer than `free_range`: a
    window or a black door lies in line with the wall around it. Invalid beams (``nan``, or shorter than the
    scan's `range_min`) are left out.

    Args:
        scans: ``S`` scans.
        T_world_robot: ``(S, 3)`` pose of the robot at each scan.
        max_range: longest ray, metres; None for the sensor's `range_max`, but at most `MAX_RANGE`.
        free_range: longest free ray of a beam without return, metres; 0 leaves such beams out.
        exclude: for each scan a mask over its beams, True where the return is left out (see `moving_returns`): the
            beam becomes a free ray that ends `EXCLUDED_MARGIN` before it.

    Raises:
        InputError: there are not as many poses as scans, a pose is not finite, `max_range` is not positive,
            `free_range` negative, or `exclude` has not one flag a beam.
    """
    poses = np.asarray(T_world_robot, dtype=np.float64)
    if poses.shape != (len(scans), 3):
        raise InputError(f"{len(scans)} scans need poses of shape ({len(scans)}, 3), not {poses.shape}")
    if not np.isfinite(poses).all():
        raise InputError("poses must be finite")
    if max_range is not None and not max_range > 0.0:
        raise InputError(f"max_range must be positive, not {max_range}")
    if not free_range >= 0.0:
        raise InputError(f"free_range must not be negative, not {free_range}")
    if exclude is not None and [mask.shape for mask in exclude] != [scan.ranges.shape for scan in scans]:
        raise InputError("exclude needs a mask for each scan, with one flag a beam")
    groups, begin = [], 0
    for _, group in groupby(scans, key=_geometry):
        equal = list(group)
        part = None if exclude is None else np.stack(exclude[begin:begin + len(equal)])
        groups.append(_rays_of_equal_scans(equal, part, max_range, free_range))
        begin += len(equal)
    if not groups:
        return RayBatch(np.zeros((0, 3)), np.zeros(1, np.int64), np.zeros((0, 2)), np.zeros(0, np.bool_))
    counts, endpoints, hit = (np.concatenate(parts) for parts in zip(*groups, strict=True))
    T_robot_sensor = np.stack([scan.T_robot_sensor for scan in scans])
    T_world_sensor = se2.compose(poses, T_robot_sensor)
    return RayBatch(T_world_sensor, np.concatenate([[0], np.cumsum(counts)]), endpoints, hit)


def _geometry(scan: LaserScan) -> tuple[int, float, float, float, float, bool]:
    return (len(scan.ranges), scan.angle_min, scan.angle_increment, scan.range_min, scan.range_max,
            scan.bearings is not None)


def _rays_of_equal_scans(
    scans: list[LaserScan], excluded: NDArray[np.bool_] | None, max_range: float | None, free_range: float
) -> tuple[NDArray[np.int64], Array, NDArray[np.bool_]]:
    """Beams a scan, endpoints and hit flags of scans that share one geometry."""
    first = scans[0]
    reach = min(first.range_max, MAX_RANGE) if max_range is None else max_range
    ranges = np.stack([scan.ranges for scan in scans]).astype(np.float64, copy=False)
    no_return = np.isposinf(ranges)
    returned = (ranges >= first.range_min) & np.isfinite(ranges)
    before = _last_return(ranges, returned)
    after = _last_return(ranges[:, ::-1], returned[:, ::-1])[:, ::-1]
    free_reach = min(free_range, first.range_max, reach)
    length = np.where(returned, np.minimum(ranges, reach), np.minimum(np.minimum(before, after), free_reach))
    hit = returned & (ranges <= reach)
    if excluded is not None:
        length = np.where(hit & excluded, np.maximum(length - EXCLUDED_MARGIN, 0.0), length)
        hit &= ~excluded
    kept = (returned | no_return) & (length > 0.0)
    angles = first.angles if first.bearings is None else np.stack([scan.angles for scan in scans])
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    endpoints = length[..., None] * directions
    return kept.sum(axis=1), endpoints[kept], hit[kept]


def _last_return(ranges: Array, returned: NDArray[np.bool_]) -> Array:
    """The range ``(S, n)`` of the last return at or before each beam, infinite where there was none."""
    latest = np.maximum.accumulate(np.where(returned, np.arange(ranges.shape[1]), -1), axis=1)
    return np.where(latest >= 0, np.take_along_axis(ranges, np.maximum(latest, 0), axis=1), np.inf)
