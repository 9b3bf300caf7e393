"""Associations looked at again: what was unclear, what stands twice, what was never there."""

from __future__ import annotations

import numpy as np

from clew.geometry import se2
from clew.slam.landmarks import LandmarkMapper
from clew.slam.landmarks.review import Compared, density_of

SIGHT = np.eye(2) / 0.02**2
TIGHT = np.eye(3) / 0.001**2


def seen_from(pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    return se2.act(se2.inverse(pose), points)


def test_what_was_unclear_is_decided_once_the_robot_knows_where_it_is() -> None:
    a, b, others = np.array([5.0, 0.0]), np.array([5.0, 0.7]), np.array([[2.0, 4.0], [2.0, -4.0], [8.0, 3.0]])
    mapper = LandmarkMapper()
    first = mapper.see(np.vstack([a, b, others]), SIGHT)
    assert len(set(first.tolist())) == 5
    # the odometry is 0.35 m wrong to the side, which puts what is seen half way between the two
    mapper.move(1, np.array([1.0, 0.35, 0.0]), np.diag([1 / 0.05**2, 1 / 0.3**2, 1 / 0.001**2]))
    assert mapper.see(seen_from(np.array([1.0, 0.0, 0.0]), a[None]), SIGHT).tolist() == [-1]
    mapper.move(2, np.zeros(3), TIGHT)
    assert mapper.see(seen_from(np.array([1.0, 0.0, 0.0]), others), SIGHT).tolist() == first[2:].tolist()
    mapper.solve()
    assert mapper.landmarks[5] == first[0]


def test_landmarks_that_stand_twice_after_a_loop_become_one() -> None:
    points = np.array([[3.0, 1.0], [4.5, -1.2], [6.0, 2.2], [2.0, -3.0], [5.2, 3.9], [7.4, -0.4]])
    noise = np.random.default_rng(5).normal(0.0, 0.02, (3, 6, 2))
    mapper = LandmarkMapper()
    mapper.see(points + noise[0], SIGHT)
    mapper.move(1, np.zeros(3), TIGHT)
    mapper.see(points + noise[1], SIGHT)
    mapper.solve()
    first = mapper.landmarks[:6]
    assert mapper.landmarks[6:].tolist() == first.tolist()
    # a long way round: the robot is back where it was, 2 m from where it believes to be
    mapper.move(2, np.array([1.6, -1.2, 0.0]), np.diag([1 / 2.0**2, 1 / 2.0**2, 1 / 0.01**2]))
    again = mapper.see(points + noise[2], SIGHT)
    assert not np.isin(again, first).any()  # it knows its place too badly to tell; all are new for now
    solution = mapper.solve()
    assert mapper.landmarks[12:].tolist() == first.tolist()
    assert np.abs(solution.value(2).array).max() < 0.1


def test_a_landmark_that_is_not_seen_where_it_should_be_is_none() -> None:
    points = np.array([[3.0, 1.0], [4.5, -1.2], [6.0, 2.2], [2.0, -3.0]])
    ghost, far = np.array([3.5, -0.4]), np.array([14.0, 0.5])
    rng = np.random.default_rng(2)
    mapper = LandmarkMapper()
    truth = []
    for k in range(24):
        pose = np.array([0.1 * k, 0.0, 0.0])
        if k:
            mapper.move(k, np.array([0.1, 0.0, 0.0]), np.eye(3) / 0.01**2)
        here = np.vstack([points, *([ghost[None]] if k == 6 else []), *([far[None]] if k == 23 else [])])
        truth += [*range(4), *([4] if k == 6 else []), *([5] if k == 23 else [])]
        mapper.see(seen_from(pose, here) + 0.02 * rng.standard_normal((len(here), 2)), SIGHT)
    mapper.solve()
    provisional = mapper.landmarks[np.array(truth) == 4]
    assert provisional >= 0  # it may be one, until the end
    mapper.solve(final=True)
    landmark, truth_of = mapper.landmarks, np.array(truth)
    assert landmark[truth_of == 4] == -1
    for real in range(4):
        assert len(np.unique(landmark[truth_of == real])) == 1
    assert landmark[truth_of == 5] >= 0  # nobody looked there before


def test_only_what_has_changed_is_compared_again() -> None:
    keys, points, deviation = np.array([3, 5, 9]), np.zeros((3, 2)), np.full(3, 0.2)
    compared = Compared()
    assert compared.changed(keys, points, deviation).all()
    compared.take(keys, points, deviation, keys == 5)
    assert compared.changed(keys, points, deviation).tolist() == [False, True, False]  # left for the next time
    compared.take(keys, points, deviation, np.zeros(3, bool))
    assert not compared.changed(keys, points + 0.05, deviation).any()
    moved = points + np.array([[0.0, 0.0], [0.15, 0.0], [0.0, 0.0]])
    assert compared.changed(keys, moved, deviation).tolist() == [False, True, False]
    assert compared.changed(keys, points, np.array([0.2, 0.2, 0.1])).tolist() == [False, False, True]
    assert compared.changed(np.array([3, 4, 9]), points, deviation).tolist() == [False, True, False]


def test_provisional_landmarks_do_not_make_a_crowd() -> None:
    """Doubles that wait to be joined would make every gate look crowded, and all that follows new."""
    points = np.random.default_rng(1).uniform(0.0, 30.0, (60, 2))
    doubles = points + 0.05
    counts = np.repeat([5, 1], 60)
    alone = density_of(points, counts[:60])
    assert density_of(np.vstack([points, doubles]), counts) == alone
    assert density_of(points, np.ones(60, np.int64)) == alone  # at first all are provisional
