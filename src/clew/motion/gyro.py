"""A gyro takes over the rotation; its bias and scale are left to the graph."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.errors import InputError
from clew.motion.integrate import cut, preintegrate
from clew.motion.step import read_controls
from clew.motion.velocity import VelocityNoise, velocity_motion

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class GyroMotion:
    """Motions between keyframes from a gyro and the wheels' speed, as `clew.PreintegratedMotion` takes them.

    Attributes:
        motion: ``(S, 3)`` later keyframe seen from the earlier one, at the reference.
        by_parameter: ``(S, 3, 2)`` its derivative by ``(bias, scale)`` in the tangent at its end.
        covariance: ``(S, 3, 3)`` in the same tangent, for known parameters.
        reference: ``(2,)`` the bias, radians a second, and the share by which rates are too large, at which it was
            integrated.
    """

    motion: Array
    by_parameter: Array
    covariance: Array
    reference: Array


@dataclass(frozen=True)
class Gyro:
    """Noise of a gyro about the vertical axis, and of the wheels that tell the speed beside it.

    Attributes:
        density: radians after one second from rates of the gyro (its angle random walk).
        wheels: noise of the translation; its rotations are not used.
    """

    density: float = 0.002
    wheels: VelocityNoise = field(default_factory=VelocityNoise)

    def motion(
        self, gyro_timestamps: ArrayLike, rate: ArrayLike, speed_timestamps: ArrayLike, speed: ArrayLike,
        keyframes: ArrayLike, *, bias: float = 0.0, scale: float = 0.0,
    ) -> GyroMotion:
        """Integrate between keyframes; each reading holds until the next one of its kind.

        The true rate is ``(rate - bias) / (1 + scale)``. Integrate anew with the bias that was found if it was far from
        the one used here; for small differences the derivative serves (Forster et al. 2017, "On-manifold
        preintegration", section VI-D, in the plane).

        Args:
            gyro_timestamps: ``(G,)`` seconds, in order.
            rate: ``(G,)`` radians a second, counter-clockwise.
            speed_timestamps: ``(M,)`` seconds, in order.
            speed: ``(M,)`` metres a second, forward.
            keyframes: ``(S + 1,)`` seconds, increasing.
            bias: radians a second, to begin with.
            scale: share by which rates are too large, to begin with.

        Raises:
            InputError: numbers that cannot be used, or a keyframe before the first reading of either.
        """
        if not (np.isfinite([bias, scale]).all() and scale > -1.0):
            raise InputError(f"Gyro: bias {bias} and scale {scale} must be finite numbers, the scale above -1")
        frames = np.asarray(keyframes, np.float64)
        readings = []
        for name, stamps, values in (("rate", gyro_timestamps, rate), ("speed", speed_timestamps, speed)):
            times, numbers = read_controls(f"Gyro: {name}", 0.0, [("timestamp", stamps), (name, values)])[1:]
            if not len(times) or (frames.size and times[0] > frames.min()):
                raise InputError(f"Gyro: there is no {name} at the first keyframe; begin with a later one")
            readings.append((times, numbers))
            cut(times, frames)  # says so where they are not in order
        pieces = cut(np.sort(np.concatenate([times for times, _ in readings])), frames)
        held = [values[np.searchsorted(times, pieces.timestamp, side="right") - 1] for times, values in readings]
        true_rate = (held[0] - bias) / (1.0 + scale)
        steps = velocity_motion(pieces.duration, held[1], true_rate, self.wheels)
        whole = preintegrate(steps.increment, pieces.first)
        by_rate = steps.by_control[:, :, 1:]
        by_parameter = np.concatenate([-by_rate, -by_rate * true_rate[:, None, None]], axis=2) / (1.0 + scale)
        noise = steps.covariance.copy()
        noise[:, 2, 2] = self.density**2 * pieces.duration
        return GyroMotion(
            whole.motion, whole.jacobian(by_parameter), whole.covariance(noise), np.array([bias, scale])
        )
