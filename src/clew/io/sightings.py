"""What a robot that recognises landmarks records."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from clew.io.log import ReadReport

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Velocities:
    """Speeds as the odometry gives them; each holds until the next one.

    Attributes:
        timestamp: ``(M,)`` seconds, increasing.
        speed: ``(M,)`` metres a second, forward.
        turn_rate: ``(M,)`` radians a second, counter-clockwise.
    """

    timestamp: Array
    speed: Array
    turn_rate: Array

    def __len__(self) -> int:
        return len(self.timestamp)


@dataclass(frozen=True, eq=False)
class Sightings:
    """Things that were seen and recognised.

    Attributes:
        timestamp: ``(K,)`` seconds, in order.
        identity: ``(K,)`` what was seen: the number of a landmark or of a robot.
        range: ``(K,)`` metres.
        bearing: ``(K,)`` radians, counter-clockwise from straight ahead.
    """

    timestamp: Array
    identity: Indices
    range: Array
    bearing: Array

    def __len__(self) -> int:
        return len(self.timestamp)

    def take(self, rows: NDArray[np.bool_] | Indices) -> Sightings:
        """Some of them."""
        return Sightings(self.timestamp[rows], self.identity[rows], self.range[rows], self.bearing[rows])


@dataclass(frozen=True, eq=False)
class SightingLog:
    """The log of one robot.

    Attributes:
        path: folder that it came from.
        robot: number of the robot, which is also its identity when others see it.
        odometry: its speeds.
        landmarks: sightings of landmarks.
        robots: sightings of other robots.
        truth: ``(G, 4)`` true time, x, y, theta, or None.
        report: what was read, and what was left out.
    """

    path: Path
    robot: int
    odometry: Velocities
    landmarks: Sightings
    robots: Sightings
    truth: Array | None
    report: ReadReport


@dataclass(frozen=True, eq=False)
class SurveyedLandmarks:
    """Where landmarks truly are; for evaluation only.

    Attributes:
        identity: ``(L,)`` numbers.
        position: ``(L, 2)`` metres.
    """

    identity: Indices
    position: Array
