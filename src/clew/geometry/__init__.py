"""Rigid motions and points as batches of arrays: SE2, SE3, SO2, SO3, Point2, Point3.

Two layers: the classes, and below them plain functions on arrays (`SE2.functions` is the module
`clew.geometry.se2`) for code that works on whole problems.
"""

from clew.geometry import points, se2, se3, so2, so3
from clew.geometry.angles import wrap
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
    "Manifold",
    "ManifoldFunctions",
    "Point2",
    "Point3",
    "act_jacobians",
    "between_jacobians",
    "compose_jacobians",
    "inverse_jacobian",
    "local_jacobians",
    "points",
    "se2",
    "se3",
    "so2",
    "so3",
    "wrap",
]
