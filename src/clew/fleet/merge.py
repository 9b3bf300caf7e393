"""Merge robots: relative poses with no initial guess, then all graphs solved as one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.fleet.common import Link, common_landmarks
from clew.fleet.edges import agree_on_edges, edges_between
from clew.fleet.joint_graph import add_edges, add_encounters, join_graphs
from clew.fleet.keys import separate_keys
from clew.fleet.relative_pose import MergeOptions, RelativePose, Verdict, relative_pose
from clew.fleet.robot import RobotGraph
from clew.geometry import SE2
from clew.graph import FactorGraph
from clew.solve import Solution, Status, optimize

Array = NDArray[np.float64]
Index = NDArray[np.int64]

#: Told how many of how many are done.
Progress = Callable[[int, int], None]

#: Maps that are merged over two ways must agree: greatest distance between where the two put a landmark or pose.
LOOP_DISTANCE = 1.0


@dataclass(frozen=True, eq=False)
class MergedFleet:
    """All robots in the frame of the first.

    Attributes:
        names: of the robots.
        solution: of the joint graph; ``solution.graph`` is the solved graph.
        frames: ``(R, storage)`` pose of each robot's own world in the first one's, as first found (the joint solve
            moves every pose for itself).
        keys: old and new keys of each robot's variables, old ones ascending.
        links: relative poses that were found, by the robots' numbers.
        shared: keys of landmarks that at least two robots have in common.
        identities: of landmarks, by key.
    """

    names: tuple[str, ...]
    solution: Solution
    frames: Array
    keys: tuple[tuple[Index, Index], ...]
    links: Mapping[tuple[int, int], Link]
    shared: Index
    identities: Mapping[int, str]

    @property
    def graph(self) -> FactorGraph:
        """The solved joint graph."""
        return self.solution.graph

    def poses(self, robot: int) -> Any:
        """Poses of one robot in the frame of the first, in the order of its own keys."""
        return self.solution.graph.values(self.pose_keys(robot))

    def pose_keys(self, robot: int) -> Index:
        """Keys of one robot's poses in the joint graph, in the order of its own keys."""
        new = self.keys[robot][1]
        return new[np.isin(new, self.solution.keys())]


def merge(
    robots: Sequence[RobotGraph], options: MergeOptions | None = None, *, progress: Progress | None = None
) -> MergedFleet:
    """Merge robots that share landmarks, saw each other or have relative poses between their graphs.

    Args:
        robots: at least two; see `robot_graph`.
        options: when two maps count as overlapping.
        progress: called with the number of pairs of robots that have been compared and the number of all pairs; when
            all are, the joint graph is solved.

    Raises:
        InputError: fewer than two robots, two of one name, poses of different kinds, robots that have nothing in
            common that a relative pose could be told from (the text says what was tried), robots that disagree
            about identities, or relative poses that contradict each other.
    """
    options = options or MergeOptions()
    _check(robots)
    kind = robots[0].pose_kind
    links, refusals = _links(robots, options, progress or (lambda done, most: None))
    frames = _frames(robots, links, refusals, kind)
    _check_loops(robots, links, frames, kind)
    tables = separate_keys([robot.graph for robot in robots], [robot.name for robot in robots])
    common = common_landmarks(robots, links, frames, tables)
    joint = join_graphs(robots, frames, common.tables)
    numbers = {robot.name: number for number, robot in enumerate(robots)}
    for (a, b), link in links.items():
        if link.edges is not None:
            add_edges(joint, link.edges, common.tables[a], common.tables[b])
    for a, robot in enumerate(robots):
        met = robot.encounters
        for name in [] if met is None else np.unique(met.others):
            if met is not None and str(name) in numbers:
                b = numbers[str(name)]
                add_encounters(joint, met, np.flatnonzero(met.others == name), common.tables[a], common.tables[b])
    solution = optimize(joint, init="file")
    if solution.status is Status.UNDERCONSTRAINED:
        raise InputError(f"the merged graph cannot be solved: {solution.status.value}")
    return MergedFleet(tuple(numbers), solution, np.stack(frames), tuple(common.tables), links, common.shared,
                       common.identities)


def _check(robots: Sequence[RobotGraph]) -> None:
    names = [robot.name for robot in robots]
    if len(robots) < 2:
        raise InputError("merging takes at least two robots")
    if len(set(names)) < len(names):
        raise InputError(f"two robots have the same name ({', '.join(sorted(names))}); name them apart")
    if len({robot.pose_kind for robot in robots}) > 1:
        raise InputError("some robots have poses in the plane, others in space; merge robots of one kind")


