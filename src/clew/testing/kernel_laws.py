"""The laws of a robust kernel."""

from __future__ import annotations

import numpy as np

from clew.noise import Kernel


def check_kernel(kernel: Kernel, *, tolerance: float = 2e-5) -> None:
    """Check that a kernel is a robust loss on squared residuals.

    ``rho(0) = 0``, ``weight(0) = 1``, ``weight`` in ``[0, 1]`` and equal to ``rho'``, ``rho`` never decreasing and
    never above ``s``; from a millionth of ``scale^2`` to a million times it.

    Raises:
        AssertionError: saying which law is broken and where.
    """
    name = repr(kernel)
    origin = np.zeros(1)
    assert kernel.rho(origin)[0] == 0.0, f"{name}: rho(0) is {kernel.rho(origin)[0]}, not 0"
    assert abs(kernel.weight(origin)[0] - 1.0) < 1e-12, (
        f"{name}: weight(0) is {kernel.weight(origin)[0]}, not 1"
    )
    s = kernel.scale**2 * np.concatenate((np.logspace(-6, 6, 2401), np.linspace(0.5, 2.0, 301)))
    s.sort()
    rho, weight = kernel.rho(s), kernel.weight(s)
    assert rho.shape == s.shape and weight.shape == s.shape, f"{name}: shapes of rho or weight differ from s"
    assert np.isfinite(rho).all() and np.isfinite(weight).all(), f"{name}: rho or weight is not finite"
    outside = ~((weight >= 0.0) & (weight <= 1.0))
    assert not outside.any(), f"{name}: weight({s[outside][:1]}) = {weight[outside][:1]} is not in [0, 1]"
    assert (np.diff(rho) >= -1e-12 * rho[1:]).all(), f"{name}: rho decreases"
    assert (rho <= s * (1.0 + 1e-12)).all(), f"{name}: rho grows faster than s"
    step = 1e-5 * s
    slope = (kernel.rho(s + step) - kernel.rho(s - step)) / (2.0 * step)
    wrong = ~(np.abs(slope - weight) <= tolerance)
    assert not wrong.any(), (
        f"{name}: weight({s[wrong][0]:.6g}) = {weight[wrong][0]:.6g}, but the slope of rho is {slope[wrong][0]:.6g}"
    )
