"""Trajectory and relation metrics."""

from clew.evaluate.poses import associate, poses_at
from clew.evaluate.relations import (
    ReferenceRelations,
    RelationErrors,
    RelationSet,
    relation_errors,
    relations_from_reference,
)
from clew.evaluate.statistics import ErrorStatistics
from clew.evaluate.trajectory import (
    AbsoluteError,
    RelativeError,
    absolute_trajectory_error,
    align,
    relative_pose_error,
)

__all__ = [
    "AbsoluteError",
    "ErrorStatistics",
    "ReferenceRelations",
    "RelationErrors",
    "RelationSet",
    "RelativeError",
    "absolute_trajectory_error",
    "align",
    "associate",
    "poses_at",
    "relation_errors",
    "relations_from_reference",
    "relative_pose_error",
]
