"""Graphs of simulated robots: odometry between poses, landmarks by range and bearing, sightings of each other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from clew.factors import Between, RangeBearing
from clew.fleet.robot import Encounters, InterRobotEdges, RobotGraph, robot_graph
from clew.geometry import SE2, se2
from clew.graph import FactorGraph, Role
from clew.sim import ANONYMOUS, NO_LANDMARK, MeetingModel, RobotRun, SightingModel

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def graphs_of_fleet(runs: Sequence[RobotRun], model: SightingModel, meeting: MeetingModel | None = None, *,
                    headings: bool = False) -> list[RobotGraph]:
    """The graphs of robots named ``a``, ``b``, ... , each in its own frame with its first pose at the origin.

    Within a robot, sightings are associated as in truth; each false sighting becomes a landmark of its own. No
    robot knows anything of the landmarks of another but their identities.

    Args:
        runs: what the robots measured.
        model: noise of the sightings.
        meeting: noise of the meetings; None leaves the meetings out.
        headings: use the headings of meetings too: each is then a relative pose.
    """
    names = np.array([chr(ord("a") + robot) for robot in range(len(runs))])
    graphs = []
    for robot, run in enumerate(runs):
        graph, identities = graph_of_run(run, model)
        met, edges = None, None
        if meeting is not None and headings:
            edges = _as_edges(run, names, meeting)
        elif meeting is not None:
            covariance = np.diag([meeting.sigma_range**2, meeting.sigma_bearing**2])
            met = Encounters(run.meetings.poses, names[run.meetings.others], run.meetings.other_poses,
                             run.meetings.ranges, run.meetings.bearings, covariance)
        graphs.append(robot_graph(str(names[robot]), graph, identities, encounters=met, edges=edges))
    return graphs


def graph_of_run(run: RobotRun, model: SightingModel) -> tuple[FactorGraph, dict[int, str]]:
    """Graph with poses ``0 .. N-1``, and the identities of its landmarks by key (by majority of its sightings)."""
    graph = FactorGraph()
    poses = run.T_odom_robot
    keys = graph.add_pose(SE2.from_array(poses))
    graph.add(Between(keys[:-1], keys[1:], run.increments, covariance=run.covariances))
    seen = run.sightings
    if not len(seen):
        return graph, {}
    false = seen.landmarks == NO_LANDMARK
    numbers = np.where(false, seen.landmarks.max() + np.cumsum(false), seen.landmarks)
    _, first, landmark = np.unique(numbers, return_index=True, return_inverse=True)
    local = np.stack([seen.ranges * np.cos(seen.bearings), seen.ranges * np.sin(seen.bearings)], axis=1)
    points = graph.add_point(se2.act(poses[seen.poses[first]], local[first]))
    graph.add(RangeBearing(keys[seen.poses], points[landmark], seen.ranges, seen.bearings,
                           covariance=model.covariance, role=Role.OBSERVATION))
    identities = {}
    for number, key in enumerate(points.tolist()):
        read = seen.identities[(landmark == number) & (seen.identities != ANONYMOUS)]
        if len(read):
            values, counts = np.unique(read, return_counts=True)
            identities[key] = str(values[counts.argmax()])
    return graph, identities


def _as_edges(run: RobotRun, names: NDArray[np.str_], model: MeetingModel) -> InterRobotEdges:
    """Meetings with headings as relative poses, with the covariance that polar measurements have."""
    met = run.meetings
    r, c, s = met.ranges, np.cos(met.bearings), np.sin(met.bearings)
    jacobian = np.zeros((len(r), 3, 3))
    jacobian[:, :2, 0] = np.stack([c, s], axis=1)
    jacobian[:, :2, 1] = np.stack([-r * s, r * c], axis=1)
    jacobian[:, 2, 2] = 1.0
    # The tangent is in the frame of the other robot.
    turned = np.zeros((len(r), 3, 3))
    turned[:, 0, 0] = turned[:, 1, 1] = np.cos(met.headings)
    turned[:, 0, 1], turned[:, 1, 0] = np.sin(met.headings), -np.sin(met.headings)
    turned[:, 2, 2] = 1.0
    jacobian = turned @ jacobian
    noise = np.diag([model.sigma_range**2, model.sigma_bearing**2, model.sigma_heading**2])
    covariance = jacobian @ noise @ np.swapaxes(jacobian, 1, 2) + 1e-6 * np.eye(3)
    return InterRobotEdges(met.poses, names[met.others], met.other_poses,
                           np.stack([r * c, r * s, met.headings], axis=1), np.asarray(np.linalg.inv(covariance)))
