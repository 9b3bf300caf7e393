"""What draws calibrations beside the cost, against derivatives of the determinant; deviations found from the data."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from clew.geometry import SE2, Point2, se2
from clew.io import SightingLog, Sightings
from clew.slam.landmarks.graph import build_graph
from clew.slam.landmarks.model import Calibration, Marks, SensorModel, SightingNoise
from clew.slam.landmarks.noise import reestimate, reestimate_marks
from clew.slam.landmarks.student import as_told
from clew.slam.landmarks.track import make_tracks
from clew.solve import Solution, optimize
from slam.test_landmarks import LANDMARKS, simulate

Array = NDArray[np.float64]
MODEL = SensorModel(landmarks=SightingNoise(0.05, 0.01, 0.05, 0.01))
#: Parameters of the calibration that stretch bearings: point and coordinate.
STRETCHING = [(4, 1), (5, 0), (5, 1)]


def exact(log: SightingLog) -> SightingLog:
    """The log as a perfect camera would have seen it."""
    assert log.truth is not None
    seen = log.landmarks
    at = np.searchsorted(log.truth[:, 0], seen.timestamp)
    q = se2.act(se2.inverse(log.truth[at, 1:]), LANDMARKS[seen.identity - 6])
    sightings = Sightings(seen.timestamp, seen.identity, np.hypot(*q.T), np.arctan2(q[:, 1], q[:, 0]))
    return replace(log, landmarks=sightings)


def test_the_pull_is_the_derivative_of_the_determinant_of_what_is_known_of_places(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # all that is known of the calibration is known of all of it: the other parameters do not spread along
    monkeypatch.setattr("clew.slam.landmarks.graph.PRIOR", Calibration(*[1e-4] * 14))
    log = exact(simulate(1, 3, np.array([0.5, -1.0, 0.3]), 12.0))
    (track,) = make_tracks([log])
    assert log.truth is not None
    poses = log.truth[np.searchsorted(log.truth[:, 0], track.timestamps - 1e-9), 1:]
    graph, (factors,), _ = build_graph([track], [MODEL], [poses], {k + 6: point for k, point in enumerate(LANDMARKS)})
    keys = np.array(track.calibration_keys)
    drawn = reestimate(optimize(graph, init="file", max_iterations=0), factors, MODEL).pull
    graph.set_constant(keys)

    def half_determinant(point: int, coordinate: int, step: float) -> float:
        at = graph.copy()
        value = np.zeros(2)
        value[coordinate] = step
        at.set_value(int(keys[point]), value)
        solution = optimize(at, init="file", max_iterations=0)
        return 0.5 * solution.posterior.factor.log_determinant()

    for point, coordinate in STRETCHING:
        h = 1e-4
        numeric = (half_determinant(point, coordinate, h) - half_determinant(point, coordinate, -h)) / (2 * h)
        size = max(abs(numeric), 0.02 * np.abs(drawn).max())
        assert drawn[point, coordinate] == pytest.approx(numeric, abs=0.03 * size), (point, coordinate)
    # growing with the unit of the odometry, ranges shortened: drawn by nothing, however many landmarks there are
    assert drawn[0, 0] - drawn[2, 0] == pytest.approx(0.0, abs=1.0)


def noise_found(true: SightingNoise, shares: Array, seconds: float, rounds: int = 12) -> tuple[SightingNoise, Marks]:
    """Of a camera with views that err as a whole, and marks ``(L,)`` that look too far by some shares."""
    rng = np.random.default_rng(6)
    log = exact(simulate(1, 4, np.array([0.5, -1.0, 0.3]), seconds))
    (track,) = make_tracks([log])
    seen = log.landmarks
    _, view = np.unique(track.view_keys(seen), return_inverse=True)
    error = true.range_bias * rng.standard_normal(view.max() + 1)[view]
    error = true.larger(seen.range) * (error + true.range * rng.standard_normal(len(seen)))
    bearing = seen.bearing + true.bearing_bias * rng.standard_normal(view.max() + 1)[view]
    bearing = bearing + true.bearing * rng.standard_normal(len(seen))
    distance = seen.range * (1.0 + shares[seen.identity - 6]) + error
    log = replace(log, landmarks=replace(seen, range=distance, bearing=bearing))
    (track,) = make_tracks([log])
    assert log.truth is not None
    poses = log.truth[np.searchsorted(log.truth[:, 0], track.timestamps - 1e-9), 1:]
    landmarks = {k + 6: point for k, point in enumerate(LANDMARKS)}
    model, marks = MODEL, Marks()
    for _ in range(rounds):
        graph, factors, apart = build_graph([track], [model], [poses], landmarks, marks)
        solution, (told,) = as_told(optimize(graph, init="file", max_iterations=20), factors)
        model = replace(reestimate(solution, told, model), calibration=calibration(solution, track.calibration_keys))
        marks = reestimate_marks(solution, apart, marks)
    return model.landmarks, marks


def test_deviations_are_found_from_the_data() -> None:
    """Told apart: what each sighting has itself, and what those of a view have in common."""
    true = SightingNoise(0.02, 0.004, 0.03, 0.008, growth=0.0)
    found, marks = noise_found(true, np.zeros(len(LANDMARKS)), 400.0)
    # Student's t distribution with four degrees of freedom has the scale 0.84 on Gaussian errors
    assert found.range == pytest.approx(0.84 * true.range, rel=0.15)
    assert found.bearing == pytest.approx(0.84 * true.bearing, rel=0.15)
    assert found.range_bias == pytest.approx(true.range_bias, rel=0.15)
    assert found.bearing_bias == pytest.approx(true.bearing_bias, rel=0.15)
    assert found.growth < 0.02
    assert marks.landmarks.share < 0.01


def test_growth_and_how_much_marks_differ_are_found_from_the_data() -> None:
    true = SightingNoise(0.02, 0.004, 0.01, 0.004, growth=0.15)
    shares = 0.03 * np.random.default_rng(7).standard_normal(len(LANDMARKS))
    found, marks = noise_found(true, shares, 200.0, rounds=10)
    assert found.growth == pytest.approx(true.growth, rel=0.25)
    assert found.range == pytest.approx(0.84 * true.range, rel=0.2)
    # of these ten marks; their mean cannot be told from the scale of all ranges
    assert marks.landmarks.share == pytest.approx(float(np.std(shares, ddof=1)), rel=0.25)


def calibration(solution: Solution, keys: list[int]) -> Calibration:
    place = {int(key): row for row, key in enumerate(solution.keys(Point2))}
    assert len(solution.keys(SE2))
    return Calibration.from_points(solution.values(Point2).array[[place[key] for key in keys]])
