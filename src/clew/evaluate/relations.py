"""Errors of relative poses against true relations.

Kümmerle, Steder, Dornhege, Ruhnke, Grisetti, Stachniss, Kleiner: On measuring the accuracy of SLAM
algorithms, Autonomous Robots 27 (2009): a global frame does not matter, only how the robot's poses lie to
each other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.evaluate.poses import (
    as_trajectory,
    check_poses,
    functions_of,
    in_common,
    poses_at,
    rotation_angles,
    translations,
    travelled,
)
from clew.evaluate.statistics import ErrorStatistics

Array = NDArray[np.float64]


class RelationSet(Protocol):
    """True relative poses, however they were come by (`clew.io.read_relations` reads them from a file)."""

    @property
    def first(self) -> Array:
        """``(M,)`` timestamps, seconds."""
        ...

    @property
    def second(self) -> Array:
        """``(M,)`` timestamps, seconds."""
        ...

    @property
    def T_first_second(self) -> Array:
        """``(M, 3)`` or ``(M, 7)`` pose of the robot at the second time in its frame at the first."""
        ...


@dataclass(frozen=True, eq=False)
class ReferenceRelations:
    """Relations taken from a reference trajectory.

    Attributes:
        first, second: ``(M,)`` timestamps, seconds.
        T_first_second: ``(M, 3)`` or ``(M, 7)`` relative poses.
        revisit: ``(M,)`` True where the robot came back later, False between successive poses.
    """

    first: Array
    second: Array
    T_first_second: Array
    revisit: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.first)

    def select(self, mask: NDArray[np.bool_]) -> ReferenceRelations:
        """Those relations where the mask ``(M,)`` is True."""
        return ReferenceRelations(self.first[mask], self.second[mask], self.T_first_second[mask],
                                  self.revisit[mask])


@dataclass(frozen=True)
class RelationErrors:
    """How far a trajectory's relative poses are from the true ones.

    Attributes:
        used: number of relations.
        unused: relations for which the trajectory has no pose near enough in time.
        translation: metres.
        rotation: radians.
    """

    used: int
    unused: int
    translation: ErrorStatistics
    rotation: ErrorStatistics

    def to_dict(self) -> dict[str, object]:
        """Plain numbers; translations in metres, rotations in degrees, as the field reports them."""
        return {"used": self.used, "unused": self.unused, "translation_m": self.translation.to_dict(),
                "rotation_deg": self.rotation.to_dict(180 / np.pi)}


def relation_errors(timestamps: Array, poses: Array, relations: RelationSet, *,
                    tolerance: float = 0.5) -> RelationErrors:
    """Errors ``truth^-1 (T(t1)^-1 T(t2))`` of a trajectory, as lengths of translations and angles.

    Args:
        timestamps: ``(N,)`` seconds.
        poses: ``(N, 3)`` or ``(N, 7)`` poses ``T_world_robot`` of the trajectory, interpolated between
            timestamps.
        relations: the truth.
        tolerance: a relation is used where the trajectory has poses this near in time to both its ends,
            seconds.

    Raises:
        InputError: arrays that do not fit, or a negative tolerance.
    """
    timestamps, poses = as_trajectory(timestamps, poses, "trajectory")
    truth = np.asarray(relations.T_first_second, dtype=np.float64)
    check_poses(truth, "relations")
    if relations.first.shape != truth.shape[:1] or relations.second.shape != truth.shape[:1]:
        raise InputError("relations: there must be two timestamps for each relative pose")
    if not tolerance >= 0.0:
        raise InputError(f"tolerance of {tolerance:g} s: must not be negative")
    poses, truth = in_common(poses, truth)
    group = functions_of(poses)
    at_first, known_first = poses_at(timestamps, poses, relations.first, tolerance)
    at_second, known_second = poses_at(timestamps, poses, relations.second, tolerance)
    known = known_first & known_second
    error = group.between(truth[known], group.between(at_first[known], at_second[known]))
    return RelationErrors(int(known.sum()), int((~known).sum()),
                          ErrorStatistics.of(np.linalg.norm(translations(error), axis=1)),
                          ErrorStatistics.of(rotation_angles(error)))


def relations_from_reference(timestamps: Array, poses: Array, *, max_distance: float = 1.0,
                             max_turn: float = np.pi / 3, min_travelled: float = 10.0,
                             max_gap: float = 30.0) -> ReferenceRelations:
    """Relations between reference poses that are close to each other; the same choice for the same reference.

    Successive: each pose with the next, at most `max_gap` seconds and `max_distance` metres apart.
    Revisits: each pose with the nearest in space of those that came `min_travelled` metres of way or more
    before it, where that is within `max_distance` and looks the same way but for `max_turn` (such scans
    overlap, so the reference knows their relative pose well). The earlier of two that are as near is taken.

    Args:
        timestamps: ``(N,)`` seconds.
        poses: ``(N, 3)`` or ``(N, 7)`` reference poses.
        max_distance: metres.
        max_turn: radians.
        min_travelled: metres along the reference.
        max_gap: seconds.

    Raises:
        InputError: arrays that do not fit.
    """
    timestamps, poses = as_trajectory(timestamps, poses, "reference")
    poses, _ = in_common(poses, poses)
    group = functions_of(poses)
    positions, way = translations(poses), travelled(poses)

    before = np.arange(len(poses) - 1)
    step = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    before = before[(np.diff(timestamps) <= max_gap) & (step <= max_distance)]

    from scipy.spatial import cKDTree  # slow to import, and seldom needed

    pairs = cKDTree(positions).query_pairs(max_distance, output_type="ndarray")
    early, late = pairs.min(axis=1), pairs.max(axis=1)
    relative = group.between(poses[early], poses[late])
    again = (way[late] - way[early] >= min_travelled) & (rotation_angles(relative) <= max_turn)
    early, late = early[again], late[again]
    distance = np.linalg.norm(positions[early] - positions[late], axis=1)
    order = np.lexsort((early, distance, late))
    _, nearest = np.unique(late[order], return_index=True)
    chosen = order[nearest]

    one = np.concatenate([before, early[chosen]])
    other = np.concatenate([before + 1, late[chosen]])
    revisit = np.arange(len(one)) >= len(before)
    return ReferenceRelations(timestamps[one], timestamps[other], group.between(poses[one], poses[other]),
                              revisit)
