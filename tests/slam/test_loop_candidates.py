"""Candidates by appearance: found however far the graph is off, and whichever way the robot faces."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from clew.geometry import SE2, se2
from clew.place import Verdict
from clew.scan import LaserScan, extract_points
from clew.sim import DriveModel, LaserModel, OdometryModel, drive, hall, simulate
from clew.slam import Slam, SlamConfig
from clew.slam.keyframes import Keyframe, KeyframeStore
from clew.slam.loop_candidates import find_candidates
from clew.slam.places import Places
from slam.drives import mapped

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def out_and_back() -> tuple[Slam, Array]:
    """Thirty metres through a hall and back, facing the other way, with a laser that sees all around; true poses."""
    world = hall(3)
    way = np.array([[3.0, 3.0], [34.0, 3.0], [3.0, 3.0]])
    driven = drive(way, rate=4.0, model=DriveModel(turn_round=1.5))
    log = simulate(world, driven, LaserModel(beams=361, field_of_view=2 * np.pi), OdometryModel.good(), 3)
    slam = mapped(log)
    rows = np.searchsorted(log.timestamps, slam.every_keyframe.timestamps)
    return slam, log.T_world_robot[rows]


def test_a_place_is_found_after_thirty_metres_of_drift_with_the_robot_facing_the_other_way(
    out_and_back: tuple[Slam, Array]
) -> None:
    slam, truth = out_and_back
    closer = slam._closer
    graph = closer._graph.graph.copy()
    source = len(truth) - 12
    everyone = np.arange(source)
    anchors = everyone[closer._places.are_anchors(everyone, source)]
    nearest = int(anchors[np.hypot(*(truth[anchors, :2] - truth[source, :2]).T).argmin()])
    assert abs(se2.between(truth[nearest], truth[source])[2]) > 2.5
    # The robot is believed 30 m beside, and the graph says that it does not know better.
    poses = closer._graph.poses.copy()
    poses[source] = se2.compose(poses[source], np.array([0.0, 30.0, 0.3]))
    closer._graph.set_poses(poses)

    class Lost:
        poses = closer._graph.poses
        near = closer._graph.near

        @staticmethod
        def relative_covariances(source: int, targets: NDArray[np.int64]) -> Array:
            return np.tile(np.diag([60.0, 60.0, 0.05]), (len(targets), 1, 1))

    query = closer._places.query(source)
    candidates = find_candidates(Lost(), closer._places, query, slam.config.closing)  # type: ignore[arg-type]  # a stand-in
    closer._graph.set_poses(np.asarray(graph.values(SE2).array))
    matches = [closer._matcher.match(query, c) for c in candidates]
    found = [m for m in matches if m.verdict in (Verdict.WAITING, Verdict.DISAGREES)]
    assert found
    for match in found:
        off = se2.between(se2.between(truth[match.target], truth[match.source]), match.T_target_source)
        assert np.hypot(off[0], off[1]) < 0.1
        assert abs(off[2]) < 0.02
    assert max(m.innovation[0] for m in found) > 25.0
    for candidate in candidates:  # searched where what is seen lies on what was seen, whichever way the robot faces
        assert not candidate.is_near
        seen = se2.act(candidate.centre, query.view[None])[0]
        np.testing.assert_allclose(seen, closer._places.view(candidate.anchor), atol=1e-9)
        assert np.hypot(*query.view) > 0.5


def test_a_keyframe_that_saw_nothing_itself_is_no_place_and_looks_for_none() -> None:
    """Submaps about it hold what its neighbours saw, and where it stands among that only odometry tells."""
    keyframes = KeyframeStore()
    seen = extract_points(LaserScan(0.0, np.full(181, 3.0), -np.pi / 2, np.pi / 180, 0.1, 30.0))
    nothing = extract_points(LaserScan(0.0, np.full(181, np.inf), -np.pi / 2, np.pi / 180, 0.1, 30.0))
    for k in range(120):
        points = nothing if 12 <= k <= 20 or k == 110 else seen
        keyframes.add(Keyframe(float(k), points, np.zeros(3), np.array([0.5 * k, 0, 0]), 0.5 * k, np.zeros(3),
                               np.eye(3)))  # fmt: skip
    places = Places(keyframes, SlamConfig())
    everyone = np.arange(120)
    anchors = everyone[places.are_anchors(everyone, 119)]
    assert {8, 24} <= set(anchors.tolist())
    assert not {12, 16, 20} & set(anchors.tolist())
    assert places.can_close(111)
    assert not places.can_close(110)
    assert not places.can_close(3)
