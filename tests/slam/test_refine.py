"""Joint refinement, and the pairs that it ties together."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from clew.geometry import SE2
from clew.graph import Role
from clew.slam.pair_noise import returns_once
from clew.slam.pose_graph import chi2
from clew.slam.refine import RECENT, overlapping_pairs
from clew.solve import optimize
from slam.drives import errors, mapped, outing, round_trip, truth_of


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 60), st.floats(0.2, 5.0), st.integers(2, 14))
def test_pairs_are_near_unique_and_the_nearest_of_one_of_both(seed: int, count: int, radius: float,
                                                              neighbours: int) -> None:
    poses = np.random.default_rng(seed).uniform(-3, 3, (count, 3))
    pairs = overlapping_pairs(poses, radius, neighbours)
    distance = np.linalg.norm(poses[:, None, :2] - poses[None, :, :2], axis=2)
    assert pairs.shape[1:] == (2,)
    assert np.all(pairs[:, 0] < pairs[:, 1])
    assert len(np.unique(pairs, axis=0)) == len(pairs)
    assert np.all(distance[pairs[:, 0], pairs[:, 1]] <= radius)
    assert len(pairs) <= (neighbours + 4) * count
    expected = set()
    for k in range(count):  # each keyframe asks its older ones and its later ones for their nearest
        for others in (range(k), range(k + 1, count)):
            near = [j for j in others if distance[k, j] <= radius]
            for chosen, limit in (([j for j in near if abs(j - k) <= RECENT], neighbours // 3),
                                  ([j for j in near if abs(j - k) > RECENT], neighbours - neighbours // 3)):
                nearest = sorted(chosen, key=lambda j: distance[k, j])[: (limit + 1) // 2]
                expected |= {(min(j, k), max(j, k)) for j in nearest}
    assert set(map(tuple, pairs.tolist())) == expected


def test_far_apart_keyframes_have_no_pairs() -> None:
    assert overlapping_pairs(np.arange(30.0).reshape(10, 3) * 10, 4.0, 12).shape == (0, 2)
    assert overlapping_pairs(np.zeros((1, 3)), 4.0, 12).shape == (0, 2)


@pytest.mark.parametrize("scans", [2, 3, 5, 13])
def test_scans_that_all_see_one_surface_are_as_far_apart_as_their_noise(scans: int) -> None:
    """Of variance one each, so that two of them are two apart, however many pairs there are."""
    pairs = np.stack(np.triu_indices(scans, 1), axis=1).astype(np.int32)
    design = np.zeros((len(pairs), scans))
    design[np.arange(len(pairs)), pairs[:, 0]], design[np.arange(len(pairs)), pairs[:, 1]] = -1.0, 1.0
    covariance = np.linalg.pinv(design.T @ (returns_once(pairs, scans)[:, None] * design))
    assert covariance[0, 0] + covariance[1, 1] - 2 * covariance[0, 1] == pytest.approx(2.0)


def test_each_scan_counts_once_however_many_pairs_it_is_in() -> None:
    star = np.array([[0, 1], [0, 2], [0, 3], [0, 4]], dtype=np.int32)
    np.testing.assert_allclose(returns_once(star, 5), 10**-0.5)  # a fifth for the middle, half for each end
    pairs = overlapping_pairs(np.random.default_rng(0).uniform(-3, 3, (40, 3)), 2.0, 12)
    share, times = np.zeros(40), np.bincount(pairs.reshape(-1), minlength=40)
    np.add.at(share, pairs, returns_once(pairs, 40)[:, None])
    assert share.max() < 2.0
    assert np.median(share * (times + 1) / times) == pytest.approx(1.0, abs=0.1)  # n - 1 pairs, an n-th of each


def test_refined_graph_is_at_its_optimum_and_ties_the_rounds_together() -> None:
    slam = mapped(round_trip(), refine=True)
    poses = slam.keyframes.T_world_robot
    again = optimize(slam.graph, init="file")
    np.testing.assert_allclose(again.values(SE2).array, poses, atol=1e-4)
    loops = [b for b in slam.graph.blocks() if b.role is Role.LOOP]
    keys = np.concatenate([b.keys for b in loops])
    assert np.count_nonzero(keys[:, 1] - keys[:, 0] > RECENT) > len(keys) / 4
    assert slam.chi2 == pytest.approx(chi2(slam.graph))
    np.testing.assert_array_equal(slam.graph.values(SE2).array, poses)
    assert next(iter(slam.graph.variables())).constant.sum() == 1


def test_steps_are_worth_no_more_than_the_front_end_found_them_to_be() -> None:
    """They know their noise, and the pairs count the same scans."""
    slam = mapped(round_trip())

    def steps() -> tuple[np.ndarray, np.ndarray]:
        blocks = [b for b in slam.graph.blocks() if b.role is Role.ODOMETRY]
        return np.concatenate([b.keys for b in blocks]), np.concatenate([b.information for b in blocks])

    keys, before = steps()
    slam.refine()
    keys_after, after = steps()
    np.testing.assert_array_equal(keys, keys_after)
    ratio = np.linalg.eigvals(np.linalg.solve(before, after)).real  # 1 where odometry tells, 2 / n where returns do
    assert ratio.max() < 1 + 1e-6
    assert 0.1 < np.median(ratio.min(axis=1)) < 0.6


def test_refining_pulls_a_bent_map_straight() -> None:
    """Keyframes shaken by centimetres come back to where their scans fit."""
    log = round_trip()
    slam = mapped(log)
    straight = slam.keyframes.T_world_robot
    shaken = straight + np.random.default_rng(0).normal(0, [0.03, 0.03, 0.005], straight.shape)
    shaken[0] = straight[0]
    slam._pose_graph.set_poses(shaken)
    from clew.slam.refine import refine

    keyframes = slam._keyframes
    clouds = keyframes.clouds(keyframes.alive)
    graph = refine(clouds, keyframes.alive, slam._pose_graph.graph, slam.config, slam._sensor)
    refined = np.asarray(graph.values(SE2).array)
    assert errors(refined, straight)[0].max() < 0.03
    assert errors(shaken, straight)[0].max() > 0.06


def test_rounds_are_reported_and_a_second_refinement_moves_little() -> None:
    log = outing("office")
    slam, seen = mapped(log), list[tuple[int, int]]()
    slam.refine(lambda done, most: seen.append((done, most)))
    assert [done for done, _ in seen] == list(range(len(seen)))
    assert all(done <= most == slam.config.refinement.rounds for done, most in seen)
    first = slam.trajectory.T_world_robot
    slam.refine()
    assert np.abs(slam.trajectory.T_world_robot - first).max() < 0.02
    assert errors(slam.trajectory.T_world_robot, truth_of(log))[0].max() < 0.1