def _links(robots: Sequence[RobotGraph], options: MergeOptions,
           progress: Progress) -> tuple[dict[tuple[int, int], Link], dict[tuple[int, int], str]]:
    """Relative poses of all pairs for which there is one, and for the others the reason why not."""
    links, refusals = {}, {}
    pairs = list(combinations(range(len(robots)), 2))
    for done, (a, b) in enumerate(pairs):
        progress(done, len(pairs))
        link = _by_edges(robots[a], robots[b], options)
        if isinstance(link, Link):
            links[a, b] = link
            continue
        refusals[a, b] = link
        if robots[a].pose_kind is not SE2:
            continue
        found = relative_pose(robots[a], robots[b], options)
        if found.verdict is Verdict.FOUND:
            links[a, b] = Link(found.T_a_b, found.support, found)
        else:
            refusals[a, b] = f"{link}, and {_reason(found)}"
    progress(len(pairs), len(pairs))
    return links, refusals


def _by_edges(a: RobotGraph, b: RobotGraph, options: MergeOptions) -> Link | str:
    edges = edges_between(a, b)
    if edges is None:
        return "no relative pose between their graphs"
    agreed = agree_on_edges(a, b, edges, options.confidence, options.edge_slack)
    agreeing = len(agreed.edges)
    if agreeing < options.minimum_edges or agreed.runner_up >= agreeing:
        return f"of {agreed.count} relative poses between their graphs, no more than {agreeing} agree"
    landmarks = relative_pose(a, b, options) if a.pose_kind is SE2 else None
    if landmarks is None or landmarks.verdict is not Verdict.FOUND:
        return Link(agreed.T_a_b, agreeing, None, agreed)
    return Link(landmarks.T_a_b, agreeing + landmarks.support, landmarks, agreed)


def _reason(found: RelativePose) -> str:
    if found.verdict is Verdict.TOO_FEW:
        return "no common landmarks" if found.support < 3 else found.verdict.value
    return f"{found.verdict.value} ({found.support} landmarks agree, {found.runner_up} for another pose)"


def _frames(robots: Sequence[RobotGraph], links: Mapping[tuple[int, int], Link],
            refusals: Mapping[tuple[int, int], str], kind: type[Any]) -> list[Array]:
    """World of each robot in that of the first, over the links of most support first (Prim's spanning tree)."""
    functions = kind.functions
    frames: dict[int, Array] = {0: kind.identity(()).array}
    while len(frames) < len(robots):
        ways = [(link.support, -a, -b) for (a, b), link in links.items() if (a in frames) != (b in frames)]
        if not ways:
            lost = next(number for number in range(len(robots)) if number not in frames)
            reasons = "; ".join(
                f"{robots[a].name} and {robots[b].name}: {why}" for (a, b), why in refusals.items() if lost in (a, b))
            raise InputError(f"robot {robots[lost].name} cannot be placed relative to the others, nothing was merged "
                             f"({reasons})")
        _, a, b = max(ways)
        a, b = -a, -b
        T_a_b = links[a, b].T_a_b
        if a in frames:
            frames[b] = functions.compose(frames[a], T_a_b)
        else:
            frames[a] = functions.compose(frames[b], functions.inverse(T_a_b))
    return [frames[number] for number in range(len(robots))]


def _check_loops(robots: Sequence[RobotGraph], links: Mapping[tuple[int, int], Link], frames: Sequence[Array],
                 kind: type[Any]) -> None:
    """Links that closed a loop of robots must agree with the way round; one of them would be wrong otherwise."""
    functions = kind.functions
    for (a, b), link in links.items():
        around = functions.between(frames[a], frames[b])
        points = robots[b].graph.values(kind).array[:, : kind.space]
        says = [link.T_a_b] if link.edges is None else [link.T_a_b, link.edges.T_a_b]
        for T_a_b in says:
            apart = np.median(np.linalg.norm(functions.act(around, points) - functions.act(T_a_b, points), axis=1))
            if apart > LOOP_DISTANCE:
                raise InputError(f"robots {robots[a].name} and {robots[b].name}: what ties them contradicts the other "
                                 f"measurements of where they stand by {apart:.1f} m; nothing was merged")
