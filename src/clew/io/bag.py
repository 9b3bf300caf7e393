"""ROS 1 and ROS 2 bags (bag, sqlite3, MCAP), read with the `rosbags` library."""

from __future__ import annotations

import importlib.util
import math
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError, MissingDependencyError
from clew.io.bag_imu import choose_imu, tells_rates, turn_rate_of, upward
from clew.io.bag_transforms import Transforms
from clew.io.log import ReadReport
from clew.io.recorded import RecordedLog, ScanTable

Array = NDArray[np.float64]

_SCAN, _ODOMETRY, _IMU = "sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu"
#: A sweep may last this many periods of the scans: clocks are not exact.
LONGEST_SWEEP = 1.05
#: Static transforms may be repeated on /tf all along; they are among the first messages there.
_FIRST_TF = 2000

BAG_MAGIC = {b"#ROSBAG V": ".bag", b"SQLite format 3\0": ".db3", b"\x89MCAP0\r\n": ".mcap"}


def bag_suffix(path: Path) -> str | None:
    """The kind of bag that a file is by its first bytes, as the ending of its name; None for no bag."""
    with path.open("rb") as file:
        head = file.read(16)
    return next((suffix for magic, suffix in BAG_MAGIC.items() if head.startswith(magic)), None)


def load_rosbags(path: Path) -> tuple[Any, Any]:
    """The reader of the `rosbags` library and its types for bags that define none.

    Raises:
        MissingDependencyError: the library is missing, or does not fit; the text names `path`.
    """
    advice = "install it with: pip install 'clew[bags]'"
    if importlib.util.find_spec("rosbags") is None:
        raise MissingDependencyError(f"{path}: ROS bags need the library rosbags, which is missing; {advice}")
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        return AnyReader, get_typestore(Stores.ROS2_HUMBLE)
    except (ImportError, AttributeError) as error:
        raise MissingDependencyError(f"{path}: the installed version of rosbags does not fit ({error}); "
                                     f"{advice}") from error


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """A reader on the bag; the library goes by file names, so a bag of another name gets a fitting link."""
    reader, types = load_rosbags(path)
    suffix = None if path.is_dir() else bag_suffix(path)
    with tempfile.TemporaryDirectory() as folder:
        named = path
        if suffix is not None and path.suffix != suffix:
            named = Path(folder) / f"bag{suffix}"
            named.symlink_to(path.resolve())
        try:
            bag = reader([named], default_typestore=types)
            bag.open()
        # What the library meets in a damaged file comes out as it is: struct.error, KeyError, sqlite3.Error.
        except Exception as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise InputError(f"{path}: the bag cannot be opened ({reason}); "
                             "it is damaged or was not closed: reindex it, or record it again") from error
        try:
            yield bag
        finally:
            bag.close()


def _choose(path: Path, connections: list[Any], kind: str, wanted: str | None, usual: str) -> str | None:
    """Topic to read for a message type: the one asked for, the usual one, or the first."""
    topics: list[str] = sorted({c.topic for c in connections if c.msgtype == kind})
    if wanted is not None:
        if wanted not in topics:
            raise InputError(f"{path}: has no topic {wanted} of type {kind}; it has: {_listing(connections)}")
        return wanted
    for topic in topics:
        if topic == usual:
            return topic
    return topics[0] if topics else None


def _listing(connections: list[Any]) -> str:
    return ", ".join(sorted({f"{c.topic} ({c.msgtype})" for c in connections})) or "no topics"


def _seconds(stamp: Any, received: int) -> float:
    """Time of the measurement; of its arrival where the header has none."""
    nanoseconds = stamp.sec * 1_000_000_000 + stamp.nanosec
    return int(nanoseconds or received) / 1_000_000_000


