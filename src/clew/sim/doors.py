"""Doors that open and close while the robot drives by."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from clew.sim.world import Array, World

SWING = 1.2  # seconds from closed to open
#: A door stands open for whoever is within this distance of its middle, metres.
WAY = 2.2
#: Mean seconds for which a door stays as it is; and the share of the time for which it is open if nobody comes.
PAUSE = 20.0
OPEN_SHARE = 0.75
TICK = 0.05  # seconds between samples of a door's motion


def swing(world: World, timestamps: Array, walkers: Array, seed: int) -> Array:
    """How far the doors of a world are open, ``(N, D)`` from 0 (closed) to 1, at timestamps ``(N,)``.

    Each opens and closes at random moments, and stands open for `walkers`, ``(N, P, 2)`` robot and people in metres.
    """
    since = timestamps - timestamps[0]
    clock = np.arange(0.0, since[-1] + TICK, TICK)
    share = np.empty((len(timestamps), len(world.doors)))
    for door, own_seed in enumerate(np.random.SeedSequence(seed).generate_state(len(world.doors))):
        rng = np.random.default_rng(own_seed)
        # Waits in turn: open, closed, open, ...; before the first of them the door was open or closed by chance.
        means = 2.0 * PAUSE * np.array([OPEN_SHARE, 1.0 - OPEN_SHARE])
        if rng.random() > OPEN_SHARE:
            means = means[::-1]
        waits = rng.exponential(1.0, (int(clock[-1] / PAUSE) + 50, 2)) * means
        odd = np.searchsorted(np.cumsum(waits), clock, side="right") % 2 == 1
        opened = odd if means[0] < means[1] else ~odd
        middle = world.doors[door, :2].mean(axis=0)
        near = (np.linalg.norm(walkers - middle, axis=2) < WAY).any(axis=1)
        wanted = opened | (np.interp(clock, since, near) > 0.0)
        moved = uniform_filter1d(wanted.astype(np.float64), max(round(SWING / TICK), 1), mode="nearest")
        share[:, door] = np.interp(since, clock, moved)
    return share


def leaves(doors: Array, share: Array) -> Array:
    """``(N, D, 2, 2)`` segments from hinge to latch of doors ``(D, 3, 2)`` that are `share` ``(N, D)`` open."""
    hinge = doors[:, 0]
    closed, opened = doors[:, 1] - hinge, doors[:, 2] - hinge
    # The latch runs on the circle through both of its ends, a quarter of a turn.
    angle = 0.5 * np.pi * share[..., None]
    latch = hinge + np.cos(angle) * closed + np.sin(angle) * opened
    return np.stack([np.broadcast_to(hinge, latch.shape), latch], axis=2)


def cover(distances: Array, T_world_sensor: Array, angles: Array, segments: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Put segments that move in front of what the beams meet.

    Args:
        distances: ``(N, B)`` metres to the rest of the world.
        T_world_sensor: ``(N, 3)`` poses of the sensor.
        angles: ``(B,)`` directions of the beams in the sensor frame, radians.
        segments: ``(N, D, 2, 2)`` metres.

    Returns:
        ``(N, B)`` metres to the nearer of world and segments, and ``(N, B)`` True where it is a segment.
    """
    heading = T_world_sensor[:, 2:] + angles
    dx, dy = np.cos(heading), np.sin(heading)
    nearest = distances
    for door in range(segments.shape[1]):
        start = segments[:, door, 0] - T_world_sensor[:, :2]
        ex, ey = (segments[:, door, 1] - segments[:, door, 0]).T[..., None]
        rx, ry = start.T[..., None]
        det = dx * ey - dy * ex
        safe = np.where(det == 0.0, np.inf, det)  # seen edge on
        along_segment = (rx * dy - ry * dx) / safe
        along_ray = (rx * ey - ry * ex) / safe
        hit = (det != 0.0) & (along_segment >= 0.0) & (along_segment <= 1.0) & (along_ray > 0.0)
        nearest = np.where(hit, np.minimum(nearest, along_ray), nearest)
    return nearest, nearest < distances
