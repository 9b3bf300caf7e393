"""One robot's log, prepared for the graph: keyframes, keys and factors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.factors import CalibratedBearing, CalibratedRange, PreintegratedMotion
from clew.geometry import Point2, se2, wrap
from clew.io import SightingLog, Sightings
from clew.motion import Pieces, Preintegrated, cut, preintegrate, velocity_motion
from clew.noise import Cauchy
from clew.slam.landmarks.model import Calibration, SensorModel, SightingNoise

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Robot ``n`` has the pose keys ``n * KEYS_A_ROBOT + i``; landmarks have their identity as key.
KEYS_A_ROBOT = 1_000_000
#: Keys of what sets marks apart: of landmarks by their identity, of robots, which have marks too, after all of those.
_MARK_KEYS = KEYS_A_ROBOT**2
_CALIBRATION_KEYS, _DRIFT_KEYS, _VIEW_KEYS, _MATE_VIEW_KEYS = 900_000, 910_000, 920_000, 960_000
_LONGEST_VIEW, _LONGEST_PAUSE = 10.0, 2.0  # seconds of a view, and between its sightings
_WHILE = 10.0  # seconds that the scales of the odometry stay as they are
_LONGEST_STRETCH = 0.5  # seconds between keyframes
#: Degrees of freedom of Student's t distribution: heavy tails, but with a variance.
TAIL = 4.0


@dataclass(frozen=True, eq=False)
class RobotTrack:
    """A robot's log on its keyframes.

    Attributes:
        log: what the robot recorded.
        timestamps: ``(N,)`` of the keyframes, seconds.
        means: ``(4,)`` averages of the bearing, its square, its cube and the inverse range over the sightings, each
            weighed with its range; `Calibration` counts from them.
    """

    log: SightingLog
    timestamps: Array
    means: Array

    @property
    def keys(self) -> Indices:
        """``(N,)`` keys of the keyframes' poses."""
        return self.log.robot * KEYS_A_ROBOT + np.arange(len(self.timestamps))

    @property
    def calibration_keys(self) -> list[int]:
        """Keys of the seven points of parameters of `Calibration.points`."""
        return [self.log.robot * KEYS_A_ROBOT + _CALIBRATION_KEYS + k for k in range(7)]

    @property
    def drift_keys(self) -> Indices:
        """``(S,)`` keys of the deviation of the odometry's scales, for each motion between keyframes."""
        passed = self.timestamps[:-1] - self.timestamps[0]
        keys: Indices = self.log.robot * KEYS_A_ROBOT + _DRIFT_KEYS + (passed / _WHILE).astype(np.int64)
        return keys

    def view_keys(self, seen: Sightings) -> Indices:
        """``(K,)`` keys of the biases of the views that sightings belong to; sightings of landmarks or of robots."""
        first = _MATE_VIEW_KEYS if seen is self.log.robots else _VIEW_KEYS
        return self.log.robot * KEYS_A_ROBOT + first + _views(seen)

    def mark_keys(self, seen: Sightings) -> Indices:
        """``(K,)`` keys of what sets the marks apart that sightings are of; landmarks' or robots'."""
        first = _MARK_KEYS + KEYS_A_ROBOT if seen is self.log.robots else _MARK_KEYS
        keys: Indices = first + seen.identity
        return keys

    def view_deviations(self, seen: Sightings, noise: SightingNoise) -> tuple[Indices, Array]:
        """Keys ``(V,)`` of the biases of all views, and their deviations ``(V, 2)``: of ranges and of bearings."""
        keys, view = np.unique(self.view_keys(seen), return_inverse=True)
        distance = np.bincount(view, seen.range) / np.bincount(view)
        ranges = noise.range_bias * noise.larger(distance)
        return keys, np.stack([ranges, np.full(len(keys), noise.bearing_bias)], axis=1)

    def until(self, timestamp: float) -> RobotTrack:
        """The part up to a time."""
        seen = self.log.landmarks
        log = SightingLog(
            self.log.path, self.log.robot, self.log.odometry, seen.take(seen.timestamp <= timestamp),
            self.log.robots.take(self.log.robots.timestamp <= timestamp), self.log.truth, self.log.report,
        )  # fmt: skip
        return RobotTrack(log, self.timestamps[self.timestamps <= timestamp], self.means)

    def rows(self, seen: Sightings) -> Indices:
        """Keyframe ``(K,)`` of each sighting."""
        return np.searchsorted(self.timestamps, seen.timestamp)

    def range_basis(self, seen: Sightings) -> Array:
        """``f_1``, ``f_2`` and ``f_3`` ``(K, 3)`` of `clew.factors.CalibratedRange`."""
        offsets = _powers(seen.bearing)[:, :2] - self.means[:2]
        return np.column_stack([offsets, np.full(len(seen), self.means[3])])

    def corrected(self, seen: Sightings, calibration: Calibration) -> tuple[Array, Array]:
        """Range and bearing ``(K,)`` from the camera that a perfect one would have measured."""
        c, (f1, f2, f3) = calibration, self.range_basis(seen).T
        stretch = 1.0 + c.range_scale + c.range_slope * f1 + c.range_curve * f2 - c.range_offset * f3
        weights = np.array([c.bearing_slope, c.bearing_curve, c.bearing_cube])
        bearing = seen.bearing
        for _ in range(3):  # Newton's method; the distortion is mild
            moved = bearing + c.bearing_offset + (_powers(bearing) - self.means[:3]) @ weights
            slope = 1.0 + np.stack([np.ones(len(seen)), 2.0 * bearing, 3.0 * bearing**2], axis=1) @ weights
            bearing = bearing - (moved - seen.bearing) / slope
        return (seen.range - c.range_offset) / stretch, wrap(bearing)

    def points(self, seen: Sightings, calibration: Calibration) -> Array:
        """What was seen ``(K, 2)``, in the frame of the robot at the time."""
        distance, bearing = self.corrected(seen, calibration)
        rays = np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
        seen_from_robot: Array = distance[:, None] * rays + [calibration.forward, calibration.left]
        return seen_from_robot

    def _controls(self, model: SensorModel) -> tuple[Pieces, Array, Array]:
        """Pieces of the odometry between keyframes, and its speed and turn rate ``(N,)`` in each, as they were read."""
        pieces = cut(self.log.odometry.timestamp + model.calibration.delay, self.timestamps)
        known = pieces.reading >= 0
        speed = np.where(known, self.log.odometry.speed[pieces.reading], 0.0)
        return pieces, speed, np.where(known, self.log.odometry.turn_rate[pieces.reading], 0.0)

    def motions(self, model: SensorModel) -> Array:
        """Motions ``(S, 3)`` between keyframes, without anything else that `motion` gives."""
        pieces, speed, turn_rate = self._controls(model)
        v, w, _ = _corrected(speed, turn_rate, model.calibration)
        steps = velocity_motion(pieces.duration, v, w, model.motion)
        return preintegrate(steps.increment, pieces.first).motion

    def motion(self, model: SensorModel) -> tuple[Preintegrated, Array, Array]:
        """Motions between keyframes, derivative ``(S, 3, 4)`` by the first four parameters, and covariance by source.

        The covariances ``(6, S, 3, 3)`` are in the order of the fields of `VelocityNoise`.
        """
        pieces, speed, turn_rate = self._controls(model)
        v, w, moving = _corrected(speed, turn_rate, model.calibration)
        steps = velocity_motion(pieces.duration, v, w, model.motion)
        whole = preintegrate(steps.increment, pieces.first)
        by_control = steps.by_control
        inner = np.stack(
            [by_control[:, :, 0] * speed[:, None], by_control[:, :, 1] * turn_rate[:, None],
             by_control[:, :, 1] * moving[:, None]], axis=2,
        )  # fmt: skip
        # A later delay cuts off motion at the end of a stretch and adds some at its begin.
        twist = np.stack([v, np.zeros_like(v), w], axis=1)
        last = np.append(pieces.first[1:], len(v)) - 1
        back = se2.adjoint(se2.inverse(whole.motion))
        by_delay = (back @ twist[pieces.first][:, :, None])[:, :, 0] - twist[last]
        by_parameter = np.concatenate([whole.jacobian(inner), by_delay[:, :, None]], axis=2)
        sources = model.motion.components(pieces.duration, v, w)
        return whole, by_parameter, whole.diagonal_covariance(np.einsum("knii->kni", sources))

    def motion_factor(self, model: SensorModel) -> tuple[PreintegratedMotion, Array]:
        """The factor of all motions, and the covariance by source as in `motion`."""
        whole, by_parameter, sources = self.motion(model)
        keys = self.keys
        covariance = sources.sum(axis=0) + 1e-10 * np.eye(3)  # a robot that stands still has moved by a hair
        first, second, *_ = self.calibration_keys
        reference = np.append(model.calibration.points[:2], [0.0, 0.0])
        factor = PreintegratedMotion(
            keys[:-1], keys[1:], (first, second, self.drift_keys), whole.motion,
            np.concatenate([by_parameter, by_parameter[:, :, :2]], axis=2), reference, unit=0, covariance=covariance,
        )  # fmt: skip
        return factor, sources

    def sighting_factors(
        self, seen: Sightings, target: Indices, noise: SightingNoise, sees: type[Any] = Point2
    ) -> tuple[CalibratedRange, CalibratedBearing]:
        """Factors of ranges and of bearings to targets with the given ``(K,)`` keys.

        Student's t distribution is a robust kernel: ``-2 log p = c^2 log(1 + e^2 / (n sigma^2))`` up to a constant,
        with ``c^2 = n + 1``.
        """
        keys, parameters = self.keys[self.rows(seen)], self.calibration_keys
        own = (self.view_keys(seen), self.mark_keys(seen), parameters[6])

        def likelihood(scale: Array) -> dict[str, Any]:
            sigmas = (scale * np.sqrt(TAIL / (TAIL + 1.0)))[:, None]
            return {"sigmas": sigmas, "kernel": Cauchy(np.sqrt(TAIL + 1.0)), "sees": sees}

        ranges = CalibratedRange(
            keys, target, (parameters[2], parameters[3], *own), seen.range, self.range_basis(seen),
            **likelihood(noise.range * noise.larger(seen.range)),
        )  # fmt: skip
        bearings = CalibratedBearing(
            keys, target, (parameters[4], parameters[5], *own), seen.bearing, self.means[:3],
            **likelihood(np.full(len(seen), noise.bearing)),
        )  # fmt: skip
        return ranges, bearings


