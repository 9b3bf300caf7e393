"""Gaussian whitening and robust kernels."""

from clew.noise.kernel import Kernel

__all__ = ["Kernel"]
