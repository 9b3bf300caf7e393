"""How a robot drives along way points: rounded corners, turns on the spot, bounded accelerations."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from clew.errors import InputError
from clew.geometry import wrap
from clew.sim.world import Array


@dataclass(frozen=True)
class DriveModel:
    """What the robot's drive can do.

    Attributes:
        speed: top speed, m/s.
        acceleration: along the path, m/s^2.
        turn_rate: top rate of turn, rad/s.
        turn_acceleration: of turns on the spot, rad/s^2.
        rounding: standard deviation of the Gaussian that rounds corners, metres along the path.
        turn_round: a corner sharper than this is driven as a stop and a turn on the spot, radians.
    """

    speed: float = 1.2
    acceleration: float = 0.6
    turn_rate: float = 1.0
    turn_acceleration: float = 1.5
    rounding: float = 0.35
    turn_round: float = 2.0


@dataclass(frozen=True, eq=False)
class Drive:
    """A drive sampled in time.

    Attributes:
        timestamps: ``(N,)`` seconds, evenly spaced.
        T_world_robot: ``(N, 3)`` true poses of the robot (x, y, theta), theta in (-pi, pi].
    """

    timestamps: Array
    T_world_robot: Array


STEP = 0.02  # metres between samples of a path
TICK = 0.01  # seconds between samples of a drive


def drive(waypoints: Array, *, rate: float = 5.0, duration: float | None = None, start_time: float = 0.0,
          model: DriveModel | None = None) -> Drive:
    """Drive along way points and sample the true poses.

    Args:
        waypoints: ``(W, 2)`` metres, W >= 2.
        rate: samples a second, Hz.
        duration: seconds after which the drive is cut off; None drives to the end.
        start_time: timestamp of the first sample, seconds.
        model: limits of the drive.

    Raises:
        InputError: fewer than two different way points, or a rate that is not positive.
    """
    points = _without_repeats(np.asarray(waypoints, dtype=np.float64))
    if len(points) < 2:
        raise InputError("drive: needs at least two different way points")
    if not rate > 0.0:
        raise InputError(f"drive: rate of {rate:g} Hz: must be positive")
    model = model or DriveModel()
    times, poses = _pieces(points, model)
    end = times[-1] if duration is None else min(duration, times[-1])
    samples = np.arange(int(np.floor(end * rate + 1e-9)) + 1) / rate
    x, y, heading = (np.interp(samples, times, column) for column in poses.T)
    return Drive(start_time + samples, np.stack([x, y, wrap(heading)], axis=1))


def _without_repeats(points: Array) -> Array:
    if points.ndim != 2 or points.shape[1] != 2 or not np.isfinite(points).all():
        raise InputError(f"drive: way points of shape {points.shape}: must be finite and (W, 2)")
    keep = np.concatenate([[True], np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-6])
    return np.asarray(points[keep])


def _pieces(points: Array, model: DriveModel) -> tuple[Array, Array]:
    """Times ``(n,)`` and poses ``(n, 3)`` with an unwrapped heading, pieces joined by turns on the spot."""
    legs = np.diff(points, axis=0)
    headings = np.arctan2(legs[:, 1], legs[:, 0])
    turns = np.angle(np.exp(1j * np.diff(headings)))
    stops = [0, *(np.flatnonzero(np.abs(turns) > model.turn_round) + 1).tolist(), len(points) - 1]
    times: list[Array] = []
    poses: list[Array] = []
    clock = 0.0
    for first, last in itertools.pairwise(stops):
        piece_times, piece = _path(points[first:last + 1], model)
        if poses:
            before = poses[-1][-1]
            turn = float(np.angle(np.exp(1j * (piece[0, 2] - before[2]))))
            piece[:, 2] += before[2] + turn - piece[0, 2]
            turn_times, angles = _turn(turn, model)
            times.append(clock + turn_times)
            poses.append(np.column_stack([np.tile(before[:2], (len(angles), 1)), before[2] + angles]))
            clock += float(turn_times[-1])
        times.append(clock + piece_times)
        poses.append(piece)
        clock += float(piece_times[-1])
    return np.concatenate(times), np.concatenate(poses)


def _path(points: Array, model: DriveModel) -> tuple[Array, Array]:
    """Times and poses along one piece, from standing to standing."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    count = max(int(np.ceil(along[-1] / STEP)), 4)
    samples = np.linspace(0.0, along[-1], count + 1)
    line = np.stack([np.interp(samples, along, points[:, i]) for i in range(2)], axis=1)
    sigma = model.rounding / (along[-1] / count)
    pad = min(int(np.ceil(4 * sigma)), count)
    # Continued beyond its ends by reflection in the end points, so that these stay where they are.
    longer = np.pad(line, ((pad, pad), (0, 0)), mode="reflect", reflect_type="odd")
    smooth = gaussian_filter1d(longer, sigma, axis=0, truncate=4.0, mode="nearest")[pad:-pad]
    steps = np.linalg.norm(np.diff(smooth, axis=0), axis=1)
    tangent = np.gradient(smooth, axis=0)
    heading = np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))
    turn_per_metre = np.abs(np.gradient(heading)) / np.maximum(np.linalg.norm(tangent, axis=1), 1e-9)
    speed = np.minimum(model.speed, model.turn_rate / np.maximum(turn_per_metre, 1e-9))
    speed[[0, -1]] = 0.0
    speed = _accelerate(_accelerate(speed, steps, model)[::-1], steps[::-1], model)[::-1]
    times = np.concatenate([[0.0], np.cumsum(2 * steps / (speed[1:] + speed[:-1]))])
    # Constant acceleration within each step: a start does not jump to the mean speed of the first step.
    moments = np.append(np.arange(0.0, times[-1], TICK), times[-1])
    step = np.clip(np.searchsorted(times, moments, side="right") - 1, 0, len(steps) - 1)
    since = moments - times[step]
    acceleration = np.diff(speed) / np.diff(times)
    gone = np.concatenate([[0.0], np.cumsum(steps)])
    at = gone[step] + speed[step] * since + 0.5 * acceleration[step] * since ** 2
    columns = (smooth[:, 0], smooth[:, 1], heading)
    return moments, np.column_stack([np.interp(at, gone, column) for column in columns])


def _accelerate(limit: Array, steps: Array, model: DriveModel) -> Array:
    """The fastest speeds below `limit` that the acceleration allows when driving forwards."""
    speed = limit.tolist()
    for i, step in enumerate(steps.tolist()):
        speed[i + 1] = min(speed[i + 1], math.sqrt(speed[i] ** 2 + 2 * model.acceleration * step))
    return np.array(speed)


def _turn(angle: float, model: DriveModel) -> tuple[Array, Array]:
    """Times and angles of a turn on the spot: accelerate, turn, slow down."""
    size = abs(angle)
    ramp = min(model.turn_rate / model.turn_acceleration, np.sqrt(size / model.turn_acceleration))
    rate = ramp * model.turn_acceleration
    total = ramp + (size / rate if rate > 0 else 0.0)
    times = np.linspace(0.0, total, 64)
    speeding = 0.5 * model.turn_acceleration * np.minimum(times, ramp) ** 2
    cruising = rate * np.clip(times - ramp, 0.0, max(total - 2 * ramp, 0.0))
    since = np.clip(times - (total - ramp), 0.0, ramp)
    slowing = rate * since - 0.5 * model.turn_acceleration * since ** 2
    return times, float(np.sign(angle)) * (speeding + cruising + slowing)