def _corrected(speed: Array, turn_rate: Array, calibration: Calibration) -> tuple[Array, Array, Array]:
    """Speed and turn rate as they truly were, and 1 where the robot moved, 0 where it stood."""
    moving = ((speed != 0.0) | (turn_rate != 0.0)).astype(np.float64)
    turned = (1.0 + calibration.turn_scale) * turn_rate + calibration.turn_bias * moving
    return (1.0 + calibration.speed_scale) * speed, turned, moving


def make_tracks(logs: Sequence[SightingLog]) -> tuple[RobotTrack, ...]:
    """Keyframes where something was seen, and in between such that no stretch is longer than half a second.

    A robot that is seen by another of the logs gets a keyframe then, too; sightings of robots that are not among
    the logs, or that have no odometry at that time, are left out.

    Raises:
        InputError: two logs of one robot, a robot's number or a landmark's that has no key, or fewer than two
            moments with sightings.
    """
    numbers = [log.robot for log in logs]
    if len(set(numbers)) < len(numbers):
        raise InputError(f"robots {numbers}: each may occur once")
    highest = max([*numbers, *(int(log.landmarks.identity.max(initial=0)) for log in logs)])
    if highest >= KEYS_A_ROBOT or min(numbers) < 1:
        raise InputError(f"numbers of robots and landmarks must be from 1 to {KEYS_A_ROBOT - 1}, got "
                         f"{min(numbers) if min(numbers) < 1 else highest}")
    ends = {log.robot: log.odometry.timestamp[[0, -1]] for log in logs}
    mates = {log.robot: _usable(log.robots, ends) for log in logs}
    tracks = tuple(_make_track(log, mates) for log in logs)
    for track in tracks:
        _check_keys(track)
    return tracks


