"""People who walk through a world and are seen by the laser."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2
from clew.sim.drive import DriveModel, drive
from clew.sim.route import tour
from clew.sim.world import Array, World

RADIUS = 0.2  # metres
#: A person keeps at least this far from the sensor (who would be nearer is left out), metres.
DISTANCE = 0.7
WALKING = DriveModel(speed=1.3, acceleration=1.5, turn_rate=2.5, turn_acceleration=5.0)


def walk(world: World, timestamps: Array, count: int, seed: int) -> Array:
    """``(N, count, 2)`` positions of people at the timestamps ``(N,)``; each walks a tour of its own."""
    span = float(timestamps[-1] - timestamps[0])
    positions = np.empty((len(timestamps), count, 2))
    for person, own_seed in enumerate(np.random.SeedSequence(seed).generate_state(count)):
        rng = np.random.default_rng(own_seed)
        route = tour(world, int(own_seed), WALKING.speed * (span + 300.0))
        walked = drive(route, rate=2.0, model=WALKING)
        # Everybody is somewhere along the tour when the log begins.
        moment = timestamps - timestamps[0] + rng.uniform(0.0, 100.0)
        for axis in range(2):
            positions[:, person, axis] = np.interp(moment, walked.timestamps, walked.T_world_robot[:, axis])
    return positions


def cover(distances: Array, T_world_sensor: Array, angles: Array,
          positions: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Put people in front of what the beams meet.

    Args:
        distances: ``(N, B)`` metres to the static world.
        T_world_sensor: ``(N, 3)`` poses of the sensor.
        angles: ``(B,)`` directions of the beams in the sensor frame, radians.
        positions: ``(N, P, 2)`` people, metres.

    Returns:
        ``(N, B)`` metres to the nearer of world and people, and ``(N, B)`` True where it is a person.
    """
    nearest = distances
    beams = np.stack([np.cos(angles), np.sin(angles)])
    for person in range(positions.shape[1]):
        centre = positions[:, person]
        seen = se2.act(se2.inverse(T_world_sensor), centre)
        along = seen @ beams
        squared = RADIUS ** 2 - (np.sum(seen ** 2, axis=1)[:, None] - along ** 2)
        hit = (squared >= 0.0) & (along > 0.0) & (np.hypot(seen[:, 0], seen[:, 1]) > DISTANCE)[:, None]
        nearest = np.where(hit, np.minimum(nearest, along - np.sqrt(np.maximum(squared, 0.0))), nearest)
    return nearest, nearest < distances
