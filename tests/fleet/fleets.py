"""Small fleets that the tests of this folder share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.fleet import RobotGraph, graphs_of_fleet
from clew.geometry import se2
from clew.sim import FleetModel, MeetingModel, RobotRun, SightingModel, landmark_field, simulate_fleet

Array = NDArray[np.float64]

AREAS = [(0, 0, 30, 30), (10, 5, 40, 30), (5, 0, 35, 25)]
APART = [(0, 0, 25, 30), (55, 0, 80, 30)]


def fleet(seed: int, robots: int = 2, *, identified: float = 0.5, reach: float = 0.0, headings: bool = False,
          duration: float = 120.0, misread: float = 0.0) -> tuple[list[RobotRun], list[RobotGraph]]:
    """Robots in one world of 40 landmarks on 40 x 30 m; they see each other within `reach`."""
    world = landmark_field(40, (40.0, 30.0), seed=seed, identified=identified)
    model = FleetModel(SMALL_ERRORS, SightingModel(misread=misread), MeetingModel(range_max=reach), duration=duration)
    runs = simulate_fleet(world, robots, seed=seed, model=model, areas=AREAS[:robots])
    return runs, graphs_of_fleet(runs, model.sightings, model.meetings if reach else None, headings=headings)


SMALL_ERRORS = FleetModel().odometry


def strangers(seed: int, identified: float = 0.0) -> list[RobotGraph]:
    """Two robots in the two ends of a long world."""
    world = landmark_field(80, (80.0, 30.0), seed=seed, identified=identified)
    model = FleetModel(duration=80.0)
    return graphs_of_fleet(simulate_fleet(world, 2, seed=seed, model=model, areas=APART), model.sightings)


def trajectory_fit(run: RobotRun, poses: Array) -> Array:
    """Pose that takes a true trajectory best to an estimated one ``(N, 3)``."""
    source, target = run.T_world_robot[:, :2], poses[:, :2]
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    theta = np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    return np.array([*(target.mean(axis=0) - se2.act(np.array([0, 0, theta]), source.mean(axis=0))), theta])
