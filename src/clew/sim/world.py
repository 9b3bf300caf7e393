"""What a simulated world is: walls, and the places that a robot may drive to."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def _no_rooms() -> Indices:
    return np.zeros(0, dtype=np.int64)


def _no_doors() -> Array:
    return np.zeros((0, 3, 2))


@dataclass(frozen=True, eq=False)
class World:
    """A planar world of line segments with a graph of free paths through it.

    Attributes:
        name: short name for reports.
        segments: ``(S, 2, 2)`` end points of walls and furniture, metres.
        places: ``(K, 2)`` points that a robot may drive to, metres.
        links: ``(E, 2)`` pairs of places joined by a straight line that is free for a robot of 0.25 m radius.
        rooms: ``(R,)`` indices of places inside rooms (dead ends where a robot turns round); all others are
            corridors and junctions.
        start: index of the place where a drive begins.
        doors: ``(D, 3, 2)`` doors that can be closed: the hinge, the latch when closed, the latch when open (a quarter
            of a turn apart), metres.
    """

    name: str
    segments: Array
    places: Array
    links: Indices
    rooms: Indices = field(default_factory=_no_rooms)
    start: int = 0
    doors: Array = field(default_factory=_no_doors)


def box(x0: float, y0: float, x1: float, y1: float) -> Array:
    """``(4, 2, 2)`` outline of an axis-aligned rectangle."""
    return polygon(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], dtype=np.float64))


def polygon(corners: Array) -> Array:
    """``(n, 2, 2)`` outline of the polygon with the ``(n, 2)`` corners."""
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


def pillar(x: float, y: float, radius: float, sides: int = 16) -> Array:
    """``(sides, 2, 2)`` outline of a round pillar."""
    angles = 2 * np.pi * np.arange(sides) / sides
    return polygon(np.stack([x + radius * np.cos(angles), y + radius * np.sin(angles)], axis=1))


def wall(start: tuple[float, float], end: tuple[float, float], thickness: float,
         openings: list[tuple[float, float]] | None = None) -> Array:
    """``(4 m, 2, 2)`` outlines of an axis-aligned wall with openings.

    Args:
        start, end: ends of the middle line, ``end`` to the right of or above ``start``, metres; the wall is
            longer by half its thickness at both, so that walls which meet close their corner.
        thickness: metres.
        openings: disjoint ``(from, to)`` along the axis of the wall, in world coordinates, metres.
    """
    level = start[1] == end[1]
    axis = 0 if level else 1
    half = thickness / 2
    cuts = sorted(openings or [])
    begins = [start[axis] - half] + [to for _, to in cuts]
    ends = [since for since, _ in cuts] + [end[axis] + half]
    across = start[1 - axis]
    if level:
        parts = [box(a, across - half, b, across + half) for a, b in zip(begins, ends, strict=True)]
    else:
        parts = [box(across - half, a, across + half, b) for a, b in zip(begins, ends, strict=True)]
    return np.concatenate(parts)


def chain(nodes: list[int]) -> list[tuple[int, int]]:
    """Links between neighbours of a list of places."""
    return list(itertools.pairwise(nodes))
