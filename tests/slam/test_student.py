"""How sure sightings with Student's t errors make: against how far solutions scatter when the errors are drawn anew."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from clew.geometry import Point2
from clew.io import SightingLog, Sightings, Velocities
from clew.io.log import ReadReport
from clew.slam.landmarks.graph import build_graph
from clew.slam.landmarks.model import Calibration, MarkNoise, Marks, SensorModel, SightingNoise
from clew.slam.landmarks.student import as_told
from clew.slam.landmarks.track import TAIL, make_tracks
from clew.solve import optimize

LANDMARKS, COUNT, SIGMA = 500, 30, 0.05


def seen_by_a_robot_that_stands(errors: np.ndarray) -> SightingLog:
    """Landmarks three metres ahead, each seen a few times; errors ``(LANDMARKS, COUNT)`` of the ranges."""
    identity, stamps = np.repeat(7 + np.arange(LANDMARKS), COUNT), np.tile(np.linspace(0.0, 8.0, COUNT), LANDMARKS)
    odometry = Velocities(np.array([0.0, 8.1]), np.zeros(2), np.zeros(2))
    order = np.argsort(stamps, kind="stable")
    seen = Sightings(stamps[order], identity[order], 3.0 + errors.reshape(-1)[order], np.zeros(errors.size))
    none = Sightings(*(np.empty(0, kind) for kind in (float, np.int64, float, float)))
    return SightingLog(Path("standing"), 1, odometry, seen, none, None, ReadReport())


@pytest.mark.parametrize(("tail", "scale"), [(TAIL, 1.0), (np.inf, 0.83)])
def test_deviations_are_those_of_solutions_with_errors_drawn_anew(
    tail: float, scale: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("clew.slam.landmarks.graph.PRIOR", Calibration(*[1e-6] * 14))
    rng, shape = np.random.default_rng(3), (LANDMARKS, COUNT)
    errors = SIGMA * (rng.standard_normal(shape) if np.isinf(tail) else rng.standard_t(tail, shape))
    model = replace(SensorModel(), landmarks=SightingNoise(scale * SIGMA, 0.01, 1e-5, 1e-5, 0.0))
    (track,) = make_tracks([seen_by_a_robot_that_stands(errors)])
    landmarks = {7 + k: np.array([3.0, 0.0]) for k in range(LANDMARKS)}
    start = np.zeros((len(track.timestamps), 3))
    graph, factors, _ = build_graph([track], [model], [start], landmarks, Marks(MarkNoise(1e-6, 1e-6)))
    graph.set_constant(track.keys)
    solution = optimize(graph, init="file")
    chosen = solution.keys(Point2) < 7 + LANDMARKS
    scatter = np.mean(np.square(solution.values(Point2).array[chosen, 0] - 3.0))
    weighed = np.mean(solution.covariances(Point2)[chosen, 0, 0])
    stated = np.mean(as_told(solution, factors)[0].covariances(Point2)[chosen, 0, 0])
    assert scatter == pytest.approx(stated, rel=0.2)  # the scatter itself is known to 6 per cent
    assert scatter > 1.2 * weighed  # what the robust weights alone would have said
