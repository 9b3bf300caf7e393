"""What becomes of closures that are wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from clew.geometry import se2
from clew.place import Closure, Verdict
from clew.slam import Slam
from slam.drives import closure_error, errors, mapped, measurements, round_trip, truth_of


def half_way() -> Slam:
    """The drive until the first closures are in."""
    slam, log, k = Slam(), round_trip(), 0
    while len(slam.closures) < 5:
        for measurement in measurements(log, k, k + 1):
            slam.add(measurement)
        k += 1
    return slam


@pytest.mark.parametrize("miss", [(1.0, 0.0, 0.0), (0.0, -0.8, 0.4), (0.3, 2.0, 1.5)])
def test_planted_wrong_closure_is_withdrawn_and_the_map_stays_whole(miss: tuple[float, ...]) -> None:
    slam, log = half_way(), round_trip()
    closer = slam._closer
    right = closer.accepted[-1]
    wrong = replace(right, target=right.target + 3, T_target_source=se2.compose(right.T_target_source, np.array(miss)))
    closer._beliefs.add(wrong)
    assert len(closer.accepted) >= 6
    for measurement in measurements(log, slam.scan_count, log.scan_count):
        slam.add(measurement)
    withdrawn = [c for c in slam.rejected_closures if c.verdict is Verdict.WITHDRAWN]
    assert [(c.source, c.target) for c in withdrawn] == [(wrong.source, wrong.target)]
    assert (wrong.source, wrong.target) not in {(c.source, c.target) for c in slam.closures}
    assert errors(slam.trajectory.T_world_robot, truth_of(log))[0].max() < 0.1


def test_contradictory_proposals_of_one_attempt_are_ambiguous() -> None:
    slam = half_way()
    closer, right = slam._closer, slam.closures[-1]
    waiting = replace(right, verdict=Verdict.WAITING)
    elsewhere = replace(waiting, T_target_source=se2.compose(right.T_target_source, np.array([1.5, 0.0, 0.0])))
    before = len(slam.closures)
    assert not closer._decide([waiting, elsewhere])
    assert len(slam.closures) == before
    ended = [c.verdict for c in closer.rejected if c.verdict is not Verdict.WAITING]
    assert ended[-2:] == [Verdict.AMBIGUOUS] * 2


def test_a_closure_that_moves_the_robot_far_waits_for_others_and_expires_alone() -> None:
    slam, log = half_way(), round_trip()
    closer, right = slam._closer, slam.closures[-1]
    far = replace(right, verdict=Verdict.WAITING, innovation=(2.0, 0.3), target=right.target + 1,
                  T_target_source=se2.compose(right.T_target_source, np.array([2.0, 0.0, 0.3])))
    assert not closer._decide([far])
    assert closer.rejected[-1].verdict is Verdict.WAITING
    for measurement in measurements(log, slam.scan_count, log.scan_count):
        slam.add(measurement)
    same = [c for c in slam.rejected_closures if (c.source, c.target) == (far.source, far.target)]
    assert [c.verdict for c in same] == [Verdict.ALONE]


def test_every_candidate_is_told_of_once() -> None:
    slam = mapped(round_trip())
    told: list[Closure] = [*slam.closures, *slam.rejected_closures]
    pairs = [(c.source, c.target) for c in told]
    assert len(set(pairs)) == len(pairs)
    assert all(c.verdict is not Verdict.WAITING or c.source >= len(slam.keyframes) - 20 for c in told)
    for c in told:
        assert slam.keyframes.timestamps[c.source] > slam.keyframes.timestamps[c.target]

def test_right_closures_overturn_a_wrong_one_that_came_first() -> None:
    """The graph is sure of what a wrong closure says, and each right one for itself would disagree with it."""
    slam, log = half_way(), round_trip()
    closer = slam._closer
    right = closer.accepted
    for belief in list(closer._beliefs._held):
        slam._pose_graph.remove(belief.factor)
    closer._beliefs._held.clear()
    first = right[0]
    wrong = replace(first, T_target_source=se2.compose(first.T_target_source, np.array([1.5, 0.6, 0.2])),
                    information=np.diag([1e4, 1e4, 1e5]))
    closer._beliefs.add(wrong)
    slam._pose_graph.optimise()
    for measurement in measurements(log, slam.scan_count, log.scan_count):
        slam.add(measurement)
    believed = [c.T_target_source for c in slam.closures if (c.source, c.target) == (wrong.source, wrong.target)]
    assert not any(np.allclose(T, wrong.T_target_source, atol=0.5) for T in believed)  # it was measured anew
    assert max(np.abs(closure_error(c, slam, log)).max() for c in slam.closures) < 0.1
    assert len(slam.closures) > 10
    assert errors(slam.trajectory.T_world_robot, truth_of(log))[0].max() < 0.1


def test_several_that_agree_do_not_overturn_more_than_they_are() -> None:
    """Look-alikes: sound matches that agree with each other, against a graph of many more."""
    slam = mapped(round_trip())
    beliefs = slam._closer._beliefs
    held = beliefs.held
    shifted = [replace(c, T_target_source=se2.compose(np.array([1.0, 0.4, 0.0]), c.T_target_source))
               for c in held[2:11:4]]
    poses = slam.every_keyframe.T_world_robot
    assert beliefs.overturn(shifted) is None
    assert [(c.source, c.target) for c in beliefs.held] == [(c.source, c.target) for c in held]
    np.testing.assert_allclose(slam.every_keyframe.T_world_robot, poses, atol=1e-3)


def test_what_could_not_be_closed_in_time_is_closed_at_the_end() -> None:
    slam = mapped(round_trip())
    closer, last = slam._closer, slam.closures[-1]
    belief = closer._beliefs._held.pop()
    closer._beliefs._of_source = None
    slam._pose_graph.remove(belief.factor)
    closer._open.append(last.source)
    told: list[tuple[int, int]] = []
    slam.optimise(lambda done, most: told.append((done, most)), lambda: True)
    assert last.source not in {c.source for c in slam.closures}  # stopped before it was tried
    assert len(told) == 1
    slam.optimise(lambda done, most: told.append((done, most)))
    done, most = np.array(told[1:]).T
    assert np.array_equal(done, np.arange(len(done)))
    assert np.all(most == 3 * len(closer._open) + 3)
    assert len(done) <= most[0]
    assert last.source in {c.source for c in slam.closures}


@pytest.mark.parametrize("certain", [True, False])
def test_a_partial_match_is_a_rival_while_the_robot_may_be_farther_off(certain: bool) -> None:
    """One door farther on fits as well: where a partial match says so, none along its line is unique."""
    slam = half_way()
    closer, right = slam._closer, slam.closures[-1]
    best = replace(right, verdict=Verdict.WAITING, is_certain=certain)
    line = np.diag([1e-3, 1e4, 1e5])
    poses, other = slam._pose_graph.poses, right.target - 1
    farther = se2.compose(right.T_target_source, np.array([4.0, 0.0, 0.0]))
    partial = replace(best, target=other, is_partial=True, likelihood=0.9 * right.likelihood, information=line,
                      T_target_source=se2.compose(se2.between(poses[other], poses[right.target]), farther))
    closer._decide([best, partial])
    ambiguous = [c for c in closer.rejected if c.verdict is Verdict.AMBIGUOUS and c.source == right.source]
    assert bool(ambiguous) != certain


def test_an_attempt_after_which_no_closure_is_left_goes_on() -> None:
    """The newest closure and the one before contradict each other, and both are withdrawn on the way."""
    slam, log = half_way(), round_trip()
    beliefs = slam._closer._beliefs
    beliefs._most_residual = -1.0  # everything is contradicted from now on
    for measurement in measurements(log, slam.scan_count, log.scan_count):
        slam.add(measurement)
    assert len(beliefs) == 0
    assert len(slam._closer._open) > 0


def test_partial_closures_that_a_group_stands_for_are_not_forgotten() -> None:
    slam = half_way()
    slam.optimise()
    beliefs, right = slam._closer._beliefs, slam.closures[-1]
    beliefs.add(replace(right, is_partial=True, target=right.target + 1, information=1e-3 * np.eye(3),
                        T_target_source=se2.between(slam._pose_graph.poses[right.target + 1],
                                                    slam._pose_graph.poses[right.source])))
    gone = beliefs.overturn([right])
    assert gone is not None
    assert [(c.target, c.verdict) for c in gone] == [(right.target + 1, Verdict.REDUNDANT)]
