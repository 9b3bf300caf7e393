"""A joint measurement of many variables: what the exact marginal is."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.factors.measured import Measured
from clew.graph import Role
from clew.reduce.relation import is_pose

Array = NDArray[np.float64]


class JointMeasurement(Measured):
    """Several variables seen at once from the first of them, a pose, or from the world's origin; errors correlated.

    Residual: ``local(z_i, a^-1 b_i)`` of each variable ``b_i`` seen from the first, one after the other (the difference
    of coordinates for a point); ``local(z_i, b_i)`` of all where it is seen from the world. It depends on nothing but
    relative poses, so that it holds wherever the whole is moved (root shift of Carlevaris-Bianco, Kaess, Eustice:
    Generic node removal for factor-graph SLAM, T-RO 2014).
    """

    def __init__(
        self, keys: ArrayLike, kinds: tuple[type[Any], ...], measurement: Array, information: Array, *, from_world: bool
    ) -> None:
        """One joint measurement.

        Args:
            keys: ``(k,)`` keys.
            kinds: their manifolds.
            measurement: storages of what is seen, one after the other, ``(m,)``.
            information: ``(d, d)`` of all residuals.
            from_world: whether the first variable is seen from the world, too, instead of being the one that sees.
        """
        self.from_world = from_world
        self._set_up(
            np.asarray(keys, dtype=np.int64)[None], kinds, measurement, information.shape[-1],
            sigmas=None, information=information, covariance=None, kernel=None, role=Role.MARGINAL,
        )  # fmt: skip

    def residual(self, *values: Array, measurement: Array) -> Array:
        """``(M, d)``."""
        return np.concatenate([self._local(kind, z, x) for kind, z, x in self._seen(values, measurement)], axis=1)

    def jacobians(self, *values: Array, measurement: Array) -> tuple[Array, ...]:
        """``(M, d, dim)``, one a variable."""
        count = len(measurement)
        out = [np.zeros((count, self.residual_dim, kind.dim)) for kind in self.kinds]
        row = 0
        first = 0 if self.from_world else 1
        frame: Any = self.kinds[0].functions
        for number, (kind, z, seen) in enumerate(self._seen(values, measurement), first):
            rows = slice(row, row + kind.dim)
            row = rows.stop
            if self.from_world:
                out[number][:, rows] = self._by_seen(kind, z, seen)
            elif is_pose(kind):
                by_seen = self._by_seen(kind, z, seen)
                out[number][:, rows] = by_seen
                out[0][:, rows] = -by_seen @ frame.adjoint(frame.inverse(seen))
            else:
                by_frame, by_point = frame.act_jacobians(frame.inverse(values[0]), values[number])
                out[number][:, rows] = by_point
                # a right step of the frame moves its inverse by minus the adjoint of that step
                out[0][:, rows] = -by_frame @ frame.adjoint(values[0])
        return tuple(out)

    def _seen(self, values: tuple[Array, ...], measurement: Array) -> list[tuple[type[Any], Array, Array]]:
        """Kind, measured and predicted storage of all that is seen."""
        frame: Any = self.kinds[0].functions
        out, start = [], 0
        for number in range(0 if self.from_world else 1, len(self.kinds)):
            kind: Any = self.kinds[number]
            z = measurement[:, start : start + kind.storage]
            start += kind.storage
            if self.from_world:
                seen = values[number]
            elif is_pose(kind):
                seen = frame.between(values[0], values[number])
            else:
                seen = frame.act(frame.inverse(values[0]), values[number])
            out.append((kind, z, seen))
        return out

    @staticmethod
    def _local(kind: Any, z: Array, seen: Array) -> Array:
        return np.asarray(kind.functions.local(z, seen))

    @staticmethod
    def _by_seen(kind: Any, z: Array, seen: Array) -> Array:
        return np.asarray(kind.functions.local_jacobians(z, seen)[1])
