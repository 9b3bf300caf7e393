"""Residuals by factor: hand-worked, and their sum against the solver's own cost."""

from __future__ import annotations

import numpy as np
import pytest

from clew.evaluate import ROLES, factor_residuals
from clew.factors import Between, PointObservation, Prior
from clew.geometry import SE2
from clew.graph import FactorGraph, Role
from clew.noise import Cauchy, Huber
from clew.solve import optimize


def graph() -> FactorGraph:
    """Three poses on a line, one landmark; the loop is 3 m too long at sigma 1 m, the sighting 0.2 m at 0.1 m."""
    graph = FactorGraph()
    for x in (0.0, 1.0, 2.0):
        graph.add_pose(SE2(x, 0.0, 0.0))
    point = graph.add_point(np.array([2.0, 1.0]))
    graph.add(Between([0, 1], [1, 2], SE2(np.ones(2), np.zeros(2), np.zeros(2)), sigmas=0.1))
    graph.add(Between(0, 2, SE2(5.0, 0.0, 0.0), sigmas=1.0, role=Role.LOOP, kernel=Huber(1.0)))
    graph.add(PointObservation(1, point, np.array([1.0, 1.2]), sigmas=0.1))
    graph.add(Prior(0, SE2(0.0, 0.0, 0.0), sigmas=1.0))
    return graph


def test_by_hand() -> None:
    found = factor_residuals(graph())
    np.testing.assert_array_equal(found.ids, np.arange(5))
    np.testing.assert_array_equal(found.keys, [[0, 1], [1, 2], [0, 2], [1, 3], [0, -1]])
    assert [ROLES[role] for role in found.role] == [Role.ODOMETRY, Role.ODOMETRY, Role.LOOP, Role.OBSERVATION,
                                                    Role.PRIOR]
    np.testing.assert_array_equal(found.dim, [3, 3, 3, 2, 3])
    np.testing.assert_allclose(found.squared, [0, 0, 9, 4, 0], atol=1e-12)
    np.testing.assert_allclose(found.cost, [0, 0, 2 * 3 - 1, 4, 0], atol=1e-12)  # Huber: 2 c sqrt(s) - c^2
    np.testing.assert_allclose(found.weight, [1, 1, 1 / 3, 1, 1])
    np.testing.assert_array_equal(found.largest(2), [2, 3])
    np.testing.assert_array_equal(found.of_role(Role.LOOP), [False, False, True, False, False])
    # With two degrees of freedom the tail is exp(-s / 2).
    np.testing.assert_allclose(found.chance[3], np.exp(-2.0))
    np.testing.assert_allclose(found.chance[0], 1.0)


@pytest.mark.parametrize("robust", [None, Cauchy(0.5)])
def test_the_costs_add_up_to_that_of_the_solver(robust: Cauchy | None) -> None:
    solution = optimize(graph(), init="file", robust=robust)
    found = factor_residuals(solution.graph, robust)
    np.testing.assert_allclose(found.cost.sum(), solution.chi2, rtol=1e-9)


def test_removed_factors_and_empty_graphs() -> None:
    assert len(factor_residuals(FactorGraph())) == 0
    pruned = graph()
    pruned.remove([2, 0])
    np.testing.assert_array_equal(factor_residuals(pruned).ids, [1, 3, 4])
