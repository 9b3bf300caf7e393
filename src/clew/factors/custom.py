"""A measurement model of your own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.errors import InputError
from clew.factors.measured import Measured, read_keys
from clew.geometry import SE2, SE3, Point2, Point3
from clew.graph.factor import Keys, Role
from clew.noise import Kernel

Array = NDArray[np.float64]


class CustomFactor(Measured):
    """A residual written in plain NumPy, with an exact Jacobian by forward differentiation.

    The residual is evaluated once on the whole block, so it works on arrays with the batch axis first::

        def distance(a, b, measured):  # (M, 3), (M, 3), (M, 1)
            return np.linalg.norm(b[:, :2] - a[:, :2], axis=1)[:, None] - measured

        graph.add(CustomFactor((i, j), distance, measurement=2.0, sigmas=[0.1], kinds=(SE2, SE2)))

    It returns predicted minus measured, ``(M, d)``, angles wrapped (`clew.geometry.wrap`). Use NumPy
    functions, or geometry classes (``SE2.from_array(a).between(SE2.from_array(b)).array``). Build results
    with `numpy.stack` or `numpy.concatenate`; writing derivatives into a plain array raises `InputError`.
    """

    def __init__(
        self,
        keys: Sequence[ArrayLike] | ArrayLike,
        residual: Callable[..., Any],
        *,
        kinds: Sequence[type[Any]],
        measurement: ArrayLike | None = None,
        sigmas: ArrayLike | None = None,
        information: ArrayLike | None = None,
        covariance: ArrayLike | None = None,
        jacobian: Callable[..., Any] | None = None,
        kernel: Kernel | None = None,
        role: Role | str = Role.OBSERVATION,
    ) -> None:
        """One measurement, or ``M`` of them.

        Args:
            keys: one key or ``(M,)`` keys a variable, as a tuple or list; or an array ``(M, arity)``.
            residual: ``residual(x_1, x_2, ..., measurement) -> (M, d)`` on the storage of the variables,
                ``(M, storage)`` each; without `measurement` it gets the variables only.
            kinds: manifold of each variable: `SE2`, `SE3`, `Point2`, `Point3`.
            measurement: ``(M, k)``, ``(k,)`` or a number.
            sigmas: standard deviations, ``(d,)`` or ``(M, d)``; a number for ``d = 1``.
            information: or information matrices ``(d, d)`` or ``(M, d, d)``.
            covariance: or covariance matrices.
            jacobian: derivatives by the tangents of `retract`, ``(M, d, dim)`` a variable, with the
                arguments of `residual`; by forward differentiation if None.
            kernel: robust kernel or None.
            role: what the factor stands for.

        Raises:
            InputError: shapes, kinds or numbers that cannot be used.
        """
        self._residual = residual
        self._jacobian = jacobian
        self._measured = measurement is not None
        kinds = tuple(kinds)
        if not kinds or any(kind not in (SE2, SE3, Point2, Point3) for kind in kinds):
            raise InputError(f"CustomFactor: kinds must be some of SE2, SE3, Point2 and Point3, got {kinds}")
        table = _key_table(keys, len(kinds))
        self._set_up(
            table, kinds, _measurement_table(measurement), _noise_dim(sigmas, information, covariance),
            sigmas=sigmas, information=information, covariance=covariance, kernel=kernel, role=role,
        )  # fmt: skip

    def residual(self, *values: Array, measurement: Array) -> Array:
        """What the user's function returns, ``(M, d)``."""
        result: Array = self._residual(*values, *self._extra(measurement))
        return result

    def jacobians(self, *values: Array, measurement: Array) -> tuple[Array, ...] | None:
        """What the user's Jacobian returns, or None."""
        if self._jacobian is None:
            return None
        given = self._jacobian(*values, *self._extra(measurement))
        blocks = tuple(np.asarray(block, dtype=np.float64) for block in given)
        expected = [(len(measurement), self.residual_dim, kind.dim) for kind in self.kinds]
        if [block.shape for block in blocks] != expected:
            shapes = [block.shape for block in blocks]
            raise InputError(f"CustomFactor: jacobian returned shapes {shapes}, expected {expected}")
        return blocks

    def _extra(self, measurement: Array) -> tuple[Array, ...]:
        return (measurement,) if self._measured else ()


def _key_table(keys: Any, arity: int) -> Keys:
    if isinstance(keys, np.ndarray) and keys.ndim == 2:
        columns: Sequence[ArrayLike] = list(keys.T)
    elif np.ndim(keys) == 0 or (arity == 1 and np.ndim(keys) == 1):
        columns = (keys,)
    else:
        columns = list(keys)
    if len(columns) != arity:
        raise InputError(f"CustomFactor: {len(columns)} keys for {arity} kinds; give one kind a key")
    return read_keys(columns, "CustomFactor")


def _measurement_table(measurement: ArrayLike | None) -> Array:
    if measurement is None:
        return np.empty((1, 0))
    try:
        table = np.array(measurement, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"CustomFactor: measurement cannot be read as numbers ({error})") from None
    if table.ndim > 2 or not np.isfinite(table).all():
        raise InputError(f"CustomFactor: measurement must be finite, (M, k) or (k,); got shape {table.shape}")
    return np.atleast_2d(table)


def _noise_dim(*given: ArrayLike | None) -> int:
    """Length of the residual, which the noise tells."""
    shape = next((np.shape(noise) for noise in given if noise is not None), ())
    return int(shape[-1]) if shape else 1
