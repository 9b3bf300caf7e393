"""How well a trajectory agrees with its own scans: measures that need no truth.

The relative pose of two scans of one place, taken at different visits, is measured by aligning the two scans with each
other; and where all visits agree, the returns of all scans lie on thin walls.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.evaluate.poses import as_trajectory, check_poses, functions_of, rotation_angles, translations, travelled
from clew.evaluate.statistics import ErrorStatistics

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class PairErrors:
    """Relative poses of a trajectory against those that the scans themselves give.

    Attributes:
        used: number of pairs.
        unused: pairs whose scans do not tell their relative pose well.
        translation: metres.
        rotation: radians.
    """

    used: int
    unused: int
    translation: ErrorStatistics
    rotation: ErrorStatistics

    def to_dict(self) -> dict[str, object]:
        """Plain numbers; translations in metres, rotations in degrees."""
        return {"used": self.used, "unused": self.unused, "translation_m": self.translation.to_dict(),
                "rotation_deg": self.rotation.to_dict(180 / np.pi)}


def revisiting_pairs(timestamps: Array, poses: Array, *, max_distance: float = 1.0, max_turn: float = np.pi / 3,
                     min_travelled: float = 10.0, spacing: float = 0.1, each: int = 3, limit: int = 3000) -> Indices:
    """Pairs of poses near each other in space, but not in time; the same choice for the same trajectory.

    Poses are thinned to `spacing`, so that a robot that stands still does not count again and again. Each is paired
    with the nearest in space of those that came `min_travelled` metres of way or more before it, at most one of each
    earlier visit, and `each` in all. If there are more than `limit`, evenly spaced ones are kept.

    Args:
        timestamps: ``(N,)`` seconds, increasing.
        poses: ``(N, 3)`` or ``(N, 7)``.
        max_distance: metres.
        max_turn: radians.
        min_travelled: metres along the trajectory; also between two earlier visits.
        spacing: metres along the trajectory.
        each: pairs for one pose at most.
        limit: pairs in all at most.

    Returns:
        ``(P, 2)`` rows of the trajectory, the earlier pose first.

    Raises:
        InputError: arrays that do not fit, or timestamps that do not increase.
    """
    sorted_times, poses = as_trajectory(timestamps, poses, "trajectory")
    if len(sorted_times) != len(timestamps) or np.any(sorted_times != timestamps):
        raise InputError("trajectory: timestamps must increase")
    way = travelled(poses)
    _, kept = np.unique(np.floor(way / spacing), return_index=True)
    way, thinned = way[kept], poses[kept]
    from scipy.spatial import cKDTree  # slow to import, and seldom needed

    near = cKDTree(translations(thinned)).query_pairs(max_distance, output_type="ndarray")
    early, late = near.min(axis=1), near.max(axis=1)
    turn = rotation_angles(functions_of(thinned).between(thinned[early], thinned[late]))
    again = (way[late] - way[early] >= min_travelled) & (turn <= max_turn)
    early, late = early[again], late[again]
    distance = np.linalg.norm(translations(thinned)[early] - translations(thinned)[late], axis=1)
    # The nearest of each earlier visit; visits are told apart by the stretch of way that they lie on.
    visit = np.floor(way[early] / min_travelled)
    order = np.lexsort((early, distance, visit, late))
    early, late, visit, distance = early[order], late[order], visit[order], distance[order]
    first = np.ones(len(order), dtype=np.bool_)
    first[1:] = (late[1:] != late[:-1]) | (visit[1:] != visit[:-1])
    early, late, distance = early[first], late[first], distance[first]
    order = np.lexsort((early, distance, late))
    early, late = early[order], late[order]
    rank = np.arange(len(late)) - np.searchsorted(late, late)
    pairs = np.stack([kept[early[rank < each]], kept[late[rank < each]]], axis=1)
    if len(pairs) > limit:
        pairs = pairs[np.linspace(0, len(pairs) - 1, limit).round().astype(np.int64)]
    return np.asarray(pairs, dtype=np.int64)


def pair_errors(poses: Array, pairs: Indices, T_first_second: Array, known: NDArray[np.bool_]) -> PairErrors:
    """Errors of the relative poses of a trajectory against measured ones.

    Args:
        poses: ``(N, 3)`` or ``(N, 7)`` trajectory.
        pairs: ``(P, 2)`` rows of the trajectory.
        T_first_second: ``(P, 3)`` or ``(P, 7)`` measured pose of the second seen from the first.
        known: ``(P,)`` where the measurement can be relied on.

    Raises:
        InputError: arrays that do not fit.
    """
    check_poses(poses, "trajectory")
    check_poses(T_first_second, "measured pairs")
    fitting = pairs.shape == (len(T_first_second), 2) and known.shape == (len(pairs),)
    if not fitting or T_first_second.shape[1] != poses.shape[1]:
        raise InputError("measured pairs: give one pose and one flag for each pair, of the trajectory's kind")
    group = functions_of(poses)
    chosen = pairs[known]
    error = group.between(T_first_second[known], group.between(poses[chosen[:, 0]], poses[chosen[:, 1]]))
    return PairErrors(int(known.sum()), int((~known).sum()),
                      ErrorStatistics.of(np.linalg.norm(translations(error), axis=1)),
                      ErrorStatistics.of(rotation_angles(error)))
