"""Several robots in a world of landmarks: what each measures, itself, the landmarks and one another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.geometry import se2, wrap
from clew.sim.drive import drive
from clew.sim.landmarks import LandmarkWorld, SightingModel, Sightings, see_landmarks
from clew.sim.odometry import OdometryModel
from clew.sim.world import Array, Indices


@dataclass(frozen=True)
class MeetingModel:
    """How robots see one another.

    Attributes:
        range_max: metres; 0 for robots that do not.
        sigma_range, sigma_bearing, sigma_heading: standard deviations, metres and radians.
        missed: probability that a robot in reach is not seen.
    """

    range_max: float = 0.0
    sigma_range: float = 0.05
    sigma_bearing: float = np.radians(1.0)
    sigma_heading: float = np.radians(3.0)
    missed: float = 0.5


@dataclass(frozen=True, eq=False)
class Meetings:
    """``K`` sightings of other robots, all in the same instant on both clocks.

    Attributes:
        poses: ``(K,)`` index of the pose of the one who sees.
        others: ``(K,)`` index of the robot that is seen.
        other_poses: ``(K,)`` index of its pose.
        ranges: ``(K,)`` metres; bearings: ``(K,)`` radians; headings: ``(K,)`` of the other robot as seen from
            this one, radians.
    """

    poses: Indices
    others: Indices
    other_poses: Indices
    ranges: Array
    bearings: Array
    headings: Array


@dataclass(frozen=True, eq=False)
class RobotRun:
    """What one robot measured, and the truth.

    Attributes:
        T_world_robot: ``(N, 3)`` true poses.
        increments: ``(N - 1, 3)`` odometry from each pose to the next, in the frame of the former.
        covariances: ``(N - 1, 3, 3)`` of the increments, in the tangent at their end.
        sightings: of landmarks.
        meetings: with other robots.
    """

    T_world_robot: Array
    increments: Array
    covariances: Array
    sightings: Sightings
    meetings: Meetings

    @property
    def T_odom_robot(self) -> Array:
        """``(N, 3)`` dead reckoning from the identity."""
        poses = [np.zeros(3)]
        for increment in self.increments:
            poses.append(se2.compose(poses[-1], increment))
        return np.stack(poses)


@dataclass(frozen=True)
class FleetModel:
    """What the robots of a fleet can do.

    Attributes:
        odometry: errors of dead reckoning; without systematic ones, covariances are exact.
        sightings: of landmarks.
        meetings: of other robots.
        rate: poses a second, Hz.
        duration: seconds of driving at most.
    """

    odometry: OdometryModel = field(default_factory=lambda: OdometryModel(
        sigma_distance=0.02, sigma_side=0.01, sigma_turn=0.02, sigma_drift=0.008))
    sightings: SightingModel = field(default_factory=SightingModel)
    meetings: MeetingModel = field(default_factory=MeetingModel)
    rate: float = 1.0
    duration: float = 120.0


def simulate_fleet(world: LandmarkWorld, robots: int, *, seed: int, model: FleetModel | None = None,
                   areas: Sequence[tuple[float, float, float, float]] | None = None) -> list[RobotRun]:
    """Let robots wander about at random.

    Args:
        world: landmarks.
        robots: how many.
        seed: of everything; each robot has streams of its own.
        model: what the robots can do.
        areas: ``x0, y0, x1, y1`` for each robot, where it stays; the whole field unless given.

    Raises:
        InputError: not one area a robot.
    """
    model = model or FleetModel()
    if areas is None:
        areas = [(0.0, 0.0, float(world.size[0]), float(world.size[1]))] * robots
    if len(areas) != robots:
        raise InputError(f"simulate_fleet: {len(areas)} areas for {robots} robots; give one a robot")
    streams = np.random.SeedSequence(seed).spawn(3 * robots)
    truths = [_wander(area, model, np.random.default_rng(s)) for area, s in zip(areas, streams, strict=False)]
    runs = []
    for robot, poses in enumerate(truths):
        rng, of_meetings = (np.random.default_rng(s) for s in streams[robots + 2 * robot : robots + 2 * robot + 2])
        steps = se2.between(poses[:-1], poses[1:])
        increments = model.odometry.perturb(steps, rng)
        runs.append(RobotRun(
            poses, increments, step_covariances(model.odometry, increments),
            see_landmarks(world, poses, model.sightings, rng),
            _meet(truths, robot, model.meetings, of_meetings),
        ))  # fmt: skip
    return runs


def step_covariances(model: OdometryModel, increments: Array, floor: float = 1e-3) -> Array:
    """Covariances ``(M, 3, 3)`` of reported steps ``(M, 3)``, in the tangent at their end; `floor` in m and rad."""
    distance, turn = np.hypot(increments[:, 0], increments[:, 1]), np.abs(increments[:, 2])
    variances = np.stack([
        model.sigma_distance**2 * distance,
        model.sigma_side**2 * distance,
        model.sigma_turn**2 * turn + model.sigma_drift**2 * distance,
    ], axis=1) + floor**2  # fmt: skip
    # The noise is in the frame at the start of the step, the tangent in the frame at its end.
    c, s = np.cos(increments[:, 2]), np.sin(increments[:, 2])
    rotation_t = np.zeros((len(increments), 3, 3))
    rotation_t[:, 0, 0] = rotation_t[:, 1, 1] = c
    rotation_t[:, 0, 1], rotation_t[:, 1, 0] = s, -s
    rotation_t[:, 2, 2] = 1.0
    return np.asarray(rotation_t * variances[:, None, :] @ np.swapaxes(rotation_t, 1, 2))


def _wander(area: tuple[float, float, float, float], model: FleetModel, rng: np.random.Generator) -> Array:
    """``(N, 3)`` true poses of a drive between random places of an area."""
    low, high = np.array(area[:2]), np.array(area[2:])
    places = low + rng.random((max(4, int(model.duration / 4)), 2)) * (high - low)
    return drive(places, rate=model.rate, duration=model.duration).T_world_robot


def _meet(truths: list[Array], robot: int, model: MeetingModel, rng: np.random.Generator) -> Meetings:
    columns: list[list[NDArray[Any]]] = []
    for other in range(len(truths)):
        together = min(len(truths[robot]), len(truths[other]))
        relative = se2.between(truths[robot][:together], truths[other][:together])
        distance = np.hypot(relative[:, 0], relative[:, 1])
        seen = (distance < model.range_max) & (rng.random(together) >= model.missed) & (other != robot)
        at, noise = np.flatnonzero(seen), rng.standard_normal((seen.sum(), 3))
        direction = np.arctan2(relative[at, 1], relative[at, 0])
        columns.append([
            at, np.full(len(at), other),
            np.maximum(distance[at] + model.sigma_range * noise[:, 0], 1e-3),
            wrap(direction + model.sigma_bearing * noise[:, 1]),
            wrap(relative[at, 2] + model.sigma_heading * noise[:, 2]),
        ])  # fmt: skip
    poses, others, ranges, bearings, headings = (np.concatenate(c) for c in zip(*columns, strict=True))
    return Meetings(poses.astype(np.int64), others.astype(np.int64), poses.astype(np.int64), ranges, bearings, headings)
