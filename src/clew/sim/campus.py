"""Outdoors: buildings along streets, trees and parked cars, and gaps through which nothing comes back."""

from __future__ import annotations

import numpy as np

from clew.errors import InputError
from clew.sim.world import Array, World, box, pillar, polygon

STREET = 13.0  # metres from building to building
BLOCK = (28.0, 20.0)  # metres from corner to corner of the largest building


def campus(seed: int, *, columns: int = 2, rows: int = 2) -> World:
    """Streets around blocks with one building each; beyond the outer streets stand a few more buildings.

    Args:
        seed: of the shapes of buildings, trees and cars.
        columns, rows: of blocks.

    Raises:
        InputError: there is not one block.
    """
    if columns < 1 or rows < 1:
        raise InputError(f"campus: {columns} x {rows} blocks: needs at least one")
    rng = np.random.default_rng(seed)
    step = np.array(BLOCK) + STREET
    outlines = []
    for column in range(-1, columns + 1):
        for row in range(-1, rows + 1):
            outside = column in (-1, columns) or row in (-1, rows)
            if outside and rng.random() < 0.4:
                continue  # open country
            outlines.append(_building(rng, np.array([column, row]) * step + STREET / 2))
    places = np.array([[x, y] for y in range(rows + 1) for x in range(columns + 1)], dtype=np.float64) * step
    index = np.arange(len(places)).reshape(rows + 1, columns + 1)
    links = np.concatenate([np.stack([index[:, :-1].ravel(), index[:, 1:].ravel()], axis=1),
                            np.stack([index[:-1].ravel(), index[1:].ravel()], axis=1)])
    for a, b in places[links]:
        outlines += _roadside(rng, a, b)
    return World(f"campus-{seed}", np.concatenate(outlines), places, links.astype(np.int64))


def _building(rng: np.random.Generator, corner: Array) -> Array:
    """A rectangle with one corner cut out, somewhat smaller than its block."""
    inset = rng.uniform(0.0, 2.5, 4)
    x0, y0 = corner + inset[:2]
    x1, y1 = corner + np.array(BLOCK) - inset[2:]
    cut_x, cut_y = rng.uniform(0.2, 0.5) * (x1 - x0), rng.uniform(0.2, 0.5) * (y1 - y0)
    outline = np.array([[x0, y0], [x1, y0], [x1, y1 - cut_y], [x1 - cut_x, y1 - cut_y], [x1 - cut_x, y1], [x0, y1]])
    middle = corner + np.array(BLOCK) / 2
    flip = np.where(rng.random(2) < 0.5, -1.0, 1.0)
    return polygon(middle + (outline - middle) * flip)


def _roadside(rng: np.random.Generator, a: Array, b: Array) -> list[Array]:
    """Trees and cars on both sides of the street from `a` to `b`."""
    along = (b - a) / np.linalg.norm(b - a)
    across = np.array([-along[1], along[0]])
    outlines = []
    for _ in range(int(rng.integers(2, 6))):
        place = a + along * rng.uniform(6.0, np.linalg.norm(b - a) - 6.0)
        beside = place + across * rng.choice([-1.0, 1.0]) * rng.uniform(3.2, 4.5)
        if rng.random() < 0.6:
            outlines.append(pillar(beside[0], beside[1], float(rng.uniform(0.1, 0.25)), 8))
        else:
            half = 2.1 * np.abs(along) + 0.9 * np.abs(across)
            outlines.append(box(*(beside - half), *(beside + half)))
    return outlines
