"""Which parts of a graph are tied to the world, and what to hold where nothing ties them.

Relative measurements do not change when everything is moved as one rigid body. Whether the other factors of a
connected part see such a motion is a question of rank: with ``V`` the motions in the tangents of the
variables, ``G = sum (J V)^T Omega (J V)`` over the factors of the part, of size 3 in the plane and 6 in
space.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew import _native
from clew.geometry import SE2, SE3, so2, so3
from clew.graph import Factor, FactorGraph, Variables

Array = NDArray[np.float64]
Index = NDArray[np.int64]

#: Kinds of factors (`Factor.native`) whose residual no rigid motion of all its variables changes.
RELATIVE = ("between", "point", "range_bearing", "bearing", "range")
_RANK_TOLERANCE = 1e-9
_ROUNDING = 1e-20  # share of cancelling terms in a squared derivative that is rounding
_DIRECTIONS = {
    2: ("x", "y", "the heading"),
    3: ("x", "y", "z", "the rotation about x", "the rotation about y", "the rotation about z"),
}


@dataclass(frozen=True)
class Part:
    """A connected part of the graph whose position or heading no factor ties down.

    Attributes:
        size: number of variables.
        anchor: key of the first pose (or variable), which is held if everything is free.
        held: whether holding the anchor fixes the part.
        directions: what is free, in words.
    """

    size: int
    anchor: int
    held: bool
    directions: tuple[str, ...]

    def __str__(self) -> str:
        who = (
            f"variable {self.anchor}"
            if self.size == 1
            else f"{self.size:,} variables around key {self.anchor}"
        )
        if self.held:
            return f"Nothing ties {who} to the world; key {self.anchor} was held where it was."
        return (
            f"Nothing fixes {', '.join(self.directions)} of {who}; add a Prior on one of its poses, or hold "
            "one with set_constant."
        )


@dataclass(frozen=True, eq=False)
class Gauge:
    """What was found about the frame of reference.

    Attributes:
        parts: the connected parts that are not tied down.
        held: rows of the variables that are held, by kind.
        count: number of connected parts, variables without factors included.
    """

    parts: tuple[Part, ...]
    held: dict[type[Any], Index]
    count: int


def find_gauge(graph: FactorGraph) -> Gauge:
    """Connected parts of a graph and what to hold so that each has a frame of reference."""
    tables = tuple(graph.variables())
    blocks = list(graph.blocks())
    if not tables:
        return Gauge((), {}, 0)
    base = dict(zip((t.kind for t in tables), np.cumsum([0, *(len(t.keys) for t in tables)]), strict=False))
    order = np.concatenate([table.order for table in tables])
    total = len(order)
    rank = np.empty(total, np.int64)  # nodes are numbered by their addition, so that the first pose leads
    rank[np.argsort(order)] = np.arange(total)
    nodes = []
    for block in blocks:
        rows = graph.positions(block.keys)
        nodes.append(np.stack([rank[rows[:, p] + base[kind]] for p, kind in enumerate(block.kinds)], axis=1))
    none = np.empty(0, np.int64)
    i = np.concatenate([none, *(np.repeat(n[:, 0], n.shape[1] - 1) for n in nodes)])
    j = np.concatenate([none, *(n[:, 1:].ravel() for n in nodes)])
    component = _native.solve.spanning_forest(total, i, j, none)[4]

    space = np.empty(total, np.int64)
    for table in tables:
        space[rank[base[table.kind] : base[table.kind] + len(table.keys)]] = table.kind.space
    count = int(component.max()) + 1
    _, leader = np.unique(component, return_index=True)  # first variable of each part
    origin = np.zeros((count, 3))
    for table in tables:
        mine = rank[base[table.kind] : base[table.kind] + len(table.keys)]
        first = np.flatnonzero(leader[component[mine]] == mine)
        origin[component[mine[first]], : table.kind.space] = table.values[first, : table.kind.space]

    seen = np.zeros((count, 6, 6))
    floor = np.full(count, 1e-300)
    for table in tables:  # a constant variable sees every motion that moves it
        mine = rank[base[table.kind] : base[table.kind] + len(table.keys)]
        constant = np.flatnonzero(table.constant)
        if not len(constant):
            continue
        motion = _motions(table.kind, table.values[constant], origin[component[mine[constant]]])
        np.add.at(seen, component[mine[constant]], _pad(np.swapaxes(motion, 1, 2) @ motion))
    for block, node in zip(blocks, nodes, strict=True):
        if block.native not in RELATIVE and len(block):
            part = component[node[:, 0]]
            sight, terms = _sight(graph, tables, block, origin[part])
            np.add.at(seen, part, _pad(sight))
            np.add.at(floor, part, _ROUNDING * terms)
    seen[np.trace(seen, axis1=1, axis2=2) <= floor] = 0.0
    seen[~np.isfinite(seen).all(axis=(1, 2))] = np.eye(6)  # the solve itself will find out and say so

    parts, held = _judge(tables, base, rank, component, leader, space, seen)
    return Gauge(parts, held, count)


def _judge(
    tables: tuple[Variables, ...],
    base: dict[type[Any], Any],
    rank: Index,
    component: Index,
    leader: Index,
    space: Index,
    seen: Array,
) -> tuple[tuple[Part, ...], dict[type[Any], Index]]:
    """Name the parts that some rigid motion leaves unseen, and choose what to hold in those that are wholly
    free."""
    count = len(leader)
    sizes = np.bincount(component, minlength=count)
    pose = np.full(count, -1, np.int64)
    keys = np.empty(len(rank), np.int64)
    for table in tables:
        mine = rank[base[table.kind] : base[table.kind] + len(table.keys)]
        keys[mine] = table.keys
        if table.kind in (SE2, SE3):
            found, first = np.unique(component[mine], return_index=True)
            lower = (pose[found] < 0) | (mine[first] < pose[found])
            pose[found[lower]] = mine[first[lower]]
    parts, anchors = [], []
    for part in np.flatnonzero(_unseen(seen, space[leader])):
        dim = int(space[leader[part]])
        gauge = 3 if dim == 2 else 6
        free = np.eye(gauge)
        if seen[part].any():
            values, vectors = np.linalg.eigh(seen[part, :gauge, :gauge])
            free = vectors[:, values <= _RANK_TOLERANCE * max(values[-1], 1e-300)]
        anchor = int(pose[part]) if pose[part] >= 0 else int(leader[part])
        hold = free.shape[1] == gauge and (pose[part] >= 0 or sizes[part] == 1)
        parts.append(Part(int(sizes[part]), int(keys[anchor]), bool(hold), _words(free, dim)))
        if hold:
            anchors.append(anchor)
    held = {}
    for table in tables:
        mine = rank[base[table.kind] : base[table.kind] + len(table.keys)]
        rows = np.flatnonzero(np.isin(mine, anchors))
        if len(rows):
            held[table.kind] = rows
    return tuple(parts), held


def _unseen(seen: Array, space: Index) -> NDArray[np.bool_]:
    """Parts for which the matrix of seen motions is rank deficient; in most graphs nothing is seen at all."""
    some: NDArray[np.bool_] = np.any(seen, axis=(1, 2))
    lost = np.logical_not(some)
    for dim, gauge in ((2, 3), (3, 6)):
        mine = np.flatnonzero(some & (space == dim))
        if len(mine):
            values = np.linalg.eigvalsh(seen[mine, :gauge, :gauge])
            lost[mine] = values[:, 0] <= _RANK_TOLERANCE * np.maximum(values[:, -1], 1e-300)
    return lost


def _words(free: Array, dim: int) -> tuple[str, ...]:
    """Names of the free motions: the axes with the largest share in them."""
    share = (free**2).sum(axis=1)
    names = _DIRECTIONS[dim]
    return tuple(names[k] for k in sorted(np.argsort(-share, kind="stable")[: free.shape[1]]))


def _sight(
    graph: FactorGraph, tables: tuple[Variables, ...], block: Factor, origin: Array
) -> tuple[Array, Array]:
    """``(J V)^T Omega (J V)`` of each factor of a block, and the size of the terms that cancel in it."""
    values_of = {table.kind: table.values for table in tables}
    rows = graph.positions(block.keys)
    values = [values_of[kind][rows[:, p]] for p, kind in enumerate(block.kinds)]
    _, jacobians = block.linearise(*values)
    terms = np.stack(
        [
            j @ _motions(kind, value, origin)
            for j, kind, value in zip(jacobians, block.kinds, values, strict=True)
        ]
    )
    seen = terms.sum(axis=0)
    size = np.trace(block.information, axis1=1, axis2=2) * (terms**2).sum(axis=(0, 2, 3))
    return np.swapaxes(seen, 1, 2) @ block.information @ seen, size


def _motions(kind: type[Any], values: Array, origin: Array) -> Array:
    """Tangents ``(N, dim, 3 or 6)`` of the rigid motions of everything about `origin`: translations,
    rotations."""
    dim = kind.space
    arm = values[:, :dim] - origin[:, :dim]
    turn = np.stack([-arm[:, 1], arm[:, 0]], axis=1)[:, :, None] if dim == 2 else -so3.hat(arm)
    world = np.concatenate([np.broadcast_to(np.eye(dim), (len(arm), dim, dim)), turn], axis=2)
    if kind not in (SE2, SE3):
        return world
    if dim == 2:
        rotation = so2.matrix(values[:, 2:])
        spin = np.ones((len(arm), 1, 1))
    else:
        rotation = so3.matrix(values[:, 3:])
        spin = np.swapaxes(rotation, 1, 2)
    still = np.zeros((len(arm), spin.shape[1], dim))
    return np.concatenate(
        [np.swapaxes(rotation, 1, 2) @ world, np.concatenate([still, spin], axis=2)], axis=1
    )


def _pad(matrices: Array) -> Array:
    out = np.zeros((len(matrices), 6, 6))
    out[:, : matrices.shape[1], : matrices.shape[2]] = matrices
    return out
