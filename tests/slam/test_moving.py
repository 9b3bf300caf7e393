"""Things that move: left out of what keyframes are refined against."""

from __future__ import annotations

from functools import cache

import numpy as np

from clew.sim import LaserModel, OdometryModel, SimulatedLog, drive, hall, simulate, tour
from clew.slam import Slam
from slam.drives import mapped

LASER = LaserModel(beams=181, resolution=0.001)


@cache
def crowd() -> tuple[SimulatedLog, Slam]:
    """A minute in a hall with sixty people, not refined."""
    world = hall(4, width=24.0, depth=18.0, pillars=8)
    log = simulate(world, drive(tour(world, 4, 70.0), rate=4.0, duration=60.0), LASER, OdometryModel.medium(), 4,
                   people=60)
    return log, mapped(log)


def test_people_are_left_out_of_refinement_and_the_building_stays() -> None:
    log, slam = crowd()
    scans = np.searchsorted(log.timestamps, slam.keyframes.timestamps)
    moving, returned = log.moving[scans], np.isfinite(log.ranges[scans])
    whole = np.array([len(points) for points in slam.keyframe_points])
    still = np.array([len(points) for points in slam._still_returns()])
    assert moving.sum() > 0.05 * returned.sum()
    left_out = whole - still
    assert np.all(left_out >= 0)
    assert abs(left_out.sum() - moving.sum()) < 0.3 * moving.sum()
    crowded = moving.sum(axis=1) > 0.2 * returned.sum(axis=1)
    assert left_out[crowded].min() > 0.1 * whole[crowded].min()
    calm = ~moving.any(axis=1)
    assert left_out[calm].sum() <= 0.005 * whole[calm].sum()
