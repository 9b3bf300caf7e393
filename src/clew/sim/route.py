"""Routes through a world's graph of free paths."""

from __future__ import annotations

from collections import Counter

import numpy as np

from clew.errors import InputError
from clew.sim.world import Array, World

#: Share of the rooms passed that a tour enters.
ENTER_ROOM = 0.3
#: How far a route passes beside a place, at most, metres along each axis (rooms have narrow doors).
JITTER_CORRIDOR, JITTER_ROOM = 0.2, 0.08


def tour(world: World, seed: int, length: float) -> Array:
    """Way points of a walk that closes loops and comes back over its own way in both directions.

    At every place the walk takes the link that it has used least, in either direction; it turns round only in
    dead ends and when it leaves a room, and enters some of the rooms that it passes. Each visit of a place
    passes it a little beside where the last one did.

    Args:
        world: where to walk.
        seed: of choices between equals, rooms and sideways shifts.
        length: metres to walk at least.

    Returns:
        ``(W, 2)`` way points, metres; a walk into a dead end comes back over the same points.

    Raises:
        InputError: the length is not positive, or nothing leads away from the start.
    """
    if not length > 0.0:
        raise InputError(f"tour: length of {length:g} m: must be positive")
    rng = np.random.default_rng(seed)
    neighbours: dict[int, list[int]] = {}
    for a, b in world.links.tolist():
        neighbours.setdefault(a, []).append(b)
        neighbours.setdefault(b, []).append(a)
    if world.start not in neighbours:
        raise InputError(f"tour: no link leads away from place {world.start} of {world.name}")
    rooms = set(world.rooms.tolist())
    used: Counter[tuple[int, int]] = Counter()
    here, came_from = world.start, -1
    visited, walked = [here], 0.0
    while walked < length:
        onward = [n for n in neighbours[here] if n != came_from and n not in rooms]
        beside = [n for n in neighbours[here] if n in rooms and not used[here, n]]
        if beside and here not in rooms and rng.random() < ENTER_ROOM:
            choice = beside[0]
        elif here in rooms or not onward:
            # Out of a room a robot may turn either way; at a dead end there is only back.
            choice = came_from if came_from >= 0 else neighbours[here][0]
        else:
            lots = rng.random(len(onward))
            choice = min(zip(onward, lots, strict=True),
                         key=lambda n: (used[here, n[0]] + used[n[0], here], n[1]))[0]
        used[here, choice] += 1
        walked += float(np.linalg.norm(world.places[choice] - world.places[here]))
        here, came_from = choice, here
        visited.append(here)
    reach = np.where(np.isin(visited, world.rooms), JITTER_ROOM, JITTER_CORRIDOR)[:, None]
    return np.asarray(world.places[visited] + rng.uniform(-1.0, 1.0, (len(visited), 2)) * reach)
