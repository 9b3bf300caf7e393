"""Map, calibration and noise in turn, until they stay."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.linalg import FactorStatus
from clew.slam.landmarks.graph import RobotFactors, build_graph
from clew.slam.landmarks.model import Marks, SensorModel
from clew.slam.landmarks.noise import reestimate, reestimate_marks
from clew.slam.landmarks.start import read_solution
from clew.slam.landmarks.student import as_told
from clew.slam.landmarks.track import RobotTrack
from clew.solve import Solution, optimize

Array = NDArray[np.float64]

_SETTLED = 0.02  # change of the noise parameters that is not worth another round, as a share


@dataclass(frozen=True, eq=False)
class Settled:
    """What stayed.

    Attributes:
        tracks: the robots.
        models: calibration and noise of each.
        marks: how much the marks differ.
        solution: with the Gaussian around it in which sightings count as much as they tell.
        factors: of each robot, with that information.
    """

    tracks: tuple[RobotTrack, ...]
    models: list[SensorModel]
    marks: Marks
    solution: Solution
    factors: list[RobotFactors]


def settle(
    tracks: tuple[RobotTrack, ...], models: list[SensorModel], poses: list[Array], landmarks: dict[int, Array],
    rounds: int, progress: Callable[[int], None],
) -> Settled:
    """Solve and re-estimate the noise in turn, until it stays."""
    marks = Marks()
    for done, last in enumerate((*[False] * (rounds - 1), True)):
        progress(done)
        graph, factors, apart = build_graph(tracks, models, poses, landmarks, marks)
        solution = optimize(graph, init="file", max_iterations=40, cost_tolerance=1e-7 if last else 1e-5)
        if solution.posterior.factor.status is not FactorStatus.OK:
            names = " and ".join(f"robot {track.log.robot}" for track in tracks)
            raise InputError(
                f"{tracks[0].log.path}: what {names} saw does not fit the odometry well enough for a map; look whether "
                "times are of one clock, ranges in metres, bearings and turn rates in radians"
            )
        solution, told = as_told(solution, factors)
        landmarks, poses, found = {}, [], []
        for track, model in zip(tracks, models, strict=True):
            its_poses, its_landmarks, calibration = read_solution(solution, track)
            poses.append(its_poses)
            landmarks.update(its_landmarks)
            found.append(replace(model, calibration=calibration))
        updated = [reestimate(solution, *each) for each in zip(told, found, strict=True)]
        differ = reestimate_marks(solution, apart, marks)
        change = max(marks.change(differ), *(model.change(new) for model, new in zip(models, updated, strict=True)))
        if last or change < _SETTLED:
            break
        models, marks = updated, differ
    return Settled(tracks, found, marks, solution, told)
