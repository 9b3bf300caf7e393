"""A first map of one robot, piece by piece as it drove, so that no stretch starts far from where it belongs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from clew.evaluate import align
from clew.geometry import SE2, Point2, se2
from clew.slam.landmarks.graph import build_graph
from clew.slam.landmarks.model import Calibration, SensorModel
from clew.slam.landmarks.track import RobotTrack
from clew.solve import Solution, optimize

Array = NDArray[np.float64]

_PIECE, _GROWTH = 20.0, 0.1  # seconds; share of what is mapped before, if that is more
_FEWEST = 100  # keyframes before the calibration is believed
_LOST = 0.3  # metres between sightings and the map, in the median, at which a piece is set anew
_FOUND = 0.5  # share of that distance that must remain at most


def first_map(
    track: RobotTrack, progress: Callable[[int], None]
) -> tuple[Array, dict[int, Array], SensorModel]:
    """Poses ``(N, 3)``, landmarks and calibration from solving ever longer parts of the log.

    Each new piece is attached by odometry; where the landmarks that it sees lie far from where they were, it is first
    moved rigidly onto them. `progress` is told how many sightings are in the map.
    """
    model, poses, landmarks = SensorModel(), np.zeros((1, 3)), dict[int, Array]()
    for end in _ends(float(track.timestamps[0]), float(track.timestamps[-1])):
        part = track.until(end)
        if len(part.timestamps) == len(poses) or not len(part.log.landmarks):
            continue
        poses = _set_onto(part, _attached(part, model, poses), len(poses), model, landmarks)
        for identity, point in _first_seen(part, poses, model).items():
            landmarks.setdefault(identity, point)
        graph, *_ = build_graph([part], [model], [poses], landmarks)
        solution = optimize(graph, init="file", max_iterations=15, cost_tolerance=1e-4)
        poses, landmarks, calibration = read_solution(solution, part)
        if len(poses) > _FEWEST:
            model = replace(model, calibration=calibration)
        progress(len(part.log.landmarks))
    return poses, landmarks, model


def _ends(begin: float, end: float) -> list[float]:
    """Times up to which the parts go."""
    ends = [begin]
    while ends[-1] < end:
        ends.append(min(ends[-1] + max(_PIECE, _GROWTH * (ends[-1] - begin)), end))
    return ends[1:]


def read_solution(solution: Solution, track: RobotTrack) -> tuple[Array, dict[int, Array], Calibration]:
    """A robot's poses, all landmarks, and the robot's calibration."""
    poses, points = solution.values(SE2).array, solution.values(Point2).array
    pose_row = {int(key): row for row, key in enumerate(solution.keys(SE2))}
    first = pose_row[int(track.keys[0])]
    point_row = {int(key): row for row, key in enumerate(solution.keys(Point2))}
    calibration = points[[point_row[key] for key in track.calibration_keys]]
    identities = np.unique(track.log.landmarks.identity).tolist()
    landmarks = {identity: points[point_row[identity]] for identity in identities}
    return poses[first : first + len(track.timestamps)], landmarks, Calibration.from_points(calibration)


def _attached(part: RobotTrack, model: SensorModel, poses: Array) -> Array:
    """Known poses, followed by those that odometry leads to."""
    reckoned = dead_reckoning(part.motions(model))
    last = len(poses) - 1
    moved = se2.compose(poses[last], se2.between(reckoned[last], reckoned[last + 1 :]))
    return np.concatenate([poses, moved])


def dead_reckoning(motion: Array) -> Array:
    """Poses ``(S + 1, 3)`` from the identity on, composed of motions ``(S, 3)``."""
    heading = np.append(0.0, np.cumsum(motion[:, 2]))
    cos, sin = np.cos(heading[:-1]), np.sin(heading[:-1])
    steps = np.stack([cos * motion[:, 0] - sin * motion[:, 1], sin * motion[:, 0] + cos * motion[:, 1]], axis=1)
    return se2.canonical(np.column_stack([np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)]), heading]))


def _set_onto(
    part: RobotTrack, poses: Array, known: int, model: SensorModel, landmarks: dict[int, Array]
) -> Array:
    """Move the poses from `known` on rigidly to where the landmarks that they see were mapped, if that is far off."""
    seen, rows = part.log.landmarks, part.rows(part.log.landmarks)
    fresh = (rows >= known) & np.isin(seen.identity, list(landmarks))
    if len(np.unique(seen.identity[fresh])) < 2:
        return poses
    where = se2.act(poses[rows[fresh]], part.points(seen, model.calibration)[fresh])
    mapped = np.array([landmarks[int(i)] for i in seen.identity[fresh]])
    shift = align(mapped, where)
    before = float(np.median(np.linalg.norm(mapped - where, axis=1)))
    after = float(np.median(np.linalg.norm(mapped - se2.act(shift, where), axis=1)))
    if before < _LOST or after > _FOUND * before:
        return poses
    return np.concatenate([poses[:known], se2.compose(shift, poses[known:])])


def _first_seen(part: RobotTrack, poses: Array, model: SensorModel) -> dict[int, Array]:
    """Where the first sighting of each landmark puts it."""
    seen = part.log.landmarks
    where = se2.act(poses[part.rows(seen)], part.points(seen, model.calibration))
    identities, first = np.unique(seen.identity, return_index=True)
    return {int(identity): where[row] for identity, row in zip(identities, first, strict=True)}