def _check_keys(track: RobotTrack) -> None:
    """Each kind of variable of a robot has a range of keys of its own."""
    log, first = track.log, track.log.robot * KEYS_A_ROBOT
    ranges = ((track.keys, _CALIBRATION_KEYS), (track.drift_keys, _VIEW_KEYS),
              (track.view_keys(log.landmarks), _MATE_VIEW_KEYS), (track.view_keys(log.robots), KEYS_A_ROBOT))
    if any(keys.max(initial=0) >= first + end for keys, end in ranges):
        raise InputError(f"{log.path}: {len(track.timestamps)} keyframes with {len(log.landmarks)} sightings are too "
                         "many for one graph; cut the log")


def _usable(seen: Sightings, ends: Mapping[int, Array]) -> Sightings:
    good = np.zeros(len(seen), bool)
    for robot, (begin, end) in ends.items():
        good |= (seen.identity == robot) & (seen.timestamp >= begin) & (seen.timestamp <= end)
    return seen.take(good)


def _make_track(log: SightingLog, mates: Mapping[int, Sightings]) -> RobotTrack:
    own, seen = mates[log.robot], log.landmarks
    log = SightingLog(log.path, log.robot, log.odometry, seen, own, log.truth, log.report)
    by_others = [other.timestamp[other.identity == log.robot] for other in mates.values()]
    stamps = np.unique(np.concatenate([seen.timestamp, own.timestamp, *by_others]))
    if len(stamps) < 2:
        raise InputError(
            f"{log.path}: robot {log.robot} saw something at {len(stamps)} moments only; there is no map in that"
        )
    parts = np.maximum(np.ceil(np.diff(stamps) / _LONGEST_STRETCH), 1).astype(np.int64)
    start = np.repeat(np.arange(len(parts)), parts)
    share = (np.arange(len(start)) - np.repeat(np.cumsum(parts) - parts, parts)) / parts[start]
    frames = np.append(stamps[start] + share * np.diff(stamps)[start], stamps[-1])
    # times of sightings must be found again exactly
    frames[np.append(np.cumsum(parts) - parts, len(start))] = stamps
    weight = seen.range / seen.range.sum()
    means = np.append(weight @ _powers(seen.bearing), len(seen) / seen.range.sum())
    return RobotTrack(log, np.unique(frames), means)


