"""What a robust kernel is."""

from __future__ import annotations

from typing import ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@runtime_checkable
class Kernel(Protocol):
    """A robust loss ``rho`` on squared whitened residuals ``s = e^T Omega e``; ``rho(s) ~ s`` near zero.

    The cost of a block is ``sum rho(s)`` (without one half), and iteratively reweighted least squares scales
    each information matrix by ``weight(s) = rho'(s)``.
    """

    #: Number by which native code knows the kernel.
    native_id: ClassVar[int]

    @property
    def scale(self) -> float:
        """The kernel's parameter, in units of whitened residuals."""
        ...

    def rho(self, s: Array) -> Array:
        """Loss at squared whitened residuals ``(M,)``."""
        ...

    def weight(self, s: Array) -> Array:
        """Derivative of `rho`, ``(M,)``, in ``[0, 1]``."""
        ...
