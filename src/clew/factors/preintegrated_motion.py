"""Relative pose from many readings whose calibration is estimated too."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.errors import InputError
from clew.factors.measured import Measured, read_element, read_keys, read_numbers
from clew.geometry import SE2, Point2, se2, so2
from clew.graph.factor import Role
from clew.noise import Kernel

Array = NDArray[np.float64]


class PreintegratedMotion(Measured):
    """Pose ``b`` was reached from pose ``a`` by readings that depend on ``2 P`` unknown parameters.

    The parameters (biases, scales) are ``P`` variables of kind `Point2`. The motion ``z`` was integrated at reference
    parameters; to first order it is ``z(p) = retract(z, J (p - reference))`` at others, so that nothing has to be
    integrated again (Forster et al. 2017, "On-manifold preintegration", section VI-D, in the plane).

    Residual: ``local(z(p), a^-1 b)``. Measurement: ``(x, y, theta)``, then ``J`` row by row, then the reference.

    One parameter may be the unit of the readings: the robot goes ``1 + p_unit`` metres for each that it reads. Its
    column of ``J`` is not used; instead the translation of ``a^-1 b`` is divided by ``(1 + p_unit) / (1 +
    reference_unit)``, so that the noise is in the unit, too. Without that a map whose scale is not known would come out
    too small, for in a smaller one all errors of the odometry are smaller.
    """

    def __init__(
        self,
        a: ArrayLike,
        b: ArrayLike,
        parameters: Sequence[ArrayLike],
        motion: SE2 | ArrayLike,
        by_parameter: ArrayLike,
        reference: ArrayLike,
        *,
        unit: int | None = None,
        sigmas: ArrayLike | None = None,
        information: ArrayLike | None = None,
        covariance: ArrayLike | None = None,
        kernel: Kernel | None = None,
        role: Role | str = Role.ODOMETRY,
    ) -> None:
        """One motion, or ``M`` of them.

        Args:
            a: key of the pose at the begin, or ``(M,)`` keys.
            b: key of the pose at the end, or ``(M,)`` keys.
            parameters: ``P`` keys of points, or of ``(M,)`` points each.
            motion: ``(M, 3)`` motion at the reference.
            by_parameter: ``(M, 3, 2 P)`` its derivative, in the tangent of `retract` at the motion.
            reference: ``(2 P,)`` parameters at which it was integrated, or ``(M, 2 P)``.
            unit: which of the ``2 P`` parameters is the unit of the readings, if one is.
            sigmas: standard deviations, ``(3,)`` or ``(M, 3)``.
            information: or information matrices.
            covariance: or covariance matrices.
            kernel: robust kernel or None.
            role: what the factor stands for.

        Raises:
            InputError: shapes, kinds or numbers that cannot be used.
        """
        what = "PreintegratedMotion"
        width = 2 * len(parameters)
        _, pose = read_element(motion, (SE2,), f"{what}: motion")
        rows = np.atleast_2d(pose)
        slopes = np.asarray(by_parameter, np.float64)
        if not parameters or slopes.shape[-2:] != (3, width):
            raise InputError(
                f"{what}: {len(parameters)} points of parameters need derivatives (M, 3, {width}) with M > 0, "
                f"got {slopes.shape}"
            )
        if unit is not None and not 0 <= unit < width:
            raise InputError(f"{what}: unit is {unit}; there are {width} parameters, counted from 0")
        self.unit = unit
        if unit is not None:
            slopes = slopes.copy()
            slopes[..., unit] = 0.0
        slopes = read_numbers(slopes.reshape(-1, 3 * width), 3 * width, f"{what}: by_parameter")
        at = np.atleast_2d(read_numbers(reference, width, f"{what}: reference"))
        count = max(len(rows), len(slopes), len(at))
        try:
            table = [np.broadcast_to(part, (count, part.shape[1])) for part in (rows, slopes, at)]
        except ValueError:
            raise InputError(f"{what}: motion, by_parameter and reference are of different lengths") from None
        self._set_up(
            read_keys((a, b, *parameters), what), (SE2, SE2, *[Point2] * len(parameters)), np.hstack(table), 3,
            sigmas=sigmas, information=information, covariance=covariance, kernel=kernel, role=role,
        )  # fmt: skip

    def _parts(self, parameters: tuple[Array, ...], measurement: Array) -> tuple[Array, Array]:
        """Motion at the parameters, and its derivative ``(M, 3, 2 P)`` in the tangent there."""
        width = 2 * len(parameters)
        slopes = measurement[:, 3 : 3 + 3 * width].reshape(-1, 3, width)
        delta = (slopes @ (np.concatenate(parameters, axis=1) - measurement[:, 3 + 3 * width :])[:, :, None])[:, :, 0]
        turned = slopes.copy()
        turned[:, :2] = so2.matrix(-delta[:, 2:]) @ slopes[:, :2]
        return se2.retract(measurement[:, :3], delta), turned

    def motion_at(self, *parameters: Array) -> Array:
        """Motions ``(M, 3)`` in metres at parameters ``(M, 2)``, one a point."""
        motion, _ = self._parts(parameters, self.measurement)
        _, unit = self._relative((motion, motion, *parameters), self.measurement)
        motion[:, :2] *= unit
        return motion

    def _relative(self, values: tuple[Array, ...], measurement: Array) -> tuple[Array, Array]:
        """``a^-1 b`` in the unit of the readings, and the unit ``(M, 1)`` over that of the reference."""
        relative = se2.between(values[0], values[1])
        unit = np.ones((len(relative), 1))
        if self.unit is not None:
            at = 3 + 6 * (len(values) - 2) + self.unit
            unit = (1.0 + self._unit(values)) / (1.0 + measurement[:, at : at + 1])
        relative[:, :2] /= unit
        return relative, unit

    def _unit(self, values: tuple[Array, ...]) -> Array:
        point, coordinate = divmod(self.unit or 0, 2)
        return values[2 + point][:, coordinate : coordinate + 1]

    def residual(self, *values: Array, measurement: Array) -> Array:
        """``local(z(p), a^-1 b)``, ``(M, 3)``, translations in the unit of the readings."""
        motion, _ = self._parts(values[2:], measurement)
        return se2.local(motion, self._relative(values, measurement)[0])

    def jacobians(self, *values: Array, measurement: Array) -> tuple[Array, ...]:
        """``(M, 3, 3)`` by both poses, ``(M, 3, 2)`` by each point of parameters."""
        motion, by_parameter = self._parts(values[2:], measurement)
        relative, unit = self._relative(values, measurement)
        by_motion, by_relative = se2.local_jacobians(motion, relative)
        by_b = by_relative.copy()
        by_b[:, :, :2] /= unit[:, :, None]
        by_all = by_motion @ by_parameter
        if self.unit is not None:
            shorter = so2.act(-relative[:, 2:], relative[:, :2]) / -(1.0 + self._unit(values))
            by_all[:, :, self.unit] = (by_relative[:, :, :2] @ shorter[:, :, None])[:, :, 0]
        by_points = [by_all[:, :, k : k + 2] for k in range(0, by_all.shape[2], 2)]
        back = se2.adjoint(se2.inverse(se2.between(values[0], values[1])))
        return -by_b @ back, by_b, *by_points