class _Collector:
    """Takes in messages one by one and makes tables of them."""

    def __init__(self) -> None:
        self.numbers: list[tuple[float, float, float, float, float, float]] = []
        self.ranges: list[NDArray[np.float32]] = []
        self.odometry: list[tuple[float, float, float, float, float]] = []
        self.positions: list[int] = []  # of the scans in the order of the bag
        self.frames: tuple[str, str] = ("", "")  # of the robot and of the laser
        self.rates: list[Array] = []  # and accelerations of the IMU
        self.rate_times: list[tuple[float, float]] = []  # and positions
        self.imu_frame = ""
        self.without_rates = 0  # messages of an IMU that say themselves that they hold none

    def scan(self, message: Any, received: int) -> bool:
        """Whether the message is a usable scan."""
        row = (_seconds(message.header.stamp, received), float(message.angle_min),
               float(message.angle_increment), float(message.range_min), float(message.range_max),
               float(message.time_increment))
        if not all(map(math.isfinite, row[:3])) or len(message.ranges) == 0:
            return False
        self.numbers.append(row)
        self.positions.append(len(self.positions) + len(self.odometry))
        self.ranges.append(np.asarray(message.ranges, dtype=np.float32))
        self.frames = (self.frames[0], self.frames[1] or message.header.frame_id)
        return True

    def reading(self, message: Any, received: int) -> bool:
        """Whether the message is a usable pose."""
        place, q = message.pose.pose.position, message.pose.pose.orientation
        yaw = math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))
        position = float(len(self.positions) + len(self.odometry))
        row = (_seconds(message.header.stamp, received), place.x, place.y, yaw, position)
        if not all(map(math.isfinite, row)):
            return False
        self.odometry.append(row)
        self.frames = (self.frames[0] or message.child_frame_id, self.frames[1])
        return True

    def imu(self, message: Any, received: int) -> bool:
        """Whether the message holds turn rates, or says itself that it does not."""
        if not tells_rates(message):
            self.without_rates += 1
            return True
        row, time = turn_rate_of(message), _seconds(message.header.stamp, received)
        if row is None or not math.isfinite(time):
            return False
        self.rates.append(row)
        self.rate_times.append((time, float(len(self.positions) + len(self.odometry))))
        self.imu_frame = self.imu_frame or message.header.frame_id
        return True

    def turn_rates(self, transforms: Transforms) -> Array:
        """``(G, 3)`` time, turn rate about the robot's vertical axis, position."""
        rows = np.array(self.rates).reshape(-1, 6)
        up = upward(rows, self.frames[0], self.imu_frame, transforms)
        times, positions = np.array(self.rate_times).reshape(-1, 2).T
        return np.column_stack([times, rows[:, :3] @ up, positions])

    def tables(self, transforms: Transforms) -> tuple[ScanTable, Array]:
        """All scans and all odometry readings."""
        numbers = np.array(self.numbers).reshape(-1, 6)
        count = np.array([len(r) for r in self.ranges], dtype=np.int64)
        ranges = np.concatenate(self.ranges or [np.zeros(0, dtype=np.float32)]).astype(np.float64)
        range_min = np.where(numbers[:, 3] > 0, numbers[:, 3], 0.0)
        range_max = np.where(numbers[:, 4] > range_min, numbers[:, 4], np.inf)
        ranges[ranges >= np.repeat(range_max, count)] = np.inf
        ranges[~((ranges > 0) & (ranges >= np.repeat(range_min, count)))] = np.nan
        T_robot_sensor, upside_down = transforms.sensor_pose(*self.frames)
        sense = -1.0 if upside_down else 1.0
        scans = ScanTable(times=numbers[:, 0], first=np.cumsum(count) - count, count=count, ranges=ranges,
                          angle_min=sense * numbers[:, 1], angle_increment=sense * numbers[:, 2],
                          range_min=range_min, range_max=range_max, T_robot_sensor=T_robot_sensor,
                          T_odom_robot=np.full((len(numbers), 3), np.nan),
                          rank=np.zeros(len(numbers), dtype=np.int64),
                          position=np.array(self.positions, dtype=np.int64),
                          time_increment=_time_increment(numbers[:, 5], count, numbers[:, 0]))
        return scans, np.array(self.odometry).reshape(-1, 5)


def _time_increment(stated: Array, count: NDArray[np.int64], times: Array) -> float:
    """Seconds between beams of a sweep, or 0 where what the messages state cannot be.

    Drivers leave the field empty, or fill it with the period of the scans or with microseconds: a sweep must be over
    when the next begins.
    """
    increment = float(np.median(stated)) if len(stated) else 0.0
    gaps = np.diff(np.sort(times))
    gaps = gaps[gaps > 0]
    if not (math.isfinite(increment) and increment > 0.0 and len(gaps)):
        return 0.0
    return increment if increment * float(np.median(count)) <= LONGEST_SWEEP * float(np.median(gaps)) else 0.0


