"""The one door by which robot logs come in."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from clew.motion import Odometry, TurnRates
from clew.scan import LaserScan

Measurement = LaserScan | Odometry | TurnRates


@dataclass
class ReadReport:
    """What a reader met: counts of records used, and of records left out by reason."""

    used: Counter[str] = field(default_factory=Counter)
    skipped: Counter[str] = field(default_factory=Counter)


class Skipped(Protocol):
    """Counts of the records that a reader left out."""

    @property
    def skipped(self) -> Counter[str]: ...


class Records(Protocol):
    """Measurements that were recorded or simulated, from a file or in place of one."""

    @property
    def path(self) -> Path: ...
    @property
    def report(self) -> Skipped: ...
    @property
    def scan_count(self) -> int: ...
    @property
    def duration(self) -> float: ...
    def measurements(self) -> Iterator[Measurement]: ...


class Log(Protocol):
    """A robot's log as a stream of measurements in the order of their timestamps, without duplicates.

    Opened with another order than that of time (see `open_log`), timestamps may step back.

    Where a record carries a scan and the odometry of the same instant, the `Odometry` comes right before its
    `LaserScan`, with the same timestamp. Readings of a gyro come as one `TurnRates` before the scan that is
    next, up to the end of its sweep: a laser tells of a scan when it is over.
    """

    path: Path
    report: ReadReport

    @property
    def scan_count(self) -> int:
        """Number of scans that `measurements` will yield (for progress)."""
        ...

    @property
    def duration(self) -> float:
        """Seconds from the first to the last scan."""
        ...

    @property
    def has_odometry(self) -> bool:
        """Whether there is any odometry in the log."""
        ...

    @property
    def has_gyro(self) -> bool:
        """Whether there are turn rates of a gyro in the log."""
        ...

    def measurements(self) -> Iterator[Measurement]:
        """Yield scans, odometry readings and turn rates in the order of time.

        Raises:
            InputError: the file is missing, empty, no log, or holds no scan.
        """
        ...
