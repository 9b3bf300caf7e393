"""One graph of all robots' graphs, given where the robots stand to each other."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.factors import Between, PointObservation, RangeBearing
from clew.fleet.edges import EdgeAgreement
from clew.fleet.keys import translate
from clew.fleet.robot import Encounters, RobotGraph
from clew.geometry import SE2, SE3
from clew.graph import Factor, FactorGraph, Role
from clew.noise import Cauchy

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Table = tuple[Index, Index]

#: An encounter may be with somebody else; what contradicts by more than this loses its say.
ENCOUNTER_KERNEL = Cauchy(3.0)


def join_graphs(robots: Sequence[RobotGraph], frames: Sequence[Array], tables: Sequence[Table]) -> FactorGraph:
    """All variables and factors, values in the frame of the first robot.

    Args:
        robots: whose graphs.
        frames: pose of each robot's world in that of the first.
        tables: old and new keys of each; a landmark whose new key another robot has before is the same landmark.

    Raises:
        InputError: a robot other than the first is tied to the world in several places.
    """
    joint = FactorGraph()
    for robot, frame, table in zip(robots, frames, tables, strict=True):
        first = robot is robots[0]
        functions = robot.pose_kind.functions
        for variables in robot.graph.variables():
            keys = translate(table, variables.keys)
            new = np.array([int(key) not in joint for key in keys], dtype=bool)
            is_pose = variables.kind in (SE2, SE3)
            move: Any = functions.compose if is_pose else functions.act
            values = variables.kind.from_array(move(frame[None], variables.values[new]))
            (joint.add_pose if is_pose else joint.add_point)(values, key=keys[new])
            if first:
                joint.set_constant(keys[variables.constant])
        for block in _own_factors(robot, first):
            twin: Any = copy.copy(block)
            object.__setattr__(twin, "keys", translate(table, block.keys.ravel()).reshape(block.keys.shape))
            joint.add(twin)
    return joint


def _own_factors(robot: RobotGraph, first: bool) -> list[Factor]:
    """The robot's factors; what ties it to its own world's origin is left out unless that is everybody's world."""
    blocks = list(robot.graph.blocks())
    ties = [block for block in blocks if len(block.kinds) == 1]
    if first or not ties:
        return blocks
    if sum(map(len, ties)) > 1:
        raise InputError(f"robot {robot.name}: its graph is tied to the world in {sum(map(len, ties))} places "
                         "(priors, positions), so its frame is not free to be merged; remove all but one")
    return [block for block in blocks if len(block.kinds) > 1]


def add_edges(joint: FactorGraph, agreed: EdgeAgreement, table_a: Table, table_b: Table) -> None:
    """Add relative poses between two robots."""
    edges = agreed.edges
    joint.add(Between(translate(table_a, edges.poses), translate(table_b, edges.other_poses), edges.measurement,
                      information=edges.information, role=Role.LOOP))


def add_encounters(joint: FactorGraph, met: Encounters, rows: Index, table_a: Table, table_b: Table) -> None:
    """Add sightings of another robot by range and bearing.

    What is seen is a point carried by the other robot, a landmark that only its pose of that moment knows.
    """
    poses, others = translate(table_a, met.poses[rows]), translate(table_b, met.other_poses[rows])
    carried = joint.add_point(joint.values(others).array[:, :2])
    joint.add(PointObservation(others, carried, np.zeros((len(rows), 2)), sigmas=met.mounting))
    joint.add(RangeBearing(poses, carried, met.ranges[rows], met.bearings[rows], covariance=met.covariance,
                           kernel=ENCOUNTER_KERNEL))
