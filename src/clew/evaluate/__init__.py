"""Metrics: trajectories, relations, self-consistency, and how a graph holds together."""

from clew.evaluate.connectivity import PathCuts, bridges, path_cuts, stretches
from clew.evaluate.consistency import PairErrors, pair_errors, revisiting_pairs
from clew.evaluate.nees import Consistency, consistency, effective_count, normalised_squares
from clew.evaluate.poses import associate, poses_at
from clew.evaluate.relations import (
    ReferenceRelations,
    RelationErrors,
    RelationSet,
    relation_errors,
    relations_from_reference,
)
from clew.evaluate.residuals import ROLES, FactorResiduals, factor_residuals
from clew.evaluate.slip import OdometrySlip, odometry_slip
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
    "ROLES",
    "AbsoluteError",
    "Consistency",
    "ErrorStatistics",
    "FactorResiduals",
    "OdometrySlip",
    "PairErrors",
    "PathCuts",
    "ReferenceRelations",
    "RelationErrors",
    "RelationSet",
    "RelativeError",
    "WallSpread",
    "absolute_trajectory_error",
    "align",
    "associate",
    "bridges",
    "consistency",
    "effective_count",
    "factor_residuals",
    "normalised_squares",
    "odometry_slip",
    "pair_errors",
    "path_cuts",
    "poses_at",
    "relation_errors",
    "relations_from_reference",
    "relative_pose_error",
    "revisiting_pairs",
    "stretches",
    "wall_spread",
]
