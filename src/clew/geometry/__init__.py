"""Rigid motions and points as batches of arrays: SE2, SE3, SO2, SO3, Point2, Point3.

Two layers: the classes, and below them plain functions on arrays (`SE2.functions` is the module
`clew.geometry.se2`) for code that works on whole problems.
"""

from clew.geometry import dual_functions, dual_ufuncs, points, se2, se3, so2, so3
from clew.geometry.angles import wrap
from clew.geometry.differentiate import forward_jacobians
from clew.geometry.dual import Dual, primal
from clew.geometry.groups import SE2, SE3, SO2, SO3, Point2, Point3
from clew.geometry.jacobians import (
    act_jacobians,
    between_jacobians,
    compose_jacobians,
    inverse_jacobian,
    local_jacobians,
)
from clew.geometry.manifold import Manifold, ManifoldFunctions

__all__ = [
    "SE2",
    "SE3",
    "SO2",
    "SO3",
    "Dual",
    "Manifold",
    "ManifoldFunctions",
    "Point2",
    "Point3",
    "act_jacobians",
    "between_jacobians",
    "compose_jacobians",
    "dual_functions",
    "dual_ufuncs",
    "forward_jacobians",
    "inverse_jacobian",
    "local_jacobians",
    "points",
    "primal",
    "se2",
    "se3",
    "so2",
    "so3",
    "wrap",
]
