"""Covariances about the best alignment: against the dense transformation, and whatever is held."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from clew.errors import InputError
from clew.evaluate import align
from clew.factors import Between
from clew.geometry import SE2, SE3, se2
from clew.graph import FactorGraph
from clew.solve import aligned_covariances, optimize
from clew.testing import random_elements

COUNT = 12


def loop(kind: type[Any], held: int) -> tuple[FactorGraph, np.ndarray]:
    rng = np.random.default_rng(5)
    poses = kind.from_array(random_elements(kind, (COUNT,), rng))
    graph = FactorGraph()
    keys = graph.add_pose(poses)
    for step in (1, 3):
        a, b = keys[:-step], keys[step:]
        root = rng.standard_normal((len(a), kind.dim, kind.dim))
        graph.add(Between(a, b, poses[:-step].between(poses[step:]), covariance=0.01 * root @ np.swapaxes(root, 1, 2)
                          + 1e-3 * np.eye(kind.dim)))  # fmt: skip
    graph.set_constant(int(keys[held]))
    return graph, keys


@pytest.mark.parametrize("scale", [False, True])
@pytest.mark.parametrize("kind", [SE2, SE3])
def test_against_the_dense_transformation(kind: type[Any], scale: bool) -> None:
    graph, keys = loop(kind, 0)
    solution = optimize(graph, init="file")
    joint = solution.joint_covariance(keys)
    poses = solution.values(kind).array
    middle = poses[:, : kind.space].mean(axis=0)
    centred = poses.copy()
    centred[:, : kind.space] -= middle
    functions: Any = kind.functions
    moved = functions.adjoint(functions.inverse(centred))
    grown = np.concatenate([functions.act(functions.inverse(poses), middle), np.zeros((COUNT, kind.dim - kind.space))],
                           axis=1)  # fmt: skip
    motions = moved.reshape(-1, kind.dim)
    if scale:
        motions = np.column_stack([motions, -grown.reshape(-1)])
    seen = np.tile(np.arange(kind.dim) < kind.space, COUNT)
    fit = np.linalg.pinv(motions * seen[:, None])
    projector = np.eye(len(motions)) - motions @ fit
    expected = (projector @ joint @ projector.T).reshape(COUNT, kind.dim, COUNT, kind.dim)
    each = np.arange(COUNT)
    found = aligned_covariances(solution, keys, scale=scale)
    np.testing.assert_allclose(found.poses, expected[each, :, each], atol=1e-9)
    np.testing.assert_allclose(found.alignment, fit @ joint @ fit.T, atol=1e-9)


@pytest.mark.parametrize("kind", [SE2, SE3])
def test_what_is_held_does_not_matter(kind: type[Any]) -> None:
    found = []
    for held in (0, 7):
        graph, keys = loop(kind, held)
        found.append(aligned_covariances(optimize(graph, init="file"), keys).poses)
    np.testing.assert_allclose(*found, atol=1e-9)


def test_they_are_those_of_aligned_samples() -> None:
    graph, keys = loop(SE2, 0)
    solution = optimize(graph, init="file")
    rng, poses = np.random.default_rng(6), solution.values(SE2).array
    scale = 0.05  # small errors: the alignment is to first order
    draws = scale * rng.multivariate_normal(np.zeros(3 * COUNT), solution.joint_covariance(keys), 4000)
    errors = []
    for draw in draws.reshape(-1, COUNT, 3):
        sample = se2.retract(poses, draw)
        errors.append(se2.local(poses, se2.compose(align(poses[:, :2], sample[:, :2]), sample)))
    found = np.einsum("sni,snj->nij", errors, errors) / len(draws) / scale**2
    expected = aligned_covariances(solution, keys).poses
    np.testing.assert_allclose(found, expected, atol=0.1 * np.abs(expected).max())


def test_bad_input_is_named() -> None:
    graph, keys = loop(SE2, 0)
    solution = optimize(graph, init="file")
    with pytest.raises(InputError, match="no alignment"):
        aligned_covariances(solution, keys[:1])
    with pytest.raises(InputError, match="keys of poses"):
        aligned_covariances(solution, [999])
