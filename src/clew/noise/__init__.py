"""Gaussian whitening and robust kernels."""

from clew.noise.gaussian import (
    check_information,
    indefinite,
    information_from_covariance,
    information_from_matrix,
    information_from_sigmas,
    resolve_information,
    sqrt_information,
    whiten,
)
from clew.noise.kernel import Kernel
from clew.noise.kernels import DCS, Cauchy, GemanMcClure, Huber, PseudoHuber, Tukey, Welsch

__all__ = [
    "DCS",
    "Cauchy",
    "GemanMcClure",
    "Huber",
    "Kernel",
    "PseudoHuber",
    "Tukey",
    "Welsch",
    "check_information",
    "indefinite",
    "information_from_covariance",
    "information_from_matrix",
    "information_from_sigmas",
    "resolve_information",
    "sqrt_information",
    "whiten",
]
