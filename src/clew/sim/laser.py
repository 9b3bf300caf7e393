"""A simulated planar laser: native ray casting and what a real sensor adds to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from clew import _native
from clew.errors import InputError
from clew.geometry import se2
from clew.sim.world import Array


@dataclass(frozen=True)
class LaserModel:
    """What the laser measures.

    Attributes:
        beams: number of beams.
        field_of_view: angle from the first beam to the last, radians; beams are symmetric about the x axis.
        range_min: what is nearer is not measured, metres.
        range_max: what is further is not measured, metres.
        sigma_range: standard deviation of a range, metres.
        resolution: ranges are rounded to multiples of it, metres; 0 leaves them as they are.
        dropout: probability that a beam comes back without a range.
        T_robot_sensor: pose of the laser on the robot: x, y in metres, theta in radians.
        sweep: seconds from the first beam to the last; the robot moves meanwhile. 0 measures all at one moment.
        interlace: seconds by which every second beam is measured later than that, as in another turn of the mirror.
    """

    beams: int = 361
    field_of_view: float = np.pi
    range_min: float = 0.1
    range_max: float = 30.0
    sigma_range: float = 0.01
    resolution: float = 0.01
    dropout: float = 0.005
    T_robot_sensor: tuple[float, float, float] = (0.1, 0.0, 0.0)
    sweep: float = 0.0
    interlace: float = 0.0

    def __post_init__(self) -> None:
        if self.beams < 2 or not 0.0 < self.field_of_view <= 2 * np.pi:
            raise InputError(f"LaserModel: {self.beams} beams over {self.field_of_view:g} rad: "
                             "needs at least 2 beams and a field of view in (0, 2 pi]")
        if not 0.0 <= self.range_min < self.range_max < np.inf:
            raise InputError(f"LaserModel: ranges from {self.range_min:g} to {self.range_max:g} m: "
                             "needs 0 <= range_min < range_max")
        if not 0.0 <= self.sweep < np.inf:
            raise InputError(f"LaserModel: a sweep of {self.sweep:g} s: must not be negative")
        if not 0.0 <= self.interlace < np.inf:
            raise InputError(f"LaserModel: an interlace of {self.interlace:g} s: must not be negative")
        if self.sigma_range < 0.0 or self.resolution < 0.0 or not 0.0 <= self.dropout <= 1.0:
            raise InputError("LaserModel: sigma_range and resolution must not be negative, "
                             "dropout must be in [0, 1]")

    @property
    def angle_min(self) -> float:
        """Direction of the first beam in the sensor frame, radians."""
        return -self.field_of_view / 2

    @property
    def angle_increment(self) -> float:
        """Angle between neighbouring beams, radians."""
        return self.field_of_view / (self.beams - 1)

    @property
    def time_increment(self) -> float:
        """Seconds from one beam to the next."""
        return self.sweep / (self.beams - 1)

    @property
    def moments(self) -> Array:
        """``(beams,)`` seconds after the timestamp at which each beam is measured."""
        beams = np.arange(self.beams)
        return np.asarray(self.time_increment * beams + self.interlace * (beams % 2), dtype=np.float64)

    @property
    def angles(self) -> Array:
        """``(beams,)`` direction of each beam in the sensor frame, radians."""
        return self.angle_min + self.angle_increment * np.arange(self.beams, dtype=np.float64)

    def measure(self, distances: Array, rng: np.random.Generator) -> Array:
        """Ranges as the sensor reports them: noisy, rounded, ``inf`` where there is no return.

        Args:
            distances: true distances, metres, any shape; ``inf`` where the beam meets nothing.
            rng: source of noise and dropouts.
        """
        ranges = distances + self.sigma_range * rng.standard_normal(distances.shape)
        if self.resolution > 0.0:
            ranges = self.resolution * np.round(ranges / self.resolution)
        lost = rng.random(distances.shape) < self.dropout
        seen = (ranges >= self.range_min) & (ranges < self.range_max) & ~lost
        return np.where(seen, ranges, np.inf)


def cast_rays(segments: Array, T_world_sensor: Array, angles: Array, reach: float = np.inf) -> Array:
    """True distances from a sensor to the nearest segment.

    A segment that is seen edge on (parallel to the ray) or has no length is not hit; a sensor that stands on
    a segment measures 0.

    Args:
        segments: ``(S, 2, 2)`` end points, metres.
        T_world_sensor: ``(N, 3)`` poses of the sensor.
        angles: ``(B,)`` directions of the beams in the sensor frame, radians.
        reach: hits at this distance or further count as none, metres.

    Returns:
        ``(N, B)`` distances, metres, ``inf`` for no hit.

    Raises:
        InputError: wrong shapes, values that are not finite, or a negative reach.
    """
    arrays = [np.ascontiguousarray(a, dtype=np.float64) for a in (segments, T_world_sensor, angles)]
    if arrays[0].shape[1:] != (2, 2) or arrays[1].shape[1:] != (3,) or arrays[2].ndim != 1:
        raise InputError(f"cast_rays: segments {arrays[0].shape}, poses {arrays[1].shape}, "
                         f"angles {arrays[2].shape}: must be (S, 2, 2), (N, 3) and (B,)")
    if not all(np.isfinite(a).all() for a in arrays) or not reach >= 0.0:
        raise InputError("cast_rays: segments, poses and angles must be finite, the reach not negative")
    distances = np.empty((arrays[1].shape[0], arrays[2].shape[0]))
    _native.sim.cast_rays(arrays[0], arrays[1], arrays[2], reach, distances)
    return distances


def sensor_poses(T_world_robot: Array, laser: LaserModel) -> Array:
    """``(N, 3)`` poses of the laser for ``(N, 3)`` poses of the robot."""
    return se2.compose(T_world_robot, np.array(laser.T_robot_sensor))
