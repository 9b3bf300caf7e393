"""An office building: two long corridors joined by cross corridors, rooms with doors and furniture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from clew.errors import InputError
from clew.sim.world import Array, World, box, chain, pillar, polygon, wall

THICKNESS = 0.15
DOOR = 1.0
#: Free way from a door into the room, metres wide: no furniture stands here.
LANE = 1.0
#: Width of rooms that are all the same.
ALIKE_WIDTH = 4.0


@dataclass(frozen=True)
class Plan:
    """Measures of the building, metres.

    From south to north: a row of rooms, the south corridor, two rows of rooms back to back, the north
    corridor, a row of rooms. Cross corridors join the two corridors at both ends and in between.
    """

    length: float = 70.0
    corridor: float = 2.2
    depth: float = 4.6
    crossings: int = 3

    @property
    def corridors(self) -> tuple[float, float]:
        """y of the middle lines of the south and of the north corridor."""
        south = self.depth + self.corridor / 2
        return south, south + self.corridor + 2 * self.depth

    @property
    def height(self) -> float:
        """Depth of the whole building from south to north."""
        return 4 * self.depth + 2 * self.corridor

    def crossing_positions(self, rng: np.random.Generator) -> list[float]:
        """x of the middle lines of the cross corridors: evenly spaced, the inner ones shifted at random."""
        positions = np.linspace(self.corridor / 2, self.length - self.corridor / 2, self.crossings)
        spacing = self.length / max(self.crossings - 1, 1)
        positions[1:-1] += rng.uniform(-0.15, 0.15, self.crossings - 2) * spacing
        return [float(x) for x in positions]


def office_building(seed: int, *, length: float = 70.0, crossings: int = 3, open_doors: float = 0.6,
                    alike: bool = False) -> World:
    """Corridors that form loops, rooms with doors and furniture; same seed, same building.

    Args:
        seed: of everything that is random.
        length: of the two long corridors, metres, at least 20.
        crossings: cross corridors, at least 2; they make ``crossings - 1`` loops.
        open_doors: share of rooms whose door stands open; a robot can enter these.
        alike: whether all rooms are the same, down to the furniture; only which doors stand open tells them apart.

    Raises:
        InputError: the building is too short for its cross corridors.
    """
    plan = Plan(length=length, crossings=crossings)
    if crossings < 2 or length < 20.0 or length / (crossings - 1) < 10.0:
        raise InputError(f"office_building: {length:g} m with {crossings} cross corridors: "
                         "needs at least 2 of them, 20 m in all and 10 m between neighbours")
    rng = np.random.default_rng(seed)
    builder = _Builder(plan, plan.crossing_positions(rng), rng, open_doors, seed if alike else None)
    return builder.build(f"{'alike' if alike else 'office'}-{seed}")


class _Builder:
    """Puts walls, furniture and places together."""

    def __init__(self, plan: Plan, crossings: list[float], rng: np.random.Generator,
                 open_doors: float, one_room: int | None) -> None:
        self.plan = plan
        self.one_room = one_room  # seed of the room that all are copies of, if they are alike
        self.crossings = crossings
        self.rng = rng
        self.open_doors = open_doors
        self.outlines: list[Array] = []
        self.places: list[tuple[float, float]] = []
        self.links: list[tuple[int, int]] = []
        self.rooms: list[int] = []
        self.doors: list[Array] = []
        #: Places on each corridor with their x.
        self.on_corridor: list[list[tuple[float, int]]] = [[], []]

    def build(self, name: str) -> World:
        plan = self.plan
        south, north = plan.corridors
        half = plan.corridor / 2
        for x in self.crossings:
            self._place(x, south, 0)
            self._place(x, north, 1)
            self.links.append((len(self.places) - 2, len(self.places) - 1))
        blocks = [(a + half, b - half) for a, b in zip(self.crossings[:-1], self.crossings[1:], strict=True)]
        middle = (south + north) / 2
        self._row([(0.0, plan.length)], door_y=south - half, back_y=0.0, corridor=0)
        self._row(blocks, door_y=south + half, back_y=middle, corridor=0)
        self._row(blocks, door_y=north - half, back_y=middle, corridor=1)
        self._row([(0.0, plan.length)], door_y=north + half, back_y=plan.height, corridor=1)
        for x in (0.0, plan.length):  # outer walls at the two ends of the building
            self.outlines.append(wall((x, 0.0), (x, plan.height), THICKNESS))
        for corridor in self.on_corridor:
            self.links += chain([place for _, place in sorted(corridor)])
        return World(name, np.concatenate(self.outlines), np.array(self.places),
                     np.array(self.links, dtype=np.int64), np.array(self.rooms, dtype=np.int64),
                     doors=np.array(self.doors).reshape(-1, 3, 2))

    def _place(self, x: float, y: float, corridor: int | None = None) -> int:
        self.places.append((x, y))
        index = len(self.places) - 1
        if corridor is not None:
            self.on_corridor[corridor].append((x, index))
        return index

    def _row(self, blocks: list[tuple[float, float]], door_y: float, back_y: float, corridor: int) -> None:
        """Rooms side by side in each block, all with their doors in the wall at `door_y`."""
        low, high = min(door_y, back_y), max(door_y, back_y)
        for since, to in blocks:
            doors = []
            left = since
            while left < to:
                width = ALIKE_WIDTH if self.one_room is not None else float(self.rng.uniform(3.2, 7.0))
                right = left + width if to - left - width > 3.2 else to
                doors.append(self._room(left, right, door_y, back_y, corridor))
                if right < to:
                    self.outlines.append(wall((right, low), (right, high), THICKNESS))
                left = right
            self.outlines.append(wall((since, door_y), (to, door_y), THICKNESS, doors))
            self.outlines.append(wall((since, back_y), (to, back_y), THICKNESS))
            for x in (since, to):
                self.outlines.append(wall((x, low), (x, high), THICKNESS))

    def _room(self, left: float, right: float, door_y: float, back_y: float,
              corridor: int) -> tuple[float, float]:
        """Furniture and places of one room; returns the opening of its door."""
        alike = self.one_room is not None
        closed = alike and self.rng.random() > self.open_doors
        rng = np.random.default_rng(self.one_room) if alike else self.rng
        door = left + ALIKE_WIDTH / 2 if alike else float(rng.uniform(left + 0.9, right - 0.9))
        opening = (door - DOOR / 2, door + DOOR / 2)
        inward = 1.0 if back_y > door_y else -1.0
        if closed or (not alike and rng.random() > self.open_doors):  # a closed door is a recess in the wall
            recess = door_y + inward * THICKNESS / 2
            self.outlines.append(box(opening[0], recess - 0.02, opening[1], recess + 0.02))
            return opening
        front = self._place(door, self.plan.corridors[corridor], corridor)
        inside = self._place(door, door_y + inward * float(rng.uniform(1.6, 2.8)))
        self.links.append((front, inside))
        self.rooms.append(inside)
        leaf = door_y + inward * THICKNESS / 4
        self.doors.append(np.array([[opening[0], leaf], [opening[1], leaf],
                                    [opening[0], leaf + inward * DOOR]]))
        for low, high in ((left, door - LANE / 2), (door + LANE / 2, right)):
            self._furnish(low + 0.2, high - 0.2, door_y + inward * 0.3, back_y - inward * 0.3, rng)
        # Something against the back wall, seen from the door.
        back = back_y - inward * THICKNESS / 2
        wide = float(rng.uniform(0.6, 1.6))
        self.outlines.append(box(door - wide / 2, min(back, back - inward * 0.4), door + wide / 2,
                                 max(back, back - inward * 0.4)))
        return opening

    def _furnish(self, x0: float, x1: float, y0: float, y1: float, rng: np.random.Generator) -> None:
        """Desks at any angle and round pillars in a rectangle beside the lane of the door."""
        low, high = min(y0, y1), max(y0, y1)
        if x1 - x0 < 0.9:
            return
        for _ in range(int(rng.integers(1, 4))):
            reach = min(float(rng.uniform(0.25, 0.7)), (x1 - x0) / 2.1)
            centre = np.array([rng.uniform(x0 + reach, x1 - reach), rng.uniform(low + reach, high - reach)])
            if rng.random() < 0.25:
                self.outlines.append(pillar(centre[0], centre[1], 0.4 * reach))
                continue
            turn = rng.choice([0.0, rng.uniform(-0.5, 0.5)])
            aspect = rng.uniform(0.35, 0.8)
            half = reach / np.hypot(1, aspect) * np.array([1.0, aspect])
            corners = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
            rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
            self.outlines.append(polygon(centre + corners @ rotation.T))
