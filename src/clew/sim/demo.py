"""Ready-made drives: the demo, and worlds of several kinds for benchmarks."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from clew.errors import InputError
from clew.sim.campus import campus
from clew.sim.drive import drive
from clew.sim.gyro import GyroModel
from clew.sim.laser import LaserModel
from clew.sim.layouts import hall, identical_doors, long_corridor, loop
from clew.sim.log import SimulatedLog, simulate
from clew.sim.odometry import OdometryModel
from clew.sim.office import office_building
from clew.sim.route import tour
from clew.sim.world import World

_WORLDS: dict[str, Callable[[int], World]] = {
    "office": office_building,
    "corridor": long_corridor,
    "hall": hall,
    "loop": loop,
    "alike": partial(office_building, alike=True),
    "doors": identical_doors,
    "campus": campus,
}
#: Kinds of worlds that `simulate_kind` knows.
KINDS = tuple(_WORLDS)


def simulate_demo(seed: int = 1, *, duration: float = 400.0, people: int = 0, doors: bool = False) -> SimulatedLog:
    """The demo: 400 s through an office building, 5 scans a second, odometry that fails by metres."""
    return simulate_kind("office", seed, duration=duration, people=people, doors=doors)


def simulate_kind(kind: str, seed: int, *, duration: float = 400.0, rate: float = 5.0, people: int = 0,
                  doors: bool = False, laser: LaserModel | None = None,
                  odometry: OdometryModel | None = None, gyro: GyroModel | None = None) -> SimulatedLog:
    """A drive through a world of one of the `KINDS`; the seed makes world, way and noise.

    Args:
        kind: office, corridor, hall, loop; alike (an office whose rooms are all the same), doors (corridors with
            identical doors) or campus (outdoors).
        seed: of everything.
        duration: seconds.
        rate: scans a second, Hz.
        people: number of people who walk around.
        doors: whether doors open and close (only offices have any that do).
        laser: the sensor; `LaserModel` by default.
        odometry: `OdometryModel.medium` by default.
        gyro: of an IMU; none by default.

    Raises:
        InputError: no such kind, or a duration that is not positive.
    """
    if kind not in _WORLDS:
        raise InputError(f"simulate_kind: no world of kind {kind!r}; there are {', '.join(KINDS)}")
    if not duration > 0.0:
        raise InputError(f"simulate_kind: duration of {duration:g} s: must be positive")
    world = _WORLDS[kind](seed)
    # A tour at top speed would take the whole time; corners and turns make it longer, and the end is cut off.
    driven = drive(tour(world, seed, 1.2 * duration), rate=rate, duration=duration)
    return simulate(world, driven, laser or LaserModel(), odometry or OdometryModel.medium(), seed,
                    people=people, doors=doors, gyro=gyro)
