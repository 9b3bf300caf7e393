"""Landmark SLAM with known identities: one robot or several, with calibration and noise found from the data."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.evaluate import align
from clew.geometry import SE2, Point2, se2, so2
from clew.graph import FactorGraph
from clew.io import SightingLog
from clew.slam.landmarks.model import SCALE_UNCERTAINTY, Marks, SensorModel
from clew.slam.landmarks.plain import plain_graph
from clew.slam.landmarks.settle import Settled, settle
from clew.slam.landmarks.start import dead_reckoning, first_map, read_solution
from clew.slam.landmarks.track import RobotTrack, make_tracks
from clew.solve import Solution

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Told the stage, how much of it is done, and how much it is at most.
Progress = Callable[[str, int, int], None]

_ROUNDS = 15
_ROUNDS_BEFORE = 6  # for each robot by itself, where all are solved as one after that
_ROUNDS_TOGETHER = 10  # from there on
_FEWEST_COMMON = 3  # landmarks that tell how two robots' maps lie to each other


@dataclass(frozen=True, eq=False)
class RobotEstimate:
    """What was found out about one robot.

    Attributes:
        robot: its number.
        keys: ``(N,)`` keys of its poses in the graph.
        timestamps: ``(N,)`` seconds.
        T_world_robot: ``(N, 3)`` poses.
        covariances: ``(N, 3, 3)`` of the poses, each in its own tangent; what is uncertain about the
            calibration is in them.
        T_odom_robot: ``(N, 3)`` where its odometry alone, as it is, leads.
        model: calibration and noise.
    """

    robot: int
    keys: Indices
    timestamps: Array
    T_world_robot: Array
    covariances: Array
    T_odom_robot: Array
    model: SensorModel


@dataclass(frozen=True, eq=False)
class LandmarkMap:
    """Robots and landmarks in one frame: that of the first robot's first keyframe.

    Attributes:
        robots: see `RobotEstimate`.
        identity: ``(L,)`` numbers of the landmarks, which are their keys in the graph.
        position: ``(L, 2)`` metres.
        covariance: ``(L, 2, 2)`` of the positions.
        sightings: ``(L,)`` how often each was seen.
        marks: how much their marks differ.
        graph: the calibrated measurements as factors that every file format and every other part of clew knows, at
            the solution: relative poses, and points in the frame of the robot. Pose keys are
            ``robot * KEYS_A_ROBOT + i``.
        solution: of the graph that has the calibrations as variables; with the covariances that sightings leave whose
            errors follow Student's t distribution, see `clew.slam.landmarks.student`.
        tracks: the logs on their keyframes.
    """

    robots: tuple[RobotEstimate, ...]
    identity: Indices
    position: Array
    covariance: Array
    sightings: Indices
    marks: Marks
    graph: FactorGraph
    solution: Solution
    tracks: tuple[RobotTrack, ...]


def map_landmarks(logs: Sequence[SightingLog], *, progress: Progress | None = None) -> LandmarkMap:
    """Map what the robots saw, from odometry and recognised landmarks alone.

    Each robot is mapped by itself; several are then joined where they have landmarks in common and solved as one,
    with what they saw of each other. Calibration and noise of each robot are estimated on the way.

    Args:
        logs: of one robot or several.
        progress: called with the name of a stage, how much of it is done, and how much it is at most: sightings that
            are in a first map ("mapping"), rounds of estimating noise ("calibrating"), both over all robots, and rounds
            with all robots in one graph ("joining").

    Raises:
        InputError: no log, two of one robot, a robot that saw too little, or robots without three landmarks in common.
    """
    if not logs:
        raise InputError("map_landmarks: give the log of at least one robot")
    tracks = make_tracks(logs)
    _join([dict.fromkeys(np.unique(log.landmarks.identity).tolist(), np.zeros(2)) for log in logs], tracks)
    rounds = _ROUNDS if len(logs) == 1 else _ROUNDS_BEFORE
    sightings = np.cumsum([0, *(len(log.landmarks) for log in logs)]).tolist()
    firsts = [
        _first(log, _counter(progress, "mapping", before, sightings[-1]))
        for log, before in zip(logs, sightings, strict=False)
    ]
    most = len(logs) * rounds
    alone = [
        settle(*first, rounds, _counter(progress, "calibrating", number * rounds, most))
        for number, first in enumerate(firsts)
    ]
    _counter(progress, "calibrating", 0, most)(most)
    if len(logs) == 1:
        return _result(alone[0])
    models = [one.models[0] for one in alone]
    maps = [read_solution(one.solution, one.tracks[0]) for one in alone]
    shifts, landmarks = _join([points for _, points, _ in maps], tracks)
    poses = [
        _at_times(one.tracks[0], se2.compose(shift, its_poses), track)
        for one, (its_poses, _, _), shift, track in zip(alone, maps, shifts, tracks, strict=True)
    ]
    joining = _counter(progress, "joining", 0, _ROUNDS_TOGETHER)
    together = settle(tracks, models, poses, landmarks, _ROUNDS_TOGETHER, joining)
    joining(_ROUNDS_TOGETHER)
    return _result(together)


def _counter(progress: Progress | None, stage: str, before: int, most: int) -> Callable[[int], None]:
    def count(done: int) -> None:
        if progress is not None:
            progress(stage, before + done, most)

    return count


def _first(
    log: SightingLog, progress: Callable[[int], None]
) -> tuple[tuple[RobotTrack, ...], list[SensorModel], list[Array], dict[int, Array]]:
    tracks = make_tracks([log])
    poses, landmarks, model = first_map(tracks[0], progress)
    return tracks, [model], [poses], landmarks


def _join(
    maps: Sequence[dict[int, Array]], tracks: Sequence[RobotTrack]
) -> tuple[list[Array], dict[int, Array]]:
    """Motion ``(3,)`` of each map onto the first, and all landmarks there; the map with most in common comes next."""
    joined = dict(maps[0])
    shifts: dict[int, Array] = {0: np.zeros(3)}
    while len(shifts) < len(maps):
        open_maps = [n for n in range(len(maps)) if n not in shifts]
        best = max(open_maps, key=lambda n: len(maps[n].keys() & joined.keys()))
        common = sorted(maps[best].keys() & joined.keys())
        if len(common) < _FEWEST_COMMON:
            raise InputError(
                f"robot {tracks[best].log.robot} has {len(common)} landmarks in common with the others, and "
                f"{_FEWEST_COMMON} are needed to tell where it was; nothing was merged"
            )
        shift = align(np.array([joined[i] for i in common]), np.array([maps[best][i] for i in common]))
        shifts[best] = shift
        for identity, point in maps[best].items():
            joined.setdefault(identity, se2.act(shift, point))
    return [shifts[n] for n in range(len(maps))], joined


def _at_times(known: RobotTrack, poses: Array, track: RobotTrack) -> Array:
    """Poses at the keyframes of `track`, which has more of them than the track of the poses."""
    step = se2.log(se2.between(poses[:-1], poses[1:]))
    left = np.clip(np.searchsorted(known.timestamps, track.timestamps, side="right") - 1, 0, len(step) - 1)
    share = (track.timestamps - known.timestamps[left]) / np.diff(known.timestamps)[left]
    return se2.compose(poses[left], se2.exp(np.clip(share, 0.0, 1.0)[:, None] * step[left]))


def _result(settled: Settled) -> LandmarkMap:
    tracks, models, solution = settled.tracks, settled.models, settled.solution
    rows = {int(key): row for row, key in enumerate(solution.keys(SE2))}
    poses = solution.values(SE2).array
    # A wrong scale of the ranges scales everything about the pose that is held, which is the origin or nearly so.
    held = poses[rows[int(tracks[0].keys[0])], :2]
    arms = so2.act(-poses[:, 2:], poses[:, :2] - held)
    pose_covariances = solution.covariances(SE2)
    pose_covariances[:, :2, :2] += SCALE_UNCERTAINTY**2 * arms[:, :, None] * arms[:, None, :]
    robots = []
    for track, model in zip(tracks, models, strict=True):
        first = rows[int(track.keys[0])]
        mine = slice(first, first + len(track.timestamps))
        odometry = dead_reckoning(track.motions(SensorModel()))
        robots.append(
            RobotEstimate(track.log.robot, track.keys, track.timestamps, poses[mine],
                          pose_covariances[mine], odometry, model)
        )  # fmt: skip
    seen = np.concatenate([track.log.landmarks.identity for track in tracks])
    identity, sightings = np.unique(seen, return_counts=True)
    place = {int(key): row for row, key in enumerate(solution.keys(Point2))}
    chosen = [place[int(i)] for i in identity]
    points, covariances = solution.values(Point2).array[chosen], solution.covariances(Point2)[chosen]
    arms = points - held
    covariances += SCALE_UNCERTAINTY**2 * arms[:, :, None] * arms[:, None, :]
    return LandmarkMap(
        tuple(robots), identity, points, covariances,
        sightings, settled.marks, plain_graph(tracks, models, solution, settled.factors), solution, tracks,
    )  # fmt: skip
