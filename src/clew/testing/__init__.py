"""Laws that users can run on their own factors, kernels and manifolds, and tiny graphs with exact answers."""

from clew.testing.factor_laws import check_factor
from clew.testing.kernel_laws import check_kernel
from clew.testing.manifold_laws import LAWS, check_manifold
from clew.testing.numeric import REGIMES, numeric_jacobian, random_elements, random_tangents
from clew.testing.tiny_graphs import (
    TINY_GRAPHS,
    TinyGraph,
    outlier,
    stretched_line,
    triangle,
    two_opinions,
    two_poses,
)

__all__ = [
    "LAWS",
    "REGIMES",
    "TINY_GRAPHS",
    "TinyGraph",
    "check_factor",
    "check_kernel",
    "check_manifold",
    "numeric_jacobian",
    "outlier",
    "random_elements",
    "random_tangents",
    "stretched_line",
    "triangle",
    "two_opinions",
    "two_poses",
]
