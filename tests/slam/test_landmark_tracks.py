"""Logs of sightings prepared for the graph: what of them is used, and what has no place in it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from clew.errors import InputError
from clew.io import SightingLog, Sightings, Velocities
from clew.io.log import ReadReport
from clew.slam.landmarks.track import make_tracks

Array = NDArray[np.float64]


def sightings(stamps: Array, identity: Array) -> Sightings:
    return Sightings(stamps, identity.astype(np.int64), np.full(len(stamps), 2.0), np.zeros(len(stamps)))


def log_of(robot: int, landmarks: Sightings, robots: Sightings | None = None, last: float = 1e9) -> SightingLog:
    odometry = Velocities(np.array([0.0, last]), np.array([0.1, 0.1]), np.zeros(2))
    none = sightings(np.zeros(0), np.zeros(0))
    return SightingLog(Path(f"robot{robot}"), robot, odometry, landmarks, robots or none, None, ReadReport())


def at_once(moments: int, things: int, first: int, apart: float) -> Sightings:
    """So many things, all seen at each of so many moments."""
    return sightings(np.repeat(apart * np.arange(moments), things), np.tile(first + np.arange(things), moments))


def too_many(seen: Sightings, what: str) -> SightingLog:
    log = log_of(1, at_once(3, 2, 10, 1.0) if what == "mates" else seen)
    return replace(log, robots=seen) if what == "mates" else log


@pytest.mark.parametrize(("fits", "breaks", "what"), [
    (at_once(900_000, 1, 10, 0.1), at_once(900_001, 1, 10, 0.1), "landmarks"),  # keyframes
    (at_once(2, 10, 10, 99_995.0), at_once(2, 10, 10, 100_010.0), "landmarks"),  # scales of odometry, 10 s each
    (at_once(1000, 40, 10, 3.0), at_once(1001, 40, 10, 3.0), "landmarks"),  # views: each ends with a pause
    (at_once(40_000, 1, 2, 2.1), at_once(40_001, 1, 2, 2.1), "mates"),  # views of another robot
], ids=["keyframes", "drift", "views", "mates"])  # fmt: skip
def test_a_log_that_is_too_long_for_its_keys_is_refused(fits: Sightings, breaks: Sightings, what: str) -> None:
    other = log_of(2, at_once(3, 2, 10, 1.0))
    make_tracks([too_many(fits, what), other])
    with pytest.raises(InputError, match=r"robot1: .* keyframes with .* sightings are too many for one graph; cut the"):
        make_tracks([too_many(breaks, what), other])


def test_other_robots_count_while_they_have_odometry() -> None:
    mates = sightings(np.array([-1.0, 0.0, 1.0, 1.0, 2.0, 3.0]), np.array([2, 2, 2, 3, 2, 2]))
    seen = at_once(3, 2, 10, 1.0)
    first, second = make_tracks([log_of(1, seen, mates), log_of(2, seen, last=2.0)])
    assert first.log.robots.timestamp.tolist() == [0.0, 1.0, 2.0]  # 3 is no robot of the fleet
    assert set(first.log.robots.identity.tolist()) == {2}
    assert first.timestamps.min() == second.timestamps.min() == 0.0
    assert first.timestamps.max() == second.timestamps.max() == 2.0
    assert {0.0, 1.0, 2.0} <= set(second.timestamps.tolist())
    alone, = make_tracks([log_of(1, seen, mates)])
    assert len(alone.log.robots) == 0
