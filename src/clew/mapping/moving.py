"""Returns from what does not stay: people, carts, doors.

A place is *seen* at the moments in which a return lay in its cell or one beside it, and *seen through* at those in
which a ray passed its cell with room to spare. A return moves when its place was seen through far more often than
seen, or now for a while the one and then for a while the other, as that of a door is. The idea is that of cleaning
clouds by visibility (Schauer, Nuechter: The Peopleremover, RA-L 2018), in the plane and with moments for sweeps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew import _native
from clew.errors import InputError
from clew.geometry import se2
from clew.mapping.rays import FREE_RANGE, MAX_RANGE
from clew.scan import LaserScan, resample

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FARTHEST = 1e7  # metres; no building is larger, and cells further out would overflow their numbers


@dataclass(frozen=True)
class MovingOptions:
    """When a return counts as moving.

    Attributes:
        resolution: side of a cell, metres.
        width: a ray has room to spare when no other return of its scan comes nearer than this, metres; a few times
            the noise of poses and returns.
        margin: and what lies nearer than this before a return is not seen through, metres.
        moment: scans within so many seconds are one look; a robot that stands still does not outvote the rest.
        looks: moments at which the place must have been seen through at least.
        seen: largest share of the moments at which it was seen; about that from which on an occupancy grid calls a
            cell occupied. A wall is seen nearly always, a chair leg between two beams about half of the time.
        sure: of a place that was mostly seen, what was seen through counts only nearer than this, metres: far away a
            fraction of a degree leads past the end of a wall, or through one that a ray grazes.
        turns: moments, and
        turn_share: share of all, at which a place must have been seen through at least that was seen for more of them,
        constancy: and how often seen and seen through may follow each other at most, to how often they would by chance:
            a chair leg is missed now and then, a door is open for a while.
        edge_share, edge_constancy: the same for what lies beside such a place on the same surface.
    """

    resolution: float = 0.05
    width: float = 0.15
    margin: float = 0.2
    moment: float = 0.5
    looks: int = 2
    seen: float = 0.35
    sure: float = 8.0
    turns: int = 4
    turn_share: float = 0.2
    constancy: float = 0.5
    edge_share: float = 0.1
    edge_constancy: float = 0.7


def moving_returns(
    scans: Sequence[LaserScan], T_world_robot: Array, *, options: MovingOptions | None = None
) -> list[Mask]:
    """Which returns came from things that did not stay, by all that the log has seen of their places.

    Use it with optimised poses; it bears noise of two or three centimetres. What stood at its place for more than
    about `MovingOptions.seen` of the time that it was looked at is part of the map, but for what comes and goes: a door
    that is seen closed, and later open, moves, however long it was closed. What was brought once and is there still
    stays, and so does what lets rays of some directions through, as glass does. A door that was never seen open is a
    wall.

    Args:
        scans: ``N`` scans of a log, in the order of time.
        T_world_robot: ``(N, 3)`` pose of the robot at each.
        options: see `MovingOptions`.

    Returns:
        For each scan a mask ``(n,)`` over its beams, False where there is no return.

    Raises:
        InputError: there are not as many poses as scans, or a pose is not finite.
    """
    o = options or MovingOptions()
    poses = np.asarray(T_world_robot, dtype=np.float64)
    if poses.shape != (len(scans), 3):
        raise InputError(f"{len(scans)} scans need poses of shape ({len(scans)}, 3), not {poses.shape}")
    if not (np.abs(poses) < FARTHEST).all():
        raise InputError(f"poses must be finite and within {FARTHEST:g} m")
    if not scans:
        return []
    even, beams = zip(*(resample(scan) for scan in scans), strict=True)
    offsets = np.concatenate([[0], np.cumsum([len(scan.ranges) for scan in scans])]).astype(np.int64)
    _, hits, misses, changes, seen_last, both_ways = _native.mapping.count_looks(
        se2.compose(poses, np.stack([scan.T_robot_sensor for scan in scans])), offsets,
        np.array([scan.angle_min for scan in scans]), np.array([scan.angle_increment for scan in scans]),
        usable_ranges(even), moments(np.array([scan.timestamp for scan in scans]), o.moment),
        o.resolution, MAX_RANGE, FREE_RANGE, o.width, o.margin, o.sure,
    )  # fmt: skip
    ranges = np.concatenate([scan.ranges for scan in even])
    first = np.zeros(len(ranges), dtype=np.bool_)
    first[offsets[:-1][np.diff(offsets) > 0]] = True
    masks = np.split(_moves(_Looks(hits, misses, changes, seen_last, both_ways), ranges, first, o), offsets[1:-1])
    return [mask if scan.bearings is None else mask[own] & np.isfinite(scan.ranges)
            for mask, own, scan in zip(masks, beams, scans, strict=True)]


@dataclass(frozen=True)
class _Looks:
    """At the place of each return ``(n,)``: see the native `Tally`."""

    hits: NDArray[np.int32]
    misses: NDArray[np.int32]
    changes: NDArray[np.int32]
    seen_last: NDArray[np.uint8]
    both_ways: NDArray[np.uint8]


def _moves(looks: _Looks, ranges: Array, first: Mask, o: MovingOptions) -> Mask:
    """Which returns ``(n,)`` move, and with them what is beside them on the same surface, if that may move, too."""
    all_looks = looks.hits + looks.misses
    by_chance = np.maximum(2.0 * looks.hits * looks.misses / np.maximum(all_looks, 1), 1.0)
    brought_once = (looks.changes == 1) & (looks.seen_last > 0)
    fleeting = (looks.misses >= o.looks) & (looks.hits <= o.seen * all_looks)
    comes_and_goes = (looks.misses >= o.turns) & (looks.misses >= o.turn_share * all_looks)
    comes_and_goes &= (looks.changes <= o.constancy * by_chance) & (looks.both_ways > 0) & ~brought_once
    moves = fleeting | comes_and_goes
    may_move = (looks.misses >= o.looks) & (looks.misses >= o.edge_share * all_looks)
    may_move = moves | (may_move & (looks.changes <= o.edge_constancy * by_chance))
    # Runs of neighbouring beams that may move, on one surface: all of a run does if one of it does (hysteresis: Canny,
    # "A computational approach to edge detection", PAMI 1986).
    with np.errstate(invalid="ignore"):
        begins = first | ~(np.abs(np.diff(ranges, prepend=np.inf)) < o.width)
    begins[1:] |= ~(may_move[1:] & may_move[:-1])
    run = np.cumsum(begins) - 1
    return np.asarray(may_move & (np.bincount(run, weights=moves) > 0)[run])


def usable_ranges(scans: Sequence[LaserScan]) -> Array:
    """Ranges of all scans one after the other; infinite where there is no return, nan where a beam is invalid."""
    parts = [np.where((scan.ranges >= scan.range_min) | np.isnan(scan.ranges), scan.ranges, np.nan) for scan in scans]
    ranges: Array = np.concatenate(parts).astype(np.float64, copy=False)
    return ranges


def moments(timestamps: Array, seconds: float) -> NDArray[np.int32]:
    """Number of the moment that each timestamp ``(N,)``, not decreasing, belongs to: `seconds` of the clock each."""
    return np.asarray(np.floor((timestamps - timestamps[0]) / seconds), dtype=np.int32)
