"""Trajectory and relation metrics."""

from clew.evaluate.consistency import PairErrors, pair_errors, revisiting_pairs
from clew.evaluate.poses import associate, poses_at
from clew.evaluate.relations import (
    ReferenceRelations,
    RelationErrors,
    RelationSet,
    relation_errors,
    relations_from_reference,
)
from clew.evaluate.spread import WallSpread, wall_spread
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
    "PairErrors",
    "ReferenceRelations",
    "RelationErrors",
    "RelationSet",
    "RelativeError",
    "WallSpread",
    "absolute_trajectory_error",
    "align",
    "associate",
    "pair_errors",
    "poses_at",
    "relation_errors",
    "relations_from_reference",
    "relative_pose_error",
    "revisiting_pairs",
    "wall_spread",
]
