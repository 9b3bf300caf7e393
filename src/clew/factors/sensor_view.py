"""A landmark as a sensor on the robot sees it: what point, range and bearing factors have in common."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.factors.measured import POINTS, POSES, Measured, read_keys, read_sensor
from clew.geometry import se2, se3, so3, wrap

Array = NDArray[np.float64]


class SensorView(Measured):
    """Base of factors between a pose and a landmark.

    They predict from ``q = (T_world_robot T_robot_sensor)^-1 p_world``, the landmark in the sensor frame.
    """

    def _set_up_view(
        self,
        pose: ArrayLike,
        point: ArrayLike,
        measurement: Array,
        space: int,
        T_robot_sensor: Any,
        **noise: Any,
    ) -> None:
        """Check and store; `noise` is passed on to `Measured`."""
        what = type(self).__name__
        kinds = (POSES[space], POINTS[space])
        self._set_up(read_keys((pose, point), what), kinds, measurement, measurement.shape[-1], **noise)
        self.T_robot_sensor = read_sensor(T_robot_sensor, kinds[0], what)

    @abstractmethod
    def predict(self, q: Array) -> Array:
        """What the sensor should measure, ``(M, d)``."""

    @abstractmethod
    def predict_jacobian(self, q: Array) -> Array:
        """Derivative of `predict`, ``(M, d, space)``."""

    def residual(self, *values: Array, measurement: Array) -> Array:
        """Predicted minus measured, ``(M, d)``."""
        return self.predict(self.view(*values)) - measurement

    def jacobians(self, *values: Array, measurement: Array) -> tuple[Array, ...]:
        """``(M, d, dim)`` by the pose and ``(M, d, space)`` by the landmark."""
        q, by_pose, by_point = self.view_jacobians(*values)
        by_q = self.predict_jacobian(q)
        return by_q @ by_pose, by_q @ by_point

    def _space(self) -> int:
        return int(self.kinds[0].space)

    def _sensor_pose(self, pose: Array) -> Array:
        """``T_world_sensor`` from ``T_world_robot``, ``(M, storage)``."""
        if self.T_robot_sensor is None:
            return pose
        result: Array = self.kinds[0].functions.compose(pose, self.T_robot_sensor)
        return result

    def view(self, pose: Array, point: Array) -> Array:
        """The landmark in the sensor frame, ``(M, space)``."""
        functions = self.kinds[0].functions
        result: Array = functions.act(functions.inverse(self._sensor_pose(pose)), point)
        return result

    def view_jacobians(self, pose: Array, point: Array) -> tuple[Array, Array, Array]:
        """The landmark ``q`` in the sensor frame, and its Jacobians by pose and by landmark.

        In the tangent of the sensor's pose the first is ``[-I, [q]x]``; ``Ad(T_robot_sensor^-1)`` takes it
        to that of the robot. The second is the sensor's ``R^T``.
        """
        sensor = self._sensor_pose(pose)
        if self._space() == 2:
            q = se2.act(se2.inverse(sensor), point)
            by_point = np.swapaxes(se2.matrix(sensor)[..., :2, :2], -1, -2)
            turned = np.stack((q[..., 1], -q[..., 0]), axis=-1)[..., None]
        else:
            q = se3.act(se3.inverse(sensor), point)
            by_point = np.swapaxes(so3.matrix(sensor[..., 3:]), -1, -2)
            turned = so3.hat(q)
        minus = np.broadcast_to(-np.eye(self._space()), by_point.shape)
        by_pose = np.concatenate((minus, turned), axis=-1)
        if self.T_robot_sensor is not None:
            functions = self.kinds[0].functions
            by_pose = by_pose @ functions.adjoint(functions.inverse(self.T_robot_sensor))
        return q, by_pose, by_point


def _safe(squared: Array) -> Array:
    """Denominators, zero replaced by infinity: a landmark in the sensor has no direction."""
    return np.where(squared > 0.0, squared, np.inf)


def range_of(q: Array) -> Array:
    """Distance from the sensor, ``(M, 1)``."""
    result: Array = np.sqrt((q * q).sum(axis=-1))[..., None]
    return result


def range_jacobian(q: Array) -> Array:
    """``q^T / |q|``, ``(M, 1, space)``; zero for a landmark in the sensor."""
    result: Array = (q / _safe(range_of(q)))[..., None, :]
    return result


def direction_of(q: Array) -> Array:
    """Bearing ``atan2(y, x)``, in space and elevation ``atan2(z, hypot(x, y))``; ``(M, space - 1)``."""
    bearing = np.arctan2(q[..., 1], q[..., 0])
    if q.shape[-1] == 2:
        return bearing[..., None]
    return np.stack((bearing, np.arctan2(q[..., 2], np.hypot(q[..., 0], q[..., 1]))), axis=-1)


def direction_jacobian(q: Array) -> Array:
    """Derivative ``(M, space - 1, space)`` of `direction_of`; zero where bearing does not exist."""
    x, y = q[..., 0], q[..., 1]
    across = _safe(x * x + y * y)
    if q.shape[-1] == 2:
        return np.stack((-y / across, x / across), axis=-1)[..., None, :]
    z = q[..., 2]
    squared, level = _safe(x * x + y * y + z * z), np.hypot(x, y)
    steep = z / (squared * _safe(level))
    bearing = np.stack((-y / across, x / across, np.zeros_like(x)), axis=-1)
    elevation = np.stack((-x * steep, -y * steep, level / squared), axis=-1)
    return np.stack((bearing, elevation), axis=-2)


def wrapped_after(start: int, residual: Array) -> Array:
    """Residual ``(M, d)`` with the columns from `start` on brought into ``(-pi, pi]``."""
    return np.concatenate((residual[..., :start], wrap(residual[..., start:])), axis=-1)
