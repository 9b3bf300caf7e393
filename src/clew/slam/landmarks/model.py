"""What is to be found out about a robot's odometry and camera: calibration and noise."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from clew.motion import VelocityNoise

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Calibration:
    """Deviations of a robot's odometry and camera from what they claim, all of them zero at first.

    The whole map can be scaled together with speeds and ranges, so one of the two has to be believed: the ranges, on
    the average over all sightings, whatever their bearing and range; see `SCALE_UNCERTAINTY`.

    Attributes:
        speed_scale, turn_scale: share by which the robot is faster, and turns faster, than the odometry says.
        turn_bias: radians a second that it turns while it drives straight on.
        delay: seconds by which the motion lags behind the odometry's time stamps.
        range_scale: share by which this camera's ranges are too long on the average.
        range_offset: metres that are added to every range, beside what that changes on the average.
        range_slope, range_curve: how the share by which ranges are too long changes with the bearing and its square,
            1/radian, 1/radian^2.
        bearing_offset: radians by which bearings are too large: the camera's mounting.
        bearing_slope, bearing_curve, bearing_cube: how that changes with the bearing, its square and its cube.
        forward, left: metres that the camera is ahead of the robot's centre of motion, and to the left of it.
    """

    speed_scale: float = 0.0
    turn_scale: float = 0.0
    turn_bias: float = 0.0
    delay: float = 0.0
    range_scale: float = 0.0
    range_offset: float = 0.0
    range_slope: float = 0.0
    range_curve: float = 0.0
    bearing_offset: float = 0.0
    bearing_slope: float = 0.0
    bearing_curve: float = 0.0
    bearing_cube: float = 0.0
    forward: float = 0.0
    left: float = 0.0

    @property
    def points(self) -> Array:
        """``(7, 2)`` the values as they are in the graph, two a variable."""
        return np.array(list(asdict(self).values())).reshape(7, 2)

    @classmethod
    def from_points(cls, points: Array) -> Calibration:
        """From ``(7, 2)`` values."""
        return cls(*points.reshape(-1).tolist())


_NEGLIGIBLE = 0.01  # deviations below do not matter beside the others

#: Standard deviation of the scale of the ranges. Nothing in the data tells it; covariances of results include it.
SCALE_UNCERTAINTY = 0.01

#: Deviations that are to be expected, in the order of the fields; wide but for the scale of the ranges.
PRIOR = Calibration(0.2, 0.2, 0.02, 0.2, 0.01, 0.1, 0.3, 0.5, 0.1, 0.1, 0.1, 0.2, 0.05, 0.05)


@dataclass(frozen=True)
class SightingNoise:
    """Errors of sightings: each one's own, which follow Student's t distribution, and those of a view.

    What disturbs a sighting disturbs the next ones of the same thing likewise, as long as it is seen from much the same
    place; so each view has a bias of its own. A camera that reads a range from how large something appears has errors
    that grow with its square; `growth` says how soon, if at all, and is found from the data like all others.

    Attributes:
        range: scale of the errors of ranges, metres; of those near by.
        bearing: scale of the errors of bearings, radians.
        range_bias: standard deviation, over views, of what is common to the ranges of a view, metres.
        bearing_bias: the same for bearings, radians.
        growth: errors and biases of ranges are larger at a range r by ``sqrt(1 + (growth r^2)^2)``, 1/metre^2.
    """

    range: float = 0.2
    bearing: float = 0.03
    range_bias: float = 0.02
    bearing_bias: float = 0.005
    growth: float = 0.02

    def larger(self, distance: Array) -> Array:
        """By what the errors of ranges are larger at some distance, ``(...)``."""
        grown: Array = np.hypot(1.0, self.growth * distance**2)
        return grown


@dataclass(frozen=True)
class MarkNoise:
    """How much marks differ from each other, to whoever sees them and however often: errors that no mean takes out.

    Attributes:
        share: deviation of the share by which a mark looks too far: printed too small, or on a crooked pole.
        turn: deviation of what is added to all bearings of a mark, radians.
    """

    share: float = 0.003
    turn: float = 0.002

    def change(self, other: MarkNoise) -> float:
        """Largest change of a parameter from this model to another, as a share."""
        return _change([(getattr(self, f.name), getattr(other, f.name)) for f in fields(self)])


@dataclass(frozen=True)
class Marks:
    """How much the marks of landmarks differ, and those that robots carry.

    Attributes:
        landmarks, robots: see `MarkNoise`.
    """

    landmarks: MarkNoise = MarkNoise()
    robots: MarkNoise = field(default_factory=MarkNoise)

    def change(self, other: Marks) -> float:
        """Largest change of a parameter of the landmarks' from these to others, as a share."""
        return self.landmarks.change(other.landmarks)


@dataclass(frozen=True)
class ScaleDrift:
    """How much the scales of the odometry differ from one while to the next: load, ground, and wheels that slip.

    Attributes:
        speed: deviation of the scale of speeds.
        turn: deviation of the scale of turn rates.
    """

    speed: float = 0.03
    turn: float = 0.05


@dataclass(frozen=True, eq=False)
class SensorModel:
    """A robot's calibration and noise.

    Attributes:
        calibration: see `Calibration`.
        motion: random walk of the odometry.
        drift: of the scales in the calibration.
        landmarks: noise of sightings of landmarks.
        robots: noise of sightings of other robots.
        pull: ``(7, 2)`` by what the points of the calibration are drawn, see `clew.slam.landmarks.pull`.
    """

    calibration: Calibration = Calibration()
    motion: VelocityNoise = field(default_factory=lambda: VelocityNoise(0.1, 0.05, 0.1, 0.2, 0.003, 0.003))
    drift: ScaleDrift = ScaleDrift()
    landmarks: SightingNoise = SightingNoise()
    robots: SightingNoise = field(default_factory=SightingNoise)
    pull: Array = field(default_factory=lambda: np.zeros((7, 2)))

    def to_dict(self) -> dict[str, dict[str, float]]:
        """Plain numbers."""
        return {f.name: asdict(getattr(self, f.name)) for f in fields(self) if f.name != "pull"}

    def change(self, other: SensorModel) -> float:
        """Largest change of a noise parameter from this model to another, as a share."""
        pairs = [
            (getattr(mine, f.name), getattr(its, f.name))
            for mine, its in ((self.motion, other.motion), (self.drift, other.drift), (self.landmarks, other.landmarks))
            for f in fields(mine)
        ]
        return _change(pairs)


def _change(pairs: list[tuple[float, float]]) -> float:
    return max(float(abs(b - a) / max(a, b, _NEGLIGIBLE)) for a, b in pairs)