def _views(seen: Sightings) -> Indices:
    """Number ``(K,)`` of the view of each sighting: of one thing, without a long pause, and not too long."""
    order = np.lexsort((seen.timestamp, seen.identity))
    identity, stamp = seen.identity[order], seen.timestamp[order]
    begins = np.append(True, (np.diff(identity) != 0) | (np.diff(stamp) > _LONGEST_PAUSE))[: len(order)]
    run = np.cumsum(begins) - 1
    part = ((stamp - stamp[begins][run]) / _LONGEST_VIEW).astype(np.int64)
    split = np.append(True, (np.diff(run) != 0) | (np.diff(part) != 0))[: len(order)]
    out = np.empty(len(order), np.int64)
    out[order] = np.cumsum(split) - 1
    return out


def _powers(bearing: Array) -> Array:
    return np.stack([bearing, bearing**2, bearing**3], axis=1)


def keys_of(tracks: Sequence[RobotTrack], robot: Indices, timestamps: Array) -> Indices:
    """Keys ``(K,)`` of the poses of given robots at given times of their keyframes."""
    keys = np.full(len(robot), -1, np.int64)
    for track in tracks:
        mine = robot == track.log.robot
        keys[mine] = track.keys[np.searchsorted(track.timestamps, timestamps[mine])]
    return keys

