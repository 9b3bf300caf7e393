"""A simulated log: what a robot would have recorded, and the truth behind it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from clew.errors import InputError
from clew.motion import Odometry, TurnRates
from clew.scan import LaserScan
from clew.sim.doors import cover as cover_by_doors
from clew.sim.doors import leaves, swing
from clew.sim.drive import Drive
from clew.sim.gyro import GyroModel
from clew.sim.laser import LaserModel, cast_rays, sensor_poses
from clew.sim.odometry import OdometryModel
from clew.sim.people import cover, walk
from clew.sim.world import Array, World


@dataclass
class SimulationReport:
    """Counts of records by kind, as a reader of a file would report them; nothing is left out."""

    used: Counter[str] = field(default_factory=Counter)
    skipped: Counter[str] = field(default_factory=Counter)


@dataclass(frozen=True, eq=False)
class SimulatedLog:
    """Scans and odometry of a drive with its truth; `measurements` streams them as a log file's reader does.

    Attributes:
        world: where the robot drove.
        laser: with what it looked.
        timestamps: ``(N,)`` seconds, one a scan.
        T_world_robot: ``(N, 3)`` true poses at the timestamps (x, y, theta).
        T_odom_robot: ``(N, 3)`` dead reckoning at the timestamps, from the identity.
        ranges: ``(N, B)`` metres, ``inf`` for no return.
        moving: ``(N, B)`` True where the beam met a person or the leaf of a door.
        door: ``(N, B)`` True where it was a door.
        door_share: ``(N, D)`` how far each door of the world stood open, from 0 (closed) to 1; ``(N, 0)`` without.
        path: stands for the path of a log file; nothing is there.
        report: counts of records.
        gyro: readings of an IMU's gyro, or None without.
    """

    world: World
    laser: LaserModel
    timestamps: Array
    T_world_robot: Array
    T_odom_robot: Array
    ranges: Array
    moving: NDArray[np.bool_]
    door: NDArray[np.bool_]
    door_share: Array
    path: Path
    report: SimulationReport
    gyro: TurnRates | None = None

    @property
    def scan_count(self) -> int:
        """Number of scans."""
        return len(self.timestamps)

    @property
    def duration(self) -> float:
        """Seconds from the first to the last scan."""
        return float(self.timestamps[-1] - self.timestamps[0])

    @property
    def has_odometry(self) -> bool:
        """Always: the odometry of every scan is known."""
        return True

    @property
    def has_gyro(self) -> bool:
        """Whether the robot had an IMU."""
        return self.gyro is not None

    def scan(self, index: int) -> LaserScan:
        """The scan at the timestamp of this index."""
        return LaserScan(float(self.timestamps[index]), self.ranges[index], self.laser.angle_min,
                         self.laser.angle_increment, self.laser.range_min, self.laser.range_max,
                         np.array(self.laser.T_robot_sensor), time_increment=self.laser.time_increment,
                         moments=self.laser.moments if self.laser.interlace else None)

    def measurements(self) -> Iterator[LaserScan | Odometry | TurnRates]:
        """Yield the gyro's readings up to the end of the scan, the odometry and then the scan of each timestamp."""
        done = 0
        for index, timestamp in enumerate(self.timestamps.tolist()):
            if self.gyro is not None:
                after = int(np.searchsorted(self.gyro.timestamps, timestamp + self.laser.sweep, side="right"))
                if after > done:
                    yield self.gyro.part(done, after)
                done = after
            yield Odometry(timestamp, self.T_odom_robot[index])
            yield self.scan(index)


def _swept(driven: Drive, laser: LaserModel) -> Array:
    """``(N, B, 3)`` poses of the laser at each beam, its x axis along the beam."""
    poses = driven.T_world_robot
    unwrapped = np.column_stack([poses[:, :2], np.unwrap(poses[:, 2])])
    moments = driven.timestamps[:, None] + laser.moments
    at = np.minimum(moments, driven.timestamps[-1])
    moved = unwrapped if len(poses) < 2 else CubicSpline(driven.timestamps, unwrapped)(at)
    T_world_sensor = sensor_poses(np.broadcast_to(moved, (*moments.shape, 3)), laser)
    return np.stack([*np.moveaxis(T_world_sensor[..., :2], -1, 0), T_world_sensor[..., 2] + laser.angles], axis=-1)


def simulate(world: World, driven: Drive, laser: LaserModel, odometry: OdometryModel, seed: int, *,
             people: int = 0, doors: bool = False, gyro: GyroModel | None = None) -> SimulatedLog:
    """Record what a robot measures on a drive; same arguments, same bytes.

    Laser, odometry, people, doors and gyro have streams of noise of their own: changing one leaves the others as
    they are.

    Args:
        world: where the robot drives.
        driven: timestamps and true poses, one scan each.
        laser: the sensor.
        odometry: errors of dead reckoning.
        seed: of all noise.
        people: number of people who walk through the world.
        doors: whether the doors of the world open and close; otherwise there are none in its openings.
        gyro: of an IMU, if the robot has one.

    Raises:
        InputError: an empty drive or a negative number of people.
    """
    if len(driven.timestamps) == 0 or people < 0:
        raise InputError("simulate: needs a drive of at least one pose and no negative number of people")
    of_laser, of_odometry, of_people, of_doors, of_gyro = np.random.SeedSequence(seed).spawn(5)
    poses = driven.T_world_robot
    T_world_sensor = sensor_poses(poses, laser)
    angles = laser.angles
    if laser.sweep > 0.0 or laser.interlace > 0.0:  # each beam is measured from a place of its own
        T_world_sensor = _swept(driven, laser).reshape(-1, 3)
        angles = np.zeros(1)
    distances = cast_rays(world.segments, T_world_sensor, angles, laser.range_max + 1.0)
    positions = np.zeros((len(poses), 0, 2))
    if people:
        positions = walk(world, driven.timestamps, people, int(of_people.generate_state(1)[0]))
    share = np.zeros((len(poses), 0))
    if doors:
        walkers = np.concatenate([poses[:, None, :2], positions], axis=1)
        share = swing(world, driven.timestamps, walkers, int(of_doors.generate_state(1)[0]))
    segments = leaves(world.doors[:share.shape[1]], share)
    repeats = len(distances) // len(poses)
    distances, door = cover_by_doors(distances, T_world_sensor, angles, np.repeat(segments, repeats, axis=0))
    distances, person = cover(distances, T_world_sensor, angles, np.repeat(positions, repeats, axis=0))
    scans = (len(poses), laser.beams)
    distances, door, person = distances.reshape(scans), door.reshape(scans), person.reshape(scans)
    ranges = laser.measure(distances, np.random.default_rng(of_laser))
    seen = np.isfinite(ranges)
    count = len(driven.timestamps)
    readings = None if gyro is None else gyro.measure(driven, np.random.default_rng(of_gyro))
    used = Counter(scan=count, odometry=count)
    if readings is not None:
        used["gyro"] = len(readings.timestamps)
    return SimulatedLog(world, laser, driven.timestamps, poses,
                        odometry.reckon(poses, np.random.default_rng(of_odometry)), ranges,
                        (door | person) & seen, door & ~person & seen, share, Path(f"{world.name}-{seed}.simulated"),
                        SimulationReport(used=used), readings)
