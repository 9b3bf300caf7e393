"""Covariances from another information than the one that the solution was found with."""

from __future__ import annotations

import numpy as np
import pytest

from clew.errors import InputError
from clew.factors import PointObservation, Prior
from clew.geometry import SE2, Point2
from clew.graph import FactorGraph
from clew.noise import Cauchy
from clew.solve import optimize, recounted


def graph_of_points() -> FactorGraph:
    graph = FactorGraph()
    graph.add_pose(SE2(0.0, 0.0, 0.0), key=0, constant=True)
    graph.add_point(np.array([[1.0, 0.0], [2.0, 1.0]]), key=[1, 2])
    graph.add(Prior([1, 2], Point2.from_array(np.zeros((2, 2))), sigmas=2.0))
    z = np.array([[1.0, 0.0], [2.0, 1.0], [1.3, 0.0]])
    graph.add(PointObservation([0, 0, 0], [1, 2, 1], z, sigmas=0.1, kernel=Cauchy(1.0)))
    return graph


def test_factors_count_as_they_are_told() -> None:
    solution = optimize(graph_of_points(), init="file")
    information = np.array([3.0, 5.0, 7.0])[:, None, None] * np.eye(2)
    counted = PointObservation([0, 0, 0], [1, 2, 1], np.zeros((3, 2)), information=information)
    again = recounted(solution, [counted])
    np.testing.assert_allclose(again.covariance(1), np.eye(2) / (0.25 + 3.0 + 7.0))
    np.testing.assert_allclose(again.covariance(2), np.eye(2) / (0.25 + 5.0))
    np.testing.assert_array_equal(again.values(Point2).array, solution.values(Point2).array)
    assert again.chi2 == solution.chi2
    # in parts, in the order of the graph
    parts = [
        PointObservation([0], [1], np.zeros((1, 2)), information=information[:1]),
        PointObservation([0, 0], [2, 1], np.zeros((2, 2)), information=information[1:]),
    ]
    np.testing.assert_array_equal(recounted(solution, parts).covariance(1), again.covariance(1))
    np.testing.assert_array_equal(recounted(solution, []).covariance(1), solution.covariance(1))


def test_other_measurements_are_refused() -> None:
    solution = optimize(graph_of_points(), init="file")
    with pytest.raises(InputError, match="all 3 PointObservation"):
        recounted(solution, [PointObservation([0, 0], [1, 2], np.zeros((2, 2)), sigmas=1.0)])
