"""How good a robot's odometry is, learnt from motion that was measured otherwise."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2
from clew.motion.noise import OdometryNoise

Array = NDArray[np.float64]

WINDOW = 400  # steps that the estimate rests on: floors and loads change
EVERY = 10  # steps between two estimates
PRIOR_STEPS = 10.0  # what the noise assumed beforehand counts, in steps of half a metre or half a radian
FREEDOM = 4.0  # degrees of freedom of the heavy-tailed distribution of errors: wheels slip
ROUNDS = 6
#: Systematic errors to be expected, a row a component of the error (x, y, theta): by metre and by radian.
BIAS_DEVIATION = np.array([[0.03, 0.02], [0.02, 0.03], [0.01, 0.03]])


@dataclass(frozen=True)
class OdometryQuality:
    """What is known of the odometry.

    Attributes:
        variances: ``(3, 2)`` of the components x, y (metres^2) and theta (radians^2) of an increment, after `bias` is
            taken out: by metre driven and by radian turned,
        floor: ``(3,)`` and of any increment.
        bias: ``(3, 2)`` systematic error of the measured step seen from the one that odometry tells, x, y in metres and
            theta in radians, in the robot's frame: by metre driven forwards and by radian turned. Row x by metre is the
            scale of distances; y by metre the angle by which the laser is mounted askew; theta by metre a drift on
            straight ways; theta by radian the scale of turns; x and y by radian a laser mounted beside where it is
            said to be.
        bias_deviation: ``(3, 2)`` how well each is known.
        steps: how many steps these rest on.
    """

    variances: Array
    floor: Array
    bias: Array
    bias_deviation: Array
    steps: int

    @staticmethod
    def assumed(noise: OdometryNoise) -> OdometryQuality:
        """What is believed before any step."""
        by_extent = np.square([
            [noise.translation_per_metre, noise.translation_per_radian],
            [noise.translation_per_metre, noise.translation_per_radian],
            [noise.rotation_per_metre, noise.rotation_per_radian],
        ])  # fmt: skip
        floor = np.square([noise.translation_floor, noise.translation_floor, noise.rotation_floor])
        return OdometryQuality(by_extent, floor, np.zeros((3, 2)), BIAS_DEVIATION.copy(), 0)

    def correct(self, increment: Array) -> Array:
        """Increments ``(..., 3)`` of the odometry without its systematic error."""
        return np.asarray(se2.compose(increment, increment[..., [0, 2]] @ self.bias.T), dtype=np.float64)

    def variance(self, increment: Array) -> Array:
        """Variances ``(..., 3)`` of increments ``(..., 3)``, in the tangent at their end."""
        return np.asarray(extent(increment) @ self.variances.T + self.floor, dtype=np.float64)

    def covariance(self, increment: Array) -> Array:
        """Covariance ``(..., 3, 3)`` of increments ``(..., 3)``, in the tangent at their end."""
        return np.asarray(self.variance(increment)[..., None] * np.eye(3))

    def to_dict(self) -> dict[str, object]:
        """Plain numbers for a report: noise grows with the root of the way or turn."""
        deviations = np.sqrt(self.variances).round(5).tolist()
        names = ("forward", "sideways", "turn")
        return {
            "steps": self.steps,
            "noise_per_sqrt_metre": {name: row[0] for name, row in zip(names, deviations, strict=True)},
            "noise_per_sqrt_radian": {name: row[1] for name, row in zip(names, deviations, strict=True)},
            "distance_scale_error": round(float(self.bias[0, 0]), 5),
            "turn_scale_error": round(float(self.bias[2, 1]), 5),
            "drift_rad_per_metre": round(float(self.bias[2, 0]), 6),
        }


def extent(increment: Array) -> Array:
    """Way and turn ``(..., 2)`` of increments ``(..., 3)``, not negative."""
    return np.stack([np.hypot(increment[..., 0], increment[..., 1]), np.abs(increment[..., 2])], axis=-1)


class OdometryCalibration:
    """Estimates noise and systematic errors of odometry from steps of known motion, again and again.

    Systematic errors by Bayesian linear regression with Student's t weights; the variances, which grow with distance
    and turn, by multiplicative updates of their likelihood (Fevotte, Idier 2011: Itakura-Saito divergence).

    Args:
        assumed: noise that is believed until steps tell otherwise.
    """

    def __init__(self, assumed: OdometryNoise) -> None:
        self._assumed = OdometryQuality.assumed(assumed)
        self._rows: deque[Array] = deque(maxlen=WINDOW)
        self._count = 0
        self.quality = self._assumed

    def add(self, increment: Array, measured: Array, known: Array, variance: Array) -> None:
        """Take a step.

        Args:
            increment: ``(3,)`` what odometry tells, as it is.
            measured: ``(3,)`` what the robot did.
            known: ``(3,)`` in [0, 1], how much of each component of `measured` does not itself rest on odometry.
            variance: ``(3,)`` of `measured`.
        """
        self._rows.append(np.concatenate([increment, se2.between(increment, measured), known, variance]))
        self._count += 1
        if self._count % EVERY == 0:
            self._estimate()

    def _estimate(self) -> None:
        rows = np.array(self._rows)
        step, error, known, measured = rows[:, :3], rows[:, 3:6], rows[:, 6:9], rows[:, 9:]
        regressors = step[:, [0, 2]]
        quality = self.quality
        for _ in range(2):
            rest = error - regressors @ quality.bias.T
            variances = quality.variance(step) + measured
            weights = known * (FREEDOM + 1) / (FREEDOM + rest**2 / variances)
            bias, deviation = _biases(regressors, error, weights / variances)
            rest = error - regressors @ bias.T
            found = explain_variances(extent(step), rest**2, known, measured + quality.floor, quality.variances,
                                      self._assumed.variances)  # fmt: skip
            quality = replace(quality, variances=found, bias=bias, bias_deviation=deviation, steps=self._count)
        self.quality = quality


def _biases(regressors: Array, error: Array, weights: Array) -> tuple[Array, Array]:
    """Systematic errors ``(3, 2)`` and their deviations."""
    normal = np.einsum("nk,ni,nj->kij", weights, regressors, regressors)
    right = np.einsum("nk,ni,nk->ki", weights, regressors, error)
    normal += np.apply_along_axis(np.diag, 1, 1.0 / BIAS_DEVIATION**2)
    covariance = np.linalg.inv(normal)
    return np.einsum("kij,kj->ki", covariance, right), np.sqrt(np.einsum("kii->ki", covariance))


def explain_variances(x: Array, squares: Array, known: Array, base: Array, before: Array, assumed: Array) -> Array:
    """Variances ``(k, 2)`` by two extents ``(n, 2)`` that explain squared residuals ``(n, k)``.

    Those assumed count as `PRIOR_STEPS` residuals more.
    """
    q = before
    pull = 0.5 * PRIOR_STEPS
    for _ in range(ROUNDS):
        v = x @ q.T + base
        up = (known * bounded(squares, v) / v**2).T @ x + pull * assumed / q**2
        down = (known / v).T @ x + pull / q
        q = q * np.sqrt(up / down)
    return np.asarray(q)


def bounded(squares: Array, variance: Array | float) -> Array:
    """Squared errors of which the large ones count less, by the weight of Student's t distribution.

    Normalised, so that the mean over a Gaussian sample of this variance is the variance.
    """
    return np.asarray(squares * (FREEDOM + 1) / (FREEDOM + squares / variance) * GAUSSIAN_GAIN)


def _gaussian_gain() -> float:
    """What brings the t-weighted mean square of a standard Gaussian back to one."""
    z = np.linspace(-8.0, 8.0, 4001)
    density = np.exp(-0.5 * z**2)
    weighted = z**2 * (FREEDOM + 1) / (FREEDOM + z**2)
    return float(density.sum() / (density * weighted).sum())


GAUSSIAN_GAIN = _gaussian_gain()
