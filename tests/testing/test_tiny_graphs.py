"""The answers of the tiny graphs are optima of their cost, by NumPy alone and by the solver."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from clew.solve import Status, optimize
from clew.testing import TINY_GRAPHS, TinyGraph


def normal_equations(tiny: TinyGraph) -> tuple[float, dict[int, Any], dict[int, Any]]:
    """Cost, gradient and diagonal blocks of the Hessian at the answer, one by one."""
    cost, gradient, hessian = 0.0, {}, {}
    for block in tiny.graph.blocks():
        arrays = [np.array([tiny.values[int(key)] for key in column]) for column in block.keys.T]
        errors, jacobians = block.linearise(*arrays)
        for row, error in enumerate(errors):
            s = np.array([error @ block.information[row] @ error])
            cost += float((s if block.kernel is None else block.kernel.rho(s))[0])
            weight = 1.0 if block.kernel is None else float(block.kernel.weight(s)[0])
            for key, jacobian in zip(block.keys[row], jacobians, strict=True):
                weighted = weight * jacobian[row].T @ block.information[row]
                gradient[int(key)] = gradient.get(int(key), 0.0) + weighted @ error
                hessian[int(key)] = hessian.get(int(key), 0.0) + weighted @ jacobian[row]
    return cost, gradient, hessian


@pytest.mark.parametrize("name", TINY_GRAPHS)
def test_the_answer_is_an_optimum(name: str) -> None:
    tiny = TINY_GRAPHS[name]()
    cost, gradient, hessian = normal_equations(tiny)
    assert cost == pytest.approx(tiny.cost, abs=1e-12)
    for key, slope in gradient.items():
        if not tiny.graph.is_constant(key):
            np.testing.assert_allclose(slope, 0.0, atol=1e-12)
            assert np.linalg.eigvalsh(hessian[key])[0] > 0
    free = [key for key in tiny.values if not tiny.graph.is_constant(key)]
    if len(free) == 1 and free[0] in tiny.covariances:
        np.testing.assert_allclose(
            np.linalg.inv(hessian[free[0]]), tiny.covariances[free[0]], rtol=1e-12, atol=1e-14
        )


@pytest.mark.parametrize("name", TINY_GRAPHS)
def test_the_solver_finds_the_answer(name: str) -> None:
    tiny = TINY_GRAPHS[name]()
    solution = optimize(tiny.graph, init="file")
    assert solution.status is Status.CONVERGED
    assert solution.chi2 == pytest.approx(tiny.cost, abs=1e-8)
    for key, expected in tiny.values.items():
        np.testing.assert_allclose(solution.value(key).array, expected, atol=1e-5)
    for key, covariance in tiny.covariances.items():
        np.testing.assert_allclose(solution.covariance(key), covariance, atol=1e-6)


def test_graphs_start_away_from_their_answers() -> None:
    for make in TINY_GRAPHS.values():
        tiny = make()
        differences = [
            np.abs(tiny.graph.value(key).array - answer).max() for key, answer in tiny.values.items()
        ]
        assert max(differences) > 0.1
