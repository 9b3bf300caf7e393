"""Simulated wheel odometry: noise that grows with way and turn, and systematic errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from clew.geometry import se2, wrap
from clew.sim.world import Array


@dataclass(frozen=True)
class OdometryModel:
    """Errors of dead reckoning.

    For a step of ``d`` metres and a turn of ``a`` radians the odometry reports
    ``d (1 + scale_bias) + N(0, sigma_distance^2 |d|)`` metres forwards,
    ``N(0, sigma_side^2 |d|)`` metres more to the side, and a turn of
    ``a (1 + turn_bias) + drift_bias |d| + N(0, sigma_turn^2 |a| + sigma_drift^2 |d|)``:
    variances grow linearly, so that they do not depend on how often the odometry is read.

    Attributes:
        scale_bias: relative error of distances.
        turn_bias: relative error of turns.
        drift_bias: turn reported on a straight way, rad/m.
        sigma_distance: m per square root of a metre.
        sigma_side: m per square root of a metre.
        sigma_turn: rad per square root of a radian.
        sigma_drift: rad per square root of a metre.
    """

    scale_bias: float = 0.0
    turn_bias: float = 0.0
    drift_bias: float = 0.0
    sigma_distance: float = 0.0
    sigma_side: float = 0.0
    sigma_turn: float = 0.0
    sigma_drift: float = 0.0

    @classmethod
    def good(cls) -> OdometryModel:
        """A well calibrated robot on a hard floor."""
        return cls(0.003, 0.002, 0.0001, 0.01, 0.003, 0.005, 0.002)

    @classmethod
    def medium(cls) -> OdometryModel:
        """A robot as it comes: metres of error after some hundred metres."""
        return cls(0.01, 0.004, 0.0004, 0.02, 0.006, 0.012, 0.004)

    @classmethod
    def bad(cls) -> OdometryModel:
        """Worn wheels, slipping in turns."""
        return cls(0.03, 0.02, 0.003, 0.05, 0.02, 0.04, 0.015)

    def reckon(self, T_world_robot: Array, rng: np.random.Generator) -> Array:
        """``(N, 3)`` dead reckoning ``T_odom_robot`` of true poses ``(N, 3)``, from the identity."""
        steps = se2.between(T_world_robot[:-1], T_world_robot[1:])
        reported = self.perturb(steps, rng)
        # Headings are sums of turns; positions are sums of steps turned by the heading at the start of each.
        heading = np.concatenate([[0.0], np.cumsum(reported[:, 2])])
        c, s = np.cos(heading[:-1]), np.sin(heading[:-1])
        x = np.concatenate([[0.0], np.cumsum(c * reported[:, 0] - s * reported[:, 1])])
        y = np.concatenate([[0.0], np.cumsum(s * reported[:, 0] + c * reported[:, 1])])
        return np.stack([x, y, wrap(heading)], axis=1)

    def perturb(self, steps: Array, rng: np.random.Generator) -> Array:
        """Reported steps ``(M, 3)`` for true ones (x, y, theta in the robot's frame at the start of each)."""
        distance = np.hypot(steps[:, 0], steps[:, 1])
        turn = np.abs(steps[:, 2])
        noise = rng.standard_normal(steps.shape)
        forwards = steps[:, 0] * (1 + self.scale_bias) + self.sigma_distance * np.sqrt(distance) * noise[:, 0]
        side = steps[:, 1] * (1 + self.scale_bias) + self.sigma_side * np.sqrt(distance) * noise[:, 1]
        sigma = np.sqrt(self.sigma_turn ** 2 * turn + self.sigma_drift ** 2 * distance)
        angle = steps[:, 2] * (1 + self.turn_bias) + self.drift_bias * distance + sigma * noise[:, 2]
        return np.stack([forwards, side, angle], axis=1)
