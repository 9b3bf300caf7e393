"""Range and bearing by a sensor whose mounting and distortion are estimated too.

A camera that measures how large a mark appears measures depth along its axis rather than distance, and looks from
where it is mounted. Both show as errors that depend smoothly on where in the picture the mark is, so the models have
a correction that is quadratic in the bearing. Edges of the mark that look blurred add the same to every distance.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.errors import InputError
from clew.factors.measured import Measured, read_columns, read_keys, read_numbers
from clew.factors.sensor_view import direction_jacobian, direction_of, range_jacobian, range_of
from clew.geometry import SE2, Point2, se2, so2, wrap
from clew.graph.factor import Role
from clew.noise import Kernel

Array = NDArray[np.float64]

#: Radians: the distortion is a polynomial that holds in the picture, so nothing is taken to be further than that from
#: where it was measured. A wrong sighting of something behind the robot would else look right where it folds over.
NEAR = 0.2


class CalibratedSighting(Measured):
    """Base of `CalibratedRange` and `CalibratedBearing`.

    Keys: the robot's pose; what was seen, a landmark (`Point2`) or another robot (`SE2`); points of parameters, the
    last of which is the sensor's place on the robot, ``(forward, left)`` of its centre. ``q`` is what was seen, from
    there: ``q = R^T (p - t) - (forward, left)``. Measurement: the number measured, then ``f_1``, ``f_2`` and so on.
    """

    _parameters: int
    _basis: int

    def __init__(
        self,
        pose: ArrayLike,
        target: ArrayLike,
        parameters: Sequence[ArrayLike],
        measured: ArrayLike,
        basis: ArrayLike,
        *,
        sees: type[Any] = Point2,
        sigmas: ArrayLike | None = None,
        information: ArrayLike | None = None,
        covariance: ArrayLike | None = None,
        kernel: Kernel | None = None,
        role: Role | str = Role.OBSERVATION,
    ) -> None:
        """One sighting, or ``M`` of them.

        Args:
            pose: key of the robot's pose, or ``(M,)`` keys.
            target: key of what was seen, or ``(M,)`` keys.
            parameters: keys of the points of parameters, in the order of the class's docstring.
            measured: metres or radians, or ``(M,)``.
            basis: the numbers ``f_1``, ``f_2`` and so on of the class's docstring, ``(k,)`` or ``(M, k)``.
            sees: `Point2` for landmarks, `SE2` for robots.
            sigmas: standard deviation, or ``(M, 1)``.
            information: or information matrices ``(M, 1, 1)``.
            covariance: or covariance matrices.
            kernel: robust kernel or None.
            role: what the factor stands for.

        Raises:
            InputError: shapes, kinds or numbers that cannot be used.
        """
        what = type(self).__name__
        if sees not in (Point2, SE2):
            raise InputError(f"{what}: sees is {sees!r}; give Point2 for landmarks or SE2 for robots")
        if len(parameters) != self._parameters:
            raise InputError(f"{what}: {len(parameters)} points of parameters; it needs {self._parameters}")
        functions = np.atleast_2d(read_numbers(basis, self._basis, f"{what}: basis"))
        columns = {f"f{k + 1}": column for k, column in enumerate(functions.T)}
        self._set_up(
            read_keys((pose, target, *parameters), what), (SE2, sees, *[Point2] * self._parameters),
            read_columns(what, measured=measured, **columns), 1,
            sigmas=sigmas, information=information, covariance=covariance, kernel=kernel, role=role,
        )  # fmt: skip

    @abstractmethod
    def _error(self, q: Array, *parameters: Array, measurement: Array) -> Array:
        """Residual ``(M, 1)``."""

    @abstractmethod
    def _derivatives(self, q: Array, *parameters: Array, measurement: Array) -> tuple[Array, ...]:
        """``(M, 1, 2)`` by ``q`` and by each point of parameters but the last."""

    def _view(self, pose: Array, target: Array, mounted: Array) -> Array:
        seen: Array = se2.act(se2.inverse(pose), target[:, :2]) - mounted
        return seen

    def residual(self, *values: Array, measurement: Array) -> Array:
        """Predicted minus measured, ``(M, 1)``."""
        pose, target, *parameters = values
        return self._error(self._view(pose, target, parameters[-1]), *parameters, measurement=measurement)

    def jacobians(self, *values: Array, measurement: Array) -> tuple[Array, ...]:
        """``(M, 1, dim)`` by each variable."""
        pose, target, *parameters = values
        q = self._view(pose, target, parameters[-1])
        by_q, *by_parameters = self._derivatives(q, *parameters, measurement=measurement)
        robot = q + parameters[-1]
        turned = np.stack([robot[:, 1], -robot[:, 0]], axis=1)[:, :, None]
        by_pose = np.concatenate([-by_q, by_q @ turned], axis=2)
        by_target = by_q @ so2.matrix(-pose[:, 2:])
        if target.shape[1] == 3:  # a pose moves in its own frame, and its heading does not matter
            by_target = np.concatenate([by_target @ so2.matrix(target[:, 2:]), np.zeros((len(q), 1, 1))], axis=2)
        return by_pose, by_target, *by_parameters, -by_q


class CalibratedRange(CalibratedSighting):
    """Distance of what was seen.

    Residual: ``|q| (1 + scale + slope f_1 + curve f_2 - offset f_3 + share) + offset + bias - range``. Parameters:
    ``(scale, offset)``, ``(slope, curve)``, ``(bias, .)``, ``(share, .)``, ``(forward, left)``; the bias is that of one
    view, the share that of what is seen: a mark printed too small looks far. ``f_1`` and ``f_2`` are the measured
    bearing and its square, each less a constant, ``f_3`` an inverse range at which the offset shall change nothing.
    """

    _parameters = 5
    _basis = 3

    def _error(self, q: Array, *parameters: Array, measurement: Array) -> Array:
        added = parameters[0][:, 1:] + parameters[2][:, :1]
        stretch = self.stretch(parameters[0], parameters[1], parameters[3], measurement=measurement)
        return range_of(q) * stretch + added - measurement[:, :1]

    @staticmethod
    def stretch(first: Array, second: Array, mark: Array, *, measurement: Array) -> Array:
        """What distances ``(M, 1)`` are multiplied by."""
        along = first[:, :1] - first[:, 1:] * measurement[:, 3:] + mark[:, :1]
        result: Array = 1.0 + along + (second * measurement[:, 1:3]).sum(axis=1, keepdims=True)
        return result

    def _derivatives(self, q: Array, *parameters: Array, measurement: Array) -> tuple[Array, ...]:
        distance = range_of(q)
        stretch = self.stretch(parameters[0], parameters[1], parameters[3], measurement=measurement)
        by_q = range_jacobian(q) * stretch[:, :, None]
        first = np.concatenate([distance, 1.0 - distance * measurement[:, 3:]], axis=1)
        bias = _column(0, len(q))
        return by_q, first[:, None], (distance * measurement[:, 1:3])[:, None], bias, distance[:, :, None] * bias


class CalibratedBearing(CalibratedSighting):
    """Direction of what was seen.

    Residual: ``b + offset + slope (b - f_1) + curve (b^2 - f_2) + cube (b^3 - f_3) + bias + turn - bearing`` with
    ``b = atan2(q_y, q_x)``, taken within half a turn of the measured bearing. Parameters: ``(offset, slope)``,
    ``(curve, cube)``, ``(., bias)``, ``(., turn)``, ``(forward, left)``; the bias is that of one view, the turn that of
    what is seen, ``f_1`` to ``f_3`` are constants. The distortion is that of the true direction (that of the measured
    one would make errors look smaller the more it compresses the picture), but at most `NEAR` from the measured one.
    """

    _parameters = 5
    _basis = 3

    def direction(self, pose: Array, target: Array, *parameters: Array, measurement: Array) -> Array:
        """True direction ``(M,)`` as seen from the sensor, at which the distortion is taken."""
        return self._direction(self._view(pose, target, parameters[-1]), measurement)[1]

    @staticmethod
    def _direction(q: Array, measurement: Array) -> tuple[Array, Array]:
        """``b``, and the direction at which the distortion is taken, ``(M,)`` each."""
        measured = measurement[:, 0]
        apart = wrap(direction_of(q)[:, 0] - measured)
        return measured + apart, measured + np.clip(apart, -NEAR, NEAR)

    def _error(self, q: Array, *parameters: Array, measurement: Array) -> Array:
        (first, second, bias, mark, _), (b, near) = parameters, self._direction(q, measurement)
        powers = np.stack([near, near**2, near**3], axis=1) - measurement[:, 1:]
        weights = np.concatenate([first[:, 1:], second], axis=1)
        error: Array = b + first[:, 0] + bias[:, 1] + mark[:, 1] + (powers * weights).sum(axis=1) - measurement[:, 0]
        return error[:, None]

    def _derivatives(self, q: Array, *parameters: Array, measurement: Array) -> tuple[Array, ...]:
        (first, second, *_), (b, near) = parameters, self._direction(q, measurement)
        stretch = 1.0 + (b == near) * (first[:, 1] + 2.0 * second[:, 0] * near + 3.0 * second[:, 1] * near**2)
        by_first = np.stack([np.ones(len(q)), near - measurement[:, 1]], axis=1)[:, None]
        by_second = np.stack([near**2, near**3], axis=1) - measurement[:, 2:]
        bias = _column(1, len(q))
        return direction_jacobian(q) * stretch[:, None, None], by_first, by_second[:, None], bias, bias


def _column(coordinate: int, count: int) -> Array:
    """``(count, 1, 2)`` derivative by one coordinate of a point."""
    out = np.zeros((count, 1, 2))
    out[:, :, coordinate] = 1.0
    return out
