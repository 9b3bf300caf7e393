"""What a factor is: a block of measurements of one kind, evaluated together."""

from __future__ import annotations

from abc import ABC, abstractmethod
from enum import Enum
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.geometry import forward_jacobians
from clew.noise import Kernel

Array = NDArray[np.float64]
Keys = NDArray[np.int64]


class Role(str, Enum):
    """What a factor stands for; pictures and reports tell edges apart by it."""

    ODOMETRY = "odometry"
    OBSERVATION = "observation"
    LOOP = "loop"
    PRIOR = "prior"
    MARGINAL = "marginal"  # what variables knew that have been taken out (`clew.marginalise`)


class Factor(ABC):
    """A block of ``M`` measurements of one kind; a single measurement is a block of one.

    A subclass sets the attributes below in its constructor and gives `residual`; it may give `jacobians`
    (analytic, with respect to the tangents of `Manifold.retract`), otherwise forward differentiation
    supplies them. Factors are immutable; the graph stores them in blocks of one kind.

    Attributes:
        keys: ``(M, arity)`` keys of the variables, as `FactorGraph.add_pose` and `add_point` return them.
        kinds: the manifold of each key (`SE2`, `SE3`, `Point2`, `Point3`), one a position.
        measurement: ``(M, k)`` what was measured, in the storage order of the factor's docstring; ``k`` may
            be 0.
        information: ``(M, d, d)`` symmetric information of the residual.
        kernel: robust kernel of the block or None.
        role: what the measurements stand for.
        T_robot_sensor: storage of the sensor's pose on the robot, ``(storage,)``, or None for the identity.
    """

    #: Name of the model for `native/solve`, which with `kinds` finds its kernel; None: plain Python.
    native: ClassVar[str | None] = None

    keys: Keys
    kinds: tuple[type[Any], ...]
    measurement: Array
    information: Array
    kernel: Kernel | None
    role: Role
    T_robot_sensor: Array | None = None

    @property
    def residual_dim(self) -> int:
        """Length ``d`` of one residual."""
        return int(self.information.shape[-1])

    def __len__(self) -> int:
        return int(self.keys.shape[0])

    @abstractmethod
    def residual(self, *values: Array, measurement: Array) -> Array:
        """Predicted minus measured, ``(M, d)``, not whitened; `values` are ``(M, storage)``, one a key."""

    def jacobians(self, *values: Array, measurement: Array) -> tuple[Array, ...] | None:
        """Derivatives ``(M, d, dim)`` of `residual`, one a key, or None to have them computed."""
        return None

    def linearise(self, *values: Array) -> tuple[Array, tuple[Array, ...]]:
        """Residual ``(M, d)`` and Jacobians ``(M, d, dim)``, one a key, at `values`.

        From `jacobians` where the factor gives them, else exact by forward differentiation of `residual`.

        Raises:
            InputError: the residual has another shape than the information asks for, or cannot be
                differentiated.
        """
        jacobians = self.jacobians(*values, measurement=self.measurement)
        if jacobians is not None:
            error = self.residual(*values, measurement=self.measurement)
        else:
            error, jacobians = forward_jacobians(self.residual, self.kinds, values, self.measurement)
        if error.shape != (len(self), self.residual_dim):
            raise InputError(
                f"{type(self).__name__}: the residual has shape {error.shape}, but its noise is for "
                f"({len(self)}, {self.residual_dim}); give noise of the residual's length"
            )
        return error, jacobians
