"""Plain worlds that show one difficulty each."""

from __future__ import annotations

import numpy as np

from clew.errors import InputError
from clew.sim.world import Array, World, box, chain, pillar


def long_corridor(seed: int, *, length: float = 80.0, width: float = 2.4, features: int = 12) -> World:
    """A straight corridor with a few cabinets at its walls: little tells a robot how far it has come.

    Args:
        seed: of the places of the cabinets.
        length, width: metres.
        features: number of cabinets, 0.25 m deep.
    """
    _require("long_corridor", length >= 10.0 and width >= 1.6 and features >= 0,
             "needs a length of 10 m or more, a width of 1.6 m or more and no negative number of features")
    rng = np.random.default_rng(seed)
    outlines = [box(0.0, 0.0, length, width)]
    for x in rng.uniform(1.0, length - 2.0, features):
        wide = rng.uniform(0.4, 1.2)
        y = 0.0 if rng.random() < 0.5 else width - 0.25
        outlines.append(box(x, y, x + wide, y + 0.25))
    xs = np.linspace(2.0, length - 2.0, max(int(length // 10), 2))
    places = np.stack([xs, np.full_like(xs, width / 2)], axis=1)
    return World(f"corridor-{seed}", np.concatenate(outlines), places, np.array(chain(list(range(len(xs))))))


def hall(seed: int, *, width: float = 40.0, depth: float = 30.0, pillars: int = 30) -> World:
    """One large hall with pillars and crates: far walls, few features, free paths in all directions.

    Args:
        seed: of the places of pillars and crates.
        width, depth: metres.
        pillars: number of obstacles.
    """
    _require("hall", width >= 12.0 and depth >= 12.0 and pillars >= 0,
             "needs 12 m or more in both directions and no negative number of pillars")
    rng = np.random.default_rng(seed)
    columns, rows = int(width // 6), int(depth // 6)
    xs, ys = np.meshgrid(np.linspace(3.0, width - 3.0, columns), np.linspace(3.0, depth - 3.0, rows))
    places = np.stack([xs.ravel(), ys.ravel()], axis=1)
    index = np.arange(len(places)).reshape(rows, columns)
    links = np.concatenate([np.stack([index[:, :-1].ravel(), index[:, 1:].ravel()], axis=1),
                            np.stack([index[:-1].ravel(), index[1:].ravel()], axis=1)])
    outlines = [box(0.0, 0.0, width, depth)]
    # Obstacles stand in the middle of the meshes of the net of paths, so that no path is blocked.
    mesh_x, mesh_y = (xs[0, :-1] + xs[0, 1:]) / 2, (ys[:-1, 0] + ys[1:, 0]) / 2
    meshes = rng.permutation(len(mesh_x) * len(mesh_y))[:pillars]
    for mesh in meshes:
        x = mesh_x[mesh % len(mesh_x)] + rng.uniform(-0.8, 0.8)
        y = mesh_y[mesh // len(mesh_x)] + rng.uniform(-0.8, 0.8)
        size = rng.uniform(0.2, 0.8)
        outlines.append(pillar(x, y, size) if rng.random() < 0.5
                        else box(x - size, y - size, x + size, y + size))
    return World(f"hall-{seed}", np.concatenate(outlines), places, links.astype(np.int64))


def loop(seed: int, *, length: float = 300.0, width: float = 2.4) -> World:
    """A closed corridor around a square: one long loop with nothing to close it but its end.

    Args:
        seed: of cabinets along the walls.
        length: of the middle line of the corridor, metres.
        width: of the corridor, metres.
    """
    _require("loop", length >= 40.0 and width >= 1.6,
             "needs a length of 40 m or more and a width of 1.6 m or more")
    rng = np.random.default_rng(seed)
    side, half = length / 4, width / 2
    outlines = [box(-half, -half, side + half, side + half), box(half, half, side - half, side - half)]
    count = max(int(side // 6), 2)
    for edge in range(4):
        for along in rng.uniform(2.0, side - 2.0, count):
            wide, outer = rng.uniform(0.3, 0.8), rng.random() < 0.5
            inset = (-half + 0.2 if outer else half - 0.2)
            across = (inset, -half) if outer else (inset, half)
            x0, x1, y0, y1 = along - wide, along + wide, min(across), max(across)
            outlines.append(_on_edge(edge, side, x0, y0, x1, y1))
    corners = np.array([[0.0, 0.0], [side, 0.0], [side, side], [0.0, side]])
    steps = np.linspace(0.0, 1.0, count, endpoint=False)[:, None]
    places = np.concatenate([corners[i] + steps * (corners[(i + 1) % 4] - corners[i]) for i in range(4)])
    order = list(range(len(places)))
    return World(f"loop-{seed}", np.concatenate(outlines), places, np.array(chain([*order, 0])))


def identical_doors(seed: int, *, length: float = 70.0, width: float = 2.2, spacing: float = 4.0) -> World:
    """Two parallel corridors joined at both ends, with the same recessed door every few metres on both sides.

    Each stretch of wall looks like the one before it, and each corridor like the other; what there is besides are the
    four corners and a few notice boards.

    Args:
        seed: of the places of the notice boards.
        length: of the two long corridors, metres.
        width: of the corridors, metres.
        spacing: from door to door, metres.
    """
    _require("identical_doors", length >= 20.0 and width >= 1.6 and spacing >= 2.0,
             "needs a length of 20 m or more, a width of 1.6 m or more and doors 2 m apart or more")
    rng = np.random.default_rng(seed)
    half, across = width / 2, 14.0
    doors = [(x, x + 1.0) for x in np.arange(3.0, length - 3.0, spacing)]
    lines = [(-half, -1.0), (half, 1.0), (across - half, -1.0), (across + half, 1.0)]  # y of a wall, way into it
    outlines = []
    for index, (y, into) in enumerate(lines):
        inner = index in (1, 2)
        since, to = (half, length - half) if inner else (-half, length + half)
        ends = np.array([since, *(x for door in doors for x in door), to]).reshape(-1, 2)
        outlines.append(np.stack([np.stack([ends[:, 0], np.full(len(ends), y)], axis=1),
                                  np.stack([ends[:, 1], np.full(len(ends), y)], axis=1)], axis=1))
        deep = y + 0.15 * into
        for x0, x1 in doors:
            outlines.append(np.array([[[x0, y], [x0, deep]], [[x0, deep], [x1, deep]], [[x1, deep], [x1, y]]]))
    for x in (-half, half, length - half, length + half):
        low, high = (half, across - half) if half <= x <= length - half else (-half, across + half)
        outlines.append(np.array([[[x, low], [x, high]]]))
    for _ in range(6):
        y, into = lines[int(rng.integers(4))]
        x = float(rng.choice([door[1] for door in doors])) + rng.uniform(0.3, spacing - 2.0)
        outlines.append(box(x, min(y, y - 0.12 * into), x + 0.5, max(y, y - 0.12 * into)))
    xs = np.linspace(0.0, length, max(int(length // 10), 2))
    places = np.concatenate([np.stack([xs, np.zeros_like(xs)], axis=1),
                             np.stack([xs[::-1], np.full_like(xs, across)], axis=1)])
    return World(f"doors-{seed}", np.concatenate(outlines), places, np.array(chain([*range(len(places)), 0])))


def _on_edge(edge: int, side: float, x0: float, y0: float, x1: float, y1: float) -> Array:
    """Outline of a box given along the south edge, turned to one of the four edges of the square."""
    outline = box(x0, y0, x1, y1) - side / 2
    turn = np.linalg.matrix_power(np.array([[0.0, -1.0], [1.0, 0.0]]), edge)
    return np.asarray(outline @ turn.T + side / 2)


def _require(name: str, holds: bool, message: str) -> None:
    if not holds:
        raise InputError(f"{name}: {message}")
