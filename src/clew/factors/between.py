"""Relative pose of two poses: odometry, scan matches, loop closures."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.factors.measured import Measured, read_element, read_keys
from clew.geometry import SE2, SE3
from clew.graph.factor import Role
from clew.noise import Kernel

Array = NDArray[np.float64]


class Between(Measured):
    """Pose ``b`` was seen from pose ``a`` at ``z = T_a_b``.

    Residual: ``[R_z^T (R_a^T (t_b - t_a) - t_z), Log(R_z^T R_a^T R_b)]``, that is ``local(z, a^-1 b)``.
    Jacobians: ``D = diag(R_z^T R_a^T R_b, J_r^-1(e_rotation))`` by ``b``, ``-D Ad(b^-1 a)`` by ``a``.
    Measurement: ``(x, y, theta)`` or ``(x, y, z, qx, qy, qz, qw)``.
    """

    native: ClassVar[str | None] = "between"

    def __init__(
        self,
        a: ArrayLike,
        b: ArrayLike,
        measurement: SE2 | SE3 | ArrayLike,
        *,
        sigmas: ArrayLike | None = None,
        information: ArrayLike | None = None,
        covariance: ArrayLike | None = None,
        kernel: Kernel | None = None,
        role: Role | str = Role.ODOMETRY,
    ) -> None:
        """Relative pose of one pair of poses, or of ``M`` pairs.

        Args:
            a: key of the pose from which was measured, or ``(M,)`` keys.
            b: key of the pose that was measured, or ``(M,)`` keys.
            measurement: ``T_a_b`` as `SE2` or `SE3`, or its storage ``(M, 3)`` or ``(M, 7)``.
            sigmas: standard deviations of the residual, broadcast to ``(M, dim)``; translation first.
            information: or its information matrices, broadcast to ``(M, dim, dim)``.
            covariance: or its covariance matrices.
            kernel: robust kernel or None.
            role: ``"odometry"``, ``"loop"``, ...

        Raises:
            InputError: shapes, kinds or numbers that cannot be used.
        """
        kind, array = read_element(measurement, (SE2, SE3), "Between: measurement")
        self._set_up(
            read_keys((a, b), "Between"), (kind, kind), array, kind.dim,
            sigmas=sigmas, information=information, covariance=covariance, kernel=kernel, role=role,
        )  # fmt: skip

    def residual(self, *values: Array, measurement: Array) -> Array:
        """``local(z, a^-1 b)``, ``(M, dim)``."""
        functions = self.kinds[0].functions
        result: Array = functions.local(measurement, functions.between(*values))
        return result

    def jacobians(self, *values: Array, measurement: Array) -> tuple[Array, ...]:
        """``(M, dim, dim)`` by ``a`` and by ``b``."""
        functions = self.kinds[0].functions
        relative = functions.between(*values)
        by_b = functions.local_jacobians(measurement, relative)[1]
        return -by_b @ functions.adjoint(functions.inverse(relative)), by_b
