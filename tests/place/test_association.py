"""Association: gates, exclusive pairing, joint compatibility."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from clew.place import NEW, UNCLEAR, Gates, chi_square_limit, compatibility, joint_compatibility, nearest_neighbour

GATES = Gates(known=0.99, new=0.999, margin=0.0)


def test_the_gate_is_the_quantile() -> None:
    assert chi_square_limit(0.99, 2) == pytest.approx(9.2103, abs=1e-4)
    assert chi_square_limit(0.95, 4) == pytest.approx(9.4877, abs=1e-4)


def test_distances_are_those_of_the_textbook() -> None:
    rng = np.random.default_rng(0)
    z, predicted = rng.standard_normal((3, 2)), rng.standard_normal((4, 2))
    roots = rng.standard_normal((7, 2, 2))
    spd = roots @ np.swapaxes(roots, 1, 2) + 0.1 * np.eye(2)
    distance, likelihood = compatibility(z, predicted, spd[:4], spd[4:])
    for m, j in product(range(3), range(4)):
        total, e = spd[j] + spd[4 + m], z[m] - predicted[j]
        assert distance[m, j] == pytest.approx(e @ np.linalg.inv(total) @ e)
        assert likelihood[m, j] == pytest.approx(distance[m, j] + np.log(np.linalg.det(total)))


def unit(count: int, variance: float = 0.01) -> np.ndarray:
    return np.tile(variance * np.eye(2), (count, 1, 1))


def test_known_unclear_and_new() -> None:
    sigma = np.sqrt(0.02)
    z = np.array([[0.0, 0.0], [3.3 * sigma, 0.0], [5.0, 5.0]])
    found = [int(nearest_neighbour(row[None], np.zeros((1, 2)), unit(1), unit(1), GATES)[0]) for row in z]
    assert found == [0, UNCLEAR, NEW]
    assert nearest_neighbour(z, np.zeros((0, 2)), unit(0), unit(3), GATES).tolist() == [NEW] * 3


def test_two_sightings_of_one_moment_are_two_landmarks() -> None:
    predicted = np.array([[0.0, 0.0], [0.3, 0.0]])
    z = np.array([[0.12, 0.0], [0.1, 0.0]])  # both are nearer to the first
    found = nearest_neighbour(z, predicted, unit(2), unit(2), GATES)
    assert sorted(found.tolist()) == [0, 1]
    assert found[0] == 1


def test_an_ambiguous_sighting_can_be_left_alone() -> None:
    predicted = np.array([[0.0, 0.0], [0.2, 0.0]])
    z = np.array([[0.09, 0.0]])
    assert nearest_neighbour(z, predicted, unit(2), unit(1), GATES)[0] == 0
    assert nearest_neighbour(z, predicted, unit(2), unit(1), Gates(known=0.99, new=0.999, margin=3.0))[0] == UNCLEAR


def test_joint_compatibility_sees_through_a_shifted_pose() -> None:
    """Four landmarks in a row, the robot half a space off: nearest neighbours are wrong, the constellation is not."""
    predicted = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.7, 0.6]])
    shift = np.array([0.6, 0.0])
    z = predicted[[0, 1, 3]] + shift
    common = np.tile(0.25 * np.eye(2), (4, 4))  # a wrong pose moves all predictions alike
    joint = common + 1e-4 * np.eye(8)
    noise = unit(3, 1e-4)
    own = np.array([joint[2 * j : 2 * j + 2, 2 * j : 2 * j + 2] for j in range(4)])
    assert joint_compatibility(z, predicted, joint, noise, GATES).landmark.tolist() == [0, 1, 3]
    assert nearest_neighbour(z, predicted, own, noise, GATES).tolist() != [0, 1, 3]


def test_branch_and_bound_finds_what_trying_all_finds() -> None:
    rng = np.random.default_rng(7)
    for _ in range(60):
        count, known = int(rng.integers(1, 4)), int(rng.integers(1, 5))
        predicted = rng.uniform(0.0, 1.5, (known, 2))
        root = 0.25 * rng.standard_normal((2 * known, 2 * known))
        joint = root @ root.T + 1e-3 * np.eye(2 * known)
        z, noise = rng.uniform(0.0, 1.5, (count, 2)), unit(count)
        own = joint.reshape(known, 2, known, 2)[np.arange(known), :, np.arange(known)]
        near = (compatibility(z, predicted, own, noise)[0] <= GATES.limit_known).sum(axis=1)
        z = z[np.argsort(near, kind="stable")]  # the order in which the search takes them
        found = joint_compatibility(z, predicted, joint, noise, GATES).compatible
        best = (-1, 0.0)
        for choice in product(range(-1, known), repeat=count):
            rows = [r for r, j in enumerate(choice) if j >= 0]
            picked = [choice[r] for r in rows]
            if len(set(picked)) < len(picked):
                continue
            rank = (len(rows), -_distance(z, predicted, joint, noise, rows, picked))
            if _admissible(z, predicted, joint, noise, rows, picked) and rank > best:
                best = rank
        rows = [r for r in range(count) if found[r] >= 0]
        rank = (len(rows), -_distance(z, predicted, joint, noise, rows, found[rows].tolist()))
        assert rank[0] == best[0]
        assert rank[1] == pytest.approx(best[1])


def _distance(z, predicted, joint, noise, rows, picked) -> float:  # type: ignore[no-untyped-def]  # test helper
    if not rows:
        return 0.0
    scalars = np.concatenate([[2 * j, 2 * j + 1] for j in picked])
    covariance = joint[np.ix_(scalars, scalars)].copy()
    for place, row in enumerate(rows):
        covariance[2 * place : 2 * place + 2, 2 * place : 2 * place + 2] += noise[row]
    e = (z[rows] - predicted[picked]).reshape(-1)
    return float(e @ np.linalg.inv(covariance) @ e)


def _admissible(z, predicted, joint, noise, rows, picked) -> bool:  # type: ignore[no-untyped-def]  # test helper
    """Each pair passes its own gate, and each prefix the joint one."""
    singles = all(
        _distance(z, predicted, joint, noise, [r], [j]) <= GATES.limit_known for r, j in zip(rows, picked, strict=True)
    )
    probability = 1.0 - np.exp(-GATES.limit_known / 2.0)
    return singles and all(
        _distance(z, predicted, joint, noise, rows[:k], picked[:k]) <= chi_square_limit(probability, 2 * k)
        for k in range(1, len(rows) + 1)
    )


def test_exchanged_landmarks_are_rivals() -> None:
    """Two sightings between two landmarks: each fits both ways round, though no third landmark is near."""
    predicted = np.array([[0.0, 0.0], [0.2, 0.0]])
    joint = 1e-6 * np.eye(4)
    z = np.array([[0.09, 0.0], [0.11, 0.0]])
    gates = Gates(margin=3.0)
    assert joint_compatibility(z, predicted, joint, unit(2), gates).landmark.tolist() == [UNCLEAR, UNCLEAR]
    apart = np.array([[0.0, 0.0], [0.2, 0.0]])
    assert joint_compatibility(apart, predicted, joint, unit(2, 0.002), gates).landmark.tolist() == [0, 1]


def test_a_pair_that_only_the_joint_gate_lets_pass_is_not_clear() -> None:
    """Among many pairs that fit perfectly, one that is 3.3 deviations off passes jointly and is left alone."""
    predicted = np.stack([np.arange(8.0), np.zeros(8)], axis=1)
    z = predicted.copy()
    z[3, 1] = 3.5 * np.sqrt(0.01)  # its noise is all that is uncertain once the others tell where the robot is
    joint = np.tile(0.25 * np.eye(2), (8, 8)) + 1e-6 * np.eye(16)
    found = joint_compatibility(z, predicted, joint, unit(8), GATES)
    assert found.compatible.tolist() == list(range(8))
    assert found.landmark.tolist() == [0, 1, 2, UNCLEAR, 4, 5, 6, 7]


def test_a_moment_that_is_not_searched_through_says_so() -> None:
    grid = np.stack(np.meshgrid(np.arange(5.0), np.arange(5.0)), axis=-1).reshape(-1, 2)
    z = grid[:20] + np.random.default_rng(3).normal(0.0, 0.8, (20, 2))
    joint = 0.5 * np.eye(50) + 0.1
    hard = joint_compatibility(z, grid, joint, unit(20, 0.5), GATES, 1.0)
    assert hard.exhausted
    assert hard.tried <= 50 * 20
    assert (hard.compatible >= 0).sum() >= 15  # the best that was found still counts
    easy = joint_compatibility(grid[:20], grid, 1e-4 * np.eye(50), unit(20, 1e-4), GATES, 1.0)
    assert not easy.exhausted
    assert easy.landmark.tolist() == list(range(20))
    assert easy.tried <= 40
