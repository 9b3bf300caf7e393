"""Which landmarks of several robots are one, and the key that they then share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from clew.errors import InputError
from clew.fleet.edges import EdgeAgreement
from clew.fleet.relative_pose import RelativePose
from clew.fleet.robot import RobotGraph
from clew.geometry import SE2, se2

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Table = tuple[Index, Index]

#: Two sightings of one identity further apart than this, metres, once the maps are placed, cannot be one landmark.
IDENTITY_DISTANCE = 2.0


@dataclass(frozen=True, eq=False)
class Link:
    """Where two robots stand to each other, and from what.

    Attributes:
        T_a_b: ``(storage,)`` world of b in that of a.
        support: number of landmarks or edges that agree.
        landmarks: how it was found from landmarks, or None.
        edges: how it was found from relative poses, or None.
    """

    T_a_b: Array
    support: int
    landmarks: RelativePose | None = None
    edges: EdgeAgreement | None = None

    @property
    def common(self) -> Index:
        """``(n, 2)`` indices of landmarks of a and b that are the same."""
        return np.empty((0, 2), np.int64) if self.landmarks is None else self.landmarks.common


@dataclass(frozen=True, eq=False)
class CommonLandmarks:
    """What `common_landmarks` found.

    Attributes:
        tables: old and new keys of each robot, common landmarks with one new key.
        shared: those new keys.
        identities: of landmarks that have one, by new key.
    """

    tables: list[Table]
    shared: Index
    identities: dict[int, str] = field(default_factory=dict)


def common_landmarks(robots: Sequence[RobotGraph], links: Mapping[tuple[int, int], Link], frames: Sequence[Array],
                     tables: Sequence[Table]) -> CommonLandmarks:
    """Make landmarks one that are of one identity, or that the links of two robots say are the same.

    Where links would make two landmarks of one robot the same, none of that group is merged but by identity.

    Raises:
        InputError: one identity stands in different places.
    """
    starts = np.cumsum([0] + [len(robot.landmarks) for robot in robots])
    owner = np.repeat(np.arange(len(robots)), np.diff(starts))
    named = _by_identity(robots, frames, starts)
    linked = [np.empty((0, 2), np.int64)]
    linked += [link.common + starts[[a, b]] for (a, b), link in links.items()]
    groups = _groups(np.concatenate([*linked, named]), starts[-1])
    crowded = _with_two_of_one(groups, owner)
    if crowded.any():
        groups = _groups(np.concatenate([*(pairs[~crowded[groups[pairs[:, 0]]]] for pairs in linked), named]),
                         starts[-1])
    olds = np.concatenate([robot.landmarks.keys for robot in robots])
    news = np.concatenate([
        table[1][np.searchsorted(table[0], robot.landmarks.keys)] for robot, table in zip(robots, tables, strict=True)
    ])  # fmt: skip
    _, first = np.unique(groups, return_index=True)
    unified = news[first[groups]]
    result = []
    for number, (old, new) in enumerate(tables):
        changed = new.copy()
        mine = owner == number
        changed[np.searchsorted(old, olds[mine])] = unified[mine]
        result.append((old, changed))
    names = np.concatenate([robot.landmarks.identities for robot in robots])
    identities = {int(key): str(name) for key, name in zip(unified, names, strict=True) if name}
    keys, counts = np.unique(unified, return_counts=True)
    return CommonLandmarks(result, keys[counts > 1], identities)


def _by_identity(robots: Sequence[RobotGraph], frames: Sequence[Array], starts: Index) -> Index:
    """Pairs ``(n, 2)`` of landmarks of one identity, numbered over all robots."""
    pairs = [np.empty((0, 2), np.int64)]
    if robots[0].pose_kind is not SE2:
        return pairs[0]
    for a, b in combinations(range(len(robots)), 2):
        names_a, names_b = (robots[number].landmarks.identities for number in (a, b))
        named_a, named_b = np.flatnonzero(names_a != ""), np.flatnonzero(names_b != "")
        shared, at_a, at_b = np.intersect1d(names_a[named_a], names_b[named_b], return_indices=True)
        at_a, at_b = named_a[at_a], named_b[at_b]
        there = [se2.act(frames[n], robots[n].landmarks.positions[at]) for n, at in ((a, at_a), (b, at_b))]
        apart = np.hypot(*(there[0] - there[1]).T)
        if (apart > IDENTITY_DISTANCE).any():
            raise InputError(f"robots {robots[a].name} and {robots[b].name} disagree about identities: "
                             f"{', '.join(shared[apart > IDENTITY_DISTANCE])} stand {apart.max():.1f} m apart in "
                             "the two maps; correct or remove these identities")
        pairs.append(np.stack([at_a + starts[a], at_b + starts[b]], axis=1))
    return np.concatenate(pairs)


def _groups(pairs: Index, count: int) -> Index:
    ones = np.ones(len(pairs), dtype=bool)
    graph = coo_array((ones, (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def _with_two_of_one(groups: Index, owner: Index) -> NDArray[np.bool_]:
    """By group: whether two of its landmarks are of one robot."""
    members, counts = np.unique(np.stack([groups, owner]), axis=1, return_counts=True)
    crowded = np.zeros(groups.max(initial=-1) + 1, dtype=bool)
    crowded[members[0][counts > 1]] = True
    return crowded
