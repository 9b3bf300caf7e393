"""A log held as arrays: sorted, without duplicates, yielded as measurements."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.io.log import Measurement, ReadReport, Records
from clew.motion import Odometry, TurnRates
from clew.scan import LaserScan

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: In which order a log may be read, see `open_log`.
ORDERS = ("time", "recorded", "auto")
#: Records further than this from the median time of the scans have a damaged timestamp (115 days).
_LONGEST_LOG = 1e7


@dataclass(frozen=True, eq=False)
class ScanTable:
    """``N`` scans as arrays; the ranges of all of them lie in one flat array.

    Attributes:
        times: ``(N,)`` seconds.
        first, count: ``(N,)`` where the ranges of each scan begin in `ranges`, and how many they are.
        ranges: ``(R,)`` metres; ``inf`` no return, ``nan`` invalid.
        angle_min, angle_increment, range_min, range_max: ``(N,)`` as in `LaserScan`.
        T_robot_sensor: ``(3,)`` pose of the laser on the robot.
        T_odom_robot: ``(N, 3)`` odometry that came with each scan; ``nan`` where none did.
        rank: ``(N,)`` of two records of one scan (same time, same number of beams) the lower rank is kept.
        position: ``(N,)`` place of each scan in the order of recording, counted together with the odometry.
        time_increment: seconds between neighbouring beams; 0 where nothing is known.
    """

    times: Array
    first: Indices
    count: Indices
    ranges: Array
    angle_min: Array
    angle_increment: Array
    range_min: Array
    range_max: Array
    T_robot_sensor: Array
    T_odom_robot: Array
    rank: Indices
    position: Indices
    time_increment: float = 0.0

    def take(self, chosen: Indices) -> ScanTable:
        """The chosen scans in the order given; the flat array of ranges stays as it is."""
        return ScanTable(self.times[chosen], self.first[chosen], self.count[chosen], self.ranges,
                         self.angle_min[chosen], self.angle_increment[chosen], self.range_min[chosen],
                         self.range_max[chosen], self.T_robot_sensor, self.T_odom_robot[chosen],
                         self.rank[chosen], self.position[chosen], self.time_increment)


def tabulate(scans: Sequence[LaserScan], positions: Sequence[int]) -> ScanTable:
    """Scans as a table, each without odometry of its own; `positions` as in `ScanTable`."""
    count = np.array([len(scan.ranges) for scan in scans], dtype=np.int64)
    numbers = np.array([(scan.timestamp, scan.angle_min, scan.angle_increment, scan.range_min, scan.range_max)
                        for scan in scans], dtype=np.float64).reshape(-1, 5)
    ranges = np.concatenate([np.zeros(0), *(scan.ranges for scan in scans)]).astype(np.float64)
    place = np.asarray(scans[0].T_robot_sensor if scans else np.zeros(3), dtype=np.float64)
    times, angle_min, angle_increment, range_min, range_max = numbers.T
    return ScanTable(times, np.cumsum(count) - count, count, ranges, angle_min, angle_increment, range_min, range_max,
                     place, np.full((len(scans), 3), np.nan), np.zeros(len(scans), dtype=np.int64),
                     np.array(positions, dtype=np.int64))


def _without_duplicates(scans: ScanTable) -> ScanTable:
    """Drop scans that repeat an earlier one at the same time; `scans` are sorted by time."""
    tied = np.zeros(len(scans.times), dtype=bool)
    same = np.diff(scans.times) == 0
    tied[1:] |= same
    tied[:-1] |= same
    seen: dict[tuple[float, int], tuple[int, set[bytes]]] = {}
    keep = np.ones(len(scans.times), dtype=bool)
    for i in np.flatnonzero(tied):
        begin, count, rank = int(scans.first[i]), int(scans.count[i]), int(scans.rank[i])
        content = scans.ranges[begin : begin + count].tobytes()
        best, contents = seen.setdefault((float(scans.times[i]), count), (rank, set()))
        keep[i] = rank == best and content not in contents
        contents.add(content)
    return scans.take(np.flatnonzero(keep))


def _drop(report: ReadReport, reason: str, number: int) -> None:
    if number:
        report.skipped[reason] += number


class RecordedLog:
    """A `Log` whose records are held as arrays.

    Args:
        path: where the log came from.
        scans: all scans, in any order.
        odometry: ``(M, 5)`` readings besides those of the scans: time, x, y, theta, position; in any order.
        report: what the reader met; the counts of used and dropped records are added to it.
        order: one of `ORDERS`, see `open_log`.
        gyro: ``(G, 3)`` time, radians a second, position; in any order.

    Raises:
        InputError: there is no scan.
    """

    def __init__(self, path: Path, scans: ScanTable, odometry: Array, report: ReadReport,
                 order: str = "time", gyro: Array | None = None) -> None:
        if len(scans.times) == 0:
            raise InputError(f"{path}: holds no laser scan; give a log of a robot with a laser")
        self.path = path
        self.report = report
        middle = float(np.median(scans.times))
        good = np.flatnonzero(np.abs(scans.times - middle) <= _LONGEST_LOG)
        _drop(report, "scan with a time far from all others", len(scans.times) - len(good))
        scans = scans.take(good[np.lexsort((scans.rank[good], scans.times[good]))])
        before = len(scans.times)
        self._scans = _without_duplicates(scans)
        _drop(report, "duplicate scan", before - len(self._scans.times))

        near = np.abs(odometry[:, 0] - middle) <= _LONGEST_LOG
        _drop(report, "odometry with a time far from all others", int(np.sum(~near)))
        self._odometry = self._without_repeats(odometry[near])
        self._gyro = self._in_order(np.zeros((0, 3)) if gyro is None else gyro, middle)
        self._with_odometry = ~np.isnan(self._scans.T_odom_robot[:, 0])
        self._ranges = self._scans.ranges
        self._ranges.setflags(write=False)
        self._scan_key, self._odometry_key = self._scans.times, self._odometry[:, 0]
        if order == "recorded" or (order == "auto" and self._recorded_is_smoother()):
            self._scans = self._scans.take(np.argsort(self._scans.position))
            self._odometry = self._odometry[np.argsort(self._odometry[:, 4])]
            self._with_odometry = ~np.isnan(self._scans.T_odom_robot[:, 0])
            self._scan_key = self._scans.position.astype(np.float64)
            self._odometry_key = self._odometry[:, 4]
        report.used["scans"] += len(self._scans.times)
        report.used["odometry"] += len(self._odometry) + int(np.sum(self._with_odometry))
        if len(self._gyro):
            report.used["gyro"] += len(self._gyro)

    def _in_order(self, gyro: Array, middle: float) -> Array:
        """Turn rates sorted by time, one a moment: each is integrated until the next."""
        near = gyro[np.abs(gyro[:, 0] - middle) <= _LONGEST_LOG]
        _drop(self.report, "turn rate with a time far from all others", len(gyro) - len(near))
        near = near[np.argsort(near[:, 0], kind="stable")]
        first = np.diff(near[:, 0], prepend=-np.inf) > 0
        _drop(self.report, "second turn rate of one moment", int(np.sum(~first)))
        return near[first]

    def _without_repeats(self, odometry: Array) -> Array:
        """Sorted by time, without readings that repeat another or the one of a scan."""
        of_scans = np.column_stack([self._scans.times, self._scans.T_odom_robot])
        rows = np.concatenate([of_scans, odometry[:, :4]])
        alone = np.arange(len(rows)) >= len(of_scans)
        order = np.lexsort((alone, rows[:, 3], rows[:, 2], rows[:, 1], rows[:, 0]))
        rows, alone = rows[order], alone[order]
        repeat = np.zeros(len(rows), dtype=bool)
        repeat[1:] = np.all(rows[1:] == rows[:-1], axis=1)
        _drop(self.report, "duplicate odometry", int(np.sum(repeat & alone)))
        # Back in file order among equal times: of two readings at one time the later record is the newer one.
        chosen = order[alone & ~repeat]
        kept = odometry[np.sort(chosen) - len(of_scans)]
        return kept[np.argsort(kept[:, 0], kind="stable")]

    def _recorded_is_smoother(self) -> bool:
        """Whether the path of the odometry is shorter in the order of recording than in that of time."""
        scans = self._scans
        rows = np.column_stack([scans.times, scans.T_odom_robot, scans.position])[self._with_odometry]
        rows = np.concatenate([rows, self._odometry])
        by_time, by_position = (np.lexsort((rows[:, 4], key)) for key in (rows[:, 0], rows[:, 4]))
        timed, recorded = (float(np.sum(np.hypot(*np.diff(rows[order, 1:3], axis=0).T)))
                           for order in (by_time, by_position))
        return recorded < 0.98 * timed

    @classmethod
    def of(cls, log: Records) -> RecordedLog:
        """Any log as arrays; one that is recorded is returned as it is."""
        if isinstance(log, cls):
            return log
        taken = list(log.measurements())
        scans = [(position, m) for position, m in enumerate(taken) if isinstance(m, LaserScan)]
        readings = [(m.timestamp, *m.T_odom_robot, position) for position, m in enumerate(taken)
                    if isinstance(m, Odometry)]
        rates = [np.column_stack([m.timestamps, m.rates, np.full(len(m.rates), position)])
                 for position, m in enumerate(taken) if isinstance(m, TurnRates)]
        report = ReadReport(skipped=log.report.skipped.copy())
        return cls(log.path, tabulate([m for _, m in scans], [p for p, _ in scans]),
                   np.array(readings, dtype=np.float64).reshape(-1, 5), report,
                   gyro=np.concatenate([np.zeros((0, 3)), *rates]))

    @property
    def scans(self) -> ScanTable:
        """All scans in the order of `measurements`."""
        return self._scans

    @property
    def odometry(self) -> Array:
        """``(M, 5)`` readings in the order of `measurements`, those that came with scans left out: time, x, y, theta,
        and their place in the order of recording."""
        return self._odometry

    @property
    def scan_count(self) -> int:
        """Number of scans that `measurements` yields."""
        return len(self._scans.times)

    @property
    def duration(self) -> float:
        """Seconds from the first to the last scan."""
        return float(np.ptp(self._scans.times))

    @property
    def has_odometry(self) -> bool:
        """Whether there is any odometry in the log."""
        return len(self._odometry) > 0 or bool(np.any(self._with_odometry))

    @property
    def gyro(self) -> Array:
        """``(G, 3)`` turn rates in the order of time: time, radians a second, place in the order of recording."""
        return self._gyro

    @property
    def has_gyro(self) -> bool:
        """Whether there are turn rates of a gyro in the log."""
        return len(self._gyro) > 0

    def measurements(self) -> Iterator[Measurement]:
        """Yield scans, odometry readings and turn rates in the order chosen; turn rates always in that of time."""
        scans, odometry = self._scans, self._odometry
        after = np.searchsorted(self._odometry_key, self._scan_key, side="right").tolist()
        times, first, end = scans.times.tolist(), scans.first.tolist(), (scans.first + scans.count).tolist()
        laser = zip(scans.angle_min.tolist(), scans.angle_increment.tolist(), scans.range_min.tolist(),
                    scans.range_max.tolist(), strict=True)
        done, told = 0, 0
        gyro = TurnRates(self._gyro[:, 0].copy(), self._gyro[:, 1].copy())
        rates = np.maximum.accumulate(np.searchsorted(gyro.timestamps, scans.times + scans.time_increment * scans.count,
                                                     side="right")).tolist()
        for i, (angle_min, increment, range_min, range_max) in enumerate(laser):
            for k in range(done, after[i]):
                yield Odometry(float(odometry[k, 0]), odometry[k, 1:4])
            done = max(done, after[i])
            if rates[i] > told:
                yield gyro.part(told, rates[i])
                told = rates[i]
            if self._with_odometry[i]:
                yield Odometry(times[i], scans.T_odom_robot[i])
            yield LaserScan(times[i], self._ranges[first[i] : end[i]], angle_min, increment, range_min,
                            range_max, scans.T_robot_sensor, time_increment=scans.time_increment)
        for k in range(done, len(odometry)):
            yield Odometry(float(odometry[k, 0]), odometry[k, 1:4])
        if told < len(gyro.rates):
            yield gyro.part(told, len(gyro.rates))