def _collect(bag: Any, connections: list[Any], report: ReadReport) -> _Collector:
    """Read the chosen connections; a damaged message is left out, damage of the file ends the reading."""
    collector = _Collector()
    messages = bag.messages(connections=connections)
    while True:
        try:
            connection, received, data = next(messages)
        except StopIteration:
            return collector
        except Exception:  # see `_opened`
            report.skipped["bag is damaged: rest of the file"] += 1
            return collector
        take = {_SCAN: collector.scan, _ODOMETRY: collector.reading, _IMU: collector.imu}[connection.msgtype]
        try:
            message = bag.deserialize(data, connection.msgtype)
            good = take(message, received)
        except Exception:  # see `_opened`
            good = False
        if not good:
            report.skipped[f"broken {connection.msgtype.rsplit('/')[-1]}"] += 1


def _transforms(bag: Any) -> Transforms:
    """Static transforms, then those of /tf."""
    transforms = Transforms()
    for topic, most in (("/tf_static", None), ("/tf", _FIRST_TF)):
        connections = [c for c in bag.connections if c.topic == topic and "tfmessage" in c.msgtype.lower()]
        if connections:
            try:
                for connection, _, data in islice(bag.messages(connections=connections), most):
                    transforms.add(bag.deserialize(data, connection.msgtype).transforms)
            except Exception:  # see `_opened`
                break
    return transforms


@dataclass(frozen=True)
class Topic:
    """Attributes: name, ROS type and number of messages of a topic."""

    name: str
    type: str
    messages: int


def list_topics(path: Path) -> list[Topic]:
    """All topics of a bag, by name.

    Raises:
        InputError, MissingDependencyError: as `read_bag`.
    """
    with _opened(path) as bag:
        counts: Counter[tuple[str, str]] = Counter()
        for connection in bag.connections:
            counts[connection.topic, connection.msgtype] += connection.msgcount
    return [Topic(*name, number) for name, number in sorted(counts.items())]


def read_bag(path: Path, scan_topic: str | None = None, odometry_topic: str | None = None,
             imu_topic: str | None = None, order: str = "time") -> RecordedLog:
    """Read ``sensor_msgs/LaserScan``, ``nav_msgs/Odometry`` and ``sensor_msgs/Imu`` of a bag, by their headers' times.

    Ranges beyond the sensor's bounds become ``inf`` (too far) or ``nan`` (too near). The laser's place on the
    robot comes from the transforms between its frame and the odometry's child frame (else ``base_link``); the
    identity where the bag has none. A laser mounted upside down gets a negative `angle_increment`. Turn rates of an IMU
    are those about the robot's vertical axis, which `upward` finds in its frame, however it is mounted.

    Raises:
        InputError: the bag cannot be read, has no such topic, or no scan; or `imu_topic` tells no turn rates.
        MissingDependencyError: the library `rosbags` is missing or of an incompatible version.
    """
    report = ReadReport()
    with _opened(path) as bag:
        connections = list(bag.connections)
        scans = _choose(path, connections, _SCAN, scan_topic, "/scan")
        odometry = _choose(path, connections, _ODOMETRY, odometry_topic, "/odom")
        if scans is None:
            raise InputError(f"{path}: has no topic of type {_SCAN}; it has: {_listing(connections)}")
        imu, faults = _choose(path, connections, _IMU, imu_topic, ""), dict[str, str]()
        if imu is not None and imu_topic is None:
            imu, faults = choose_imu(bag, [c for c in connections if c.msgtype == _IMU])
        wanted = ((_SCAN, scans), (_ODOMETRY, odometry), (_IMU, imu))
        chosen = [c for c in connections if (c.msgtype, c.topic) in wanted]
        for other in connections:
            if other.msgtype in (_SCAN, _ODOMETRY, _IMU) and other not in chosen:
                fault = f" ({faults[other.topic]})" if other.topic in faults else ""
                report.skipped[f"topic {other.topic}{fault}"] += other.msgcount
        collector = _collect(bag, chosen, report)
        if imu_topic is not None and not collector.rates:
            raise InputError(f"{path}: {imu_topic} tells no turn rates; choose another IMU, or none")
        if collector.without_rates:
            report.skipped["Imu without turn rates"] += collector.without_rates
        transforms = _transforms(bag)
    tables = collector.tables(transforms)
    if len(tables[0].times) == 0:
        reasons = ", ".join(report.skipped) or "none recorded"
        raise InputError(f"{path}: no usable laser scan on {scans} ({reasons}); record the bag again")
    return RecordedLog(path, *tables, report, order, collector.turn_rates(transforms))
