"""The laws of a robust kernel."""

from __future__ import annotations

import numpy as np

from clew.noise import Kernel
from clew.testing.numeric import require


def check_kernel(kernel: Kernel, *, tolerance: float = 2e-5) -> None:
    """Check that a kernel is a robust loss on squared residuals.

    ``rho(0) = 0``, ``weight(0) = 1``, ``weight`` in ``[0, 1]`` and equal to ``rho'``, ``rho`` not decreasing
    and never above ``s``; from a millionth of ``scale^2`` to a million times it.

    Raises:
        AssertionError: saying which law is broken and where.
    """
    name = repr(kernel)
    origin = np.zeros(1)
    start, full = float(kernel.rho(origin)[0]), float(kernel.weight(origin)[0])
    require(start == 0.0, f"{name}: rho(0) is {start}, not 0")
    require(abs(full - 1.0) < 1e-12, f"{name}: weight(0) is {full}, not 1")
    s = kernel.scale**2 * np.concatenate((np.logspace(-6, 6, 2401), np.linspace(0.5, 2.0, 301)))
    s.sort()
    rho, weight = kernel.rho(s), kernel.weight(s)
    require(rho.shape == s.shape == weight.shape, f"{name}: shapes of rho or weight differ from that of s")
    require(np.isfinite([rho, weight]).all(), f"{name}: rho or weight is not finite")
    inside = (weight >= 0.0) & (weight <= 1.0)
    worst = int(np.argmin(inside))
    require(inside.all(), f"{name}: weight({s[worst]:.6g}) = {weight[worst]:.6g} is not in [0, 1]")
    require((np.diff(rho) >= -1e-12 * rho[1:]).all(), f"{name}: rho decreases")
    require((rho <= s * (1.0 + 1e-12)).all(), f"{name}: rho grows faster than s")
    step = 1e-5 * s
    slope = (kernel.rho(s + step) - kernel.rho(s - step)) / (2.0 * step)
    right = np.abs(slope - weight) <= tolerance
    worst = int(np.argmin(right))
    require(
        right.all(),
        f"{name}: weight({s[worst]:.6g}) is {weight[worst]:.6g}, but the slope of rho is {slope[worst]:.6g}",
    )
