"""Random small graphs of every kind of factor."""

from __future__ import annotations

from typing import Any

import numpy as np

import clew
from clew.geometry import so3


def information(generator: np.random.Generator, count: int, dim: int) -> Any:
    """Dense positive definite matrices."""
    root = generator.standard_normal((count, dim, dim))
    return root @ np.swapaxes(root, 1, 2) + 0.5 * np.eye(dim)


def random_graph(seed: int, space: int, poses: int, points: int, kernel: Any = None) -> clew.FactorGraph:
    """A connected graph: chain, random closures in both directions, sightings with and without a sensor
    offset."""
    generator = np.random.default_rng(seed)
    pose = clew.SE2 if space == 2 else clew.SE3
    graph = clew.FactorGraph()

    def some(count: int) -> Any:
        return pose.exp(generator.standard_normal((count, pose.dim)))

    first_points = graph.add_point(generator.standard_normal((points // 2, space)))  # kinds interleave
    keys = graph.add_pose(some(poses))
    landmarks = np.concatenate(
        [first_points, graph.add_point(generator.standard_normal((points - points // 2, space)))]
    )
    dim = pose.dim
    graph.add(clew.Prior(keys[0], some(1)[0], information=information(generator, 1, dim)))
    if poses > 1:
        graph.add(
            clew.Between(
                keys[:-1], keys[1:], some(poses - 1), information=information(generator, poses - 1, dim)
            )
        )
        a, b = generator.choice(keys, (2, 3 * poses))
        a, b = a[a != b], b[a != b]
        if len(a):
            graph.add(
                clew.Between(
                    a,
                    b,
                    some(len(a)),
                    role="loop",
                    kernel=kernel,
                    information=information(generator, len(a), dim),
                )
            )
    if points:
        seen_from = generator.choice(keys, 3 * points)
        seen = np.tile(landmarks, 3)
        half = len(seen) // 2
        for part, place in ((slice(None, half), None), (slice(half, None), some(1)[0])):
            count = len(seen[part])
            graph.add(
                clew.PointObservation(
                    seen_from[part],
                    seen[part],
                    generator.standard_normal((count, space)),
                    T_robot_sensor=place,
                    information=information(generator, count, space),
                    kernel=kernel,
                )
            )
        angles = generator.uniform(-3, 3, (2, len(seen)))
        elevation = {} if space == 2 else {"elevation": angles[1] / 3}
        graph.add(
            clew.RangeBearing(
                seen_from,
                seen,
                generator.uniform(0.5, 3, len(seen)),
                angles[0],
                **elevation,
                T_robot_sensor=some(1)[0],
                information=information(generator, len(seen), space),
            )
        )
    return graph


def consistent_graph(seed: int, space: int, poses: int, points: int, noise: float = 0.1) -> clew.FactorGraph:
    """A graph like `random_graph` whose measurements are true but for noise, so that it has a clear
    minimum."""
    generator = np.random.default_rng(seed)
    pose = clew.SE2 if space == 2 else clew.SE3
    graph = clew.FactorGraph()
    truth = pose.exp(
        generator.standard_normal((poses, pose.dim)) * np.repeat([2.0, 1.0], [space, pose.dim - space])
    )
    spots = 3.0 + generator.standard_normal((points, space))
    keys, landmarks = graph.add_pose(truth), graph.add_point(spots)

    def blurred(exact: Any) -> Any:
        return exact.retract(noise * generator.standard_normal((len(exact), exact.dim)))

    graph.add(clew.Prior(keys[0], truth[0], information=information(generator, 1, pose.dim)))
    a, b = np.concatenate([np.stack([keys[:-1], keys[1:]]), generator.choice(keys, (2, poses))], axis=1)
    a, b = a[a != b], b[a != b]
    graph.add(
        clew.Between(
            a, b, blurred(truth[a].between(truth[b])), information=information(generator, len(a), pose.dim)
        )
    )
    seen = np.tile(np.arange(points), 3)
    seer = generator.integers(0, poses, len(seen))
    where = clew.Point2 if space == 2 else clew.Point3
    graph.add(
        clew.PointObservation(
            keys[seer],
            landmarks[seen],
            blurred(truth[seer].inverse().act(where.from_array(spots[seen]))),
            information=information(generator, len(seen), space),
        )
    )
    graph.set_values(keys, blurred(truth))
    return graph


def turned_sphere(rings: int, per_ring: int, sigmas: tuple[float, float], seed: int) -> tuple[clew.FactorGraph, float]:
    """A spiral around a sphere with edges from ring to ring, and the cost at the minimum beside the truth.

    Args:
        rings: number of rings.
        per_ring: poses on each; the radius is as many metres.
        sigmas: noise of translations, metres, and rotations, radians.
        seed: of the noise.
    """
    generator = np.random.default_rng(seed)
    count = rings * per_ring
    polar = np.linspace(0.05, 0.95, rings).repeat(per_ring) * np.pi
    around = np.tile(np.arange(per_ring) * 2 * np.pi / per_ring, rings)
    up = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], axis=1)
    forward = np.stack([-np.sin(around), np.cos(around), 0 * around], axis=1)
    turns = so3.from_matrix(np.stack([forward, np.cross(up, forward), up], axis=2))
    truth = clew.SE3.from_array(np.hstack([per_ring * up, turns]))
    noise = np.repeat(sigmas, 3)
    graph = clew.FactorGraph()
    keys = graph.add_pose(clew.SE3.identity((count,)))
    for step, role in ((1, "odometry"), (per_ring, "loop")):
        i, j = np.arange(count - step), np.arange(step, count)
        measured = truth[i].between(truth[j]).retract(noise * generator.standard_normal((len(i), 6)))
        graph.add(clew.Between(keys[i], keys[j], measured, sigmas=noise, role=role))
    known = graph.copy()
    known.set_values(keys, truth)
    return graph, clew.optimize(known, init="file").chi2
