"""Prior knowledge of one variable."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.errors import InputError
from clew.factors.measured import Measured, read_element, read_keys
from clew.geometry import SE2, SE3, Point2, Point3
from clew.graph.factor import Role
from clew.noise import Kernel

Array = NDArray[np.float64]


class Prior(Measured):
    """A variable is known to be near a value.

    Residual: ``local(z, x)``, that is ``[R_z^T (t - t_z), Log(R_z^T R)]`` for poses, ``x - z`` for points.
    Jacobian: ``diag(R_z^T R, J_r^-1(Log(R_z^T R)))`` for poses, the identity for points.
    Measurement: the storage of the value.
    """

    native: ClassVar[str | None] = "prior"

    def __init__(
        self,
        key: ArrayLike,
        value: SE2 | SE3 | Point2 | Point3,
        *,
        sigmas: ArrayLike | None = None,
        information: ArrayLike | None = None,
        covariance: ArrayLike | None = None,
        kernel: Kernel | None = None,
        role: Role | str = Role.PRIOR,
    ) -> None:
        """Prior on one variable, or on ``M`` of one kind.

        Args:
            key: key, or ``(M,)`` keys.
            value: where the variable is believed to be, one or ``(M,)``; its class is the kind of the
                variable.
            sigmas: standard deviations of the tangent, broadcast to ``(M, dim)``; metres and radians.
            information: or its information matrices, broadcast to ``(M, dim, dim)``.
            covariance: or its covariance matrices.
            kernel: robust kernel or None.
            role: what the factor stands for.

        Raises:
            InputError: shapes, kinds or numbers that cannot be used.
        """
        if not isinstance(value, (SE2, SE3, Point2, Point3)):
            raise InputError(
                f"Prior: value must be an SE2, SE3, Point2 or Point3, got {type(value).__name__}"
            )
        kind, array = read_element(value, (type(value),), "Prior: value")
        self._set_up(
            read_keys((key,), "Prior"), (kind,), array, kind.dim,
            sigmas=sigmas, information=information, covariance=covariance, kernel=kernel, role=role,
        )  # fmt: skip

    def residual(self, *values: Array, measurement: Array) -> Array:
        """``local(z, x)``, ``(M, dim)``."""
        functions: Any = self.kinds[0].functions
        result: Array = functions.local(measurement, values[0])
        return result

    def jacobians(self, *values: Array, measurement: Array) -> tuple[Array, ...]:
        """``(M, dim, dim)``."""
        return (self.kinds[0].functions.local_jacobians(measurement, values[0])[1],)
