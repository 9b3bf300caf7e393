"""Reads the UTIAS multi-robot data: folders with odometry and recognised landmarks of several robots.

Leung, Halpern, Barfoot, Liu: "The UTIAS multi-robot cooperative localization and mapping dataset" (IJRR 2011).
"""

from __future__ import annotations

import re
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.geometry import wrap
from clew.io.log import ReadReport
from clew.io.sightings import SightingLog, Sightings, SurveyedLandmarks, Velocities
from clew.io.table import read_table

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_BARCODES = "Barcodes.dat"
#: Subjects that are robots by the definition of the data, whether or not their files are there.
_ROBOTS = (1, 2, 3, 4, 5)
_SURVEY = "Landmark_Groundtruth.dat"
_MEASUREMENTS = re.compile(r"Robot(\d+)_Measurement\.dat")


def is_mrclam(folder: str | PathLike[str]) -> bool:
    """Whether a path is a folder of this kind."""
    folder = Path(folder)
    return folder.is_dir() and ((folder / _BARCODES).exists() or bool(mrclam_robots(folder)))


def mrclam_robots(folder: str | PathLike[str]) -> tuple[int, ...]:
    """Numbers of the robots that have an odometry or a measurement file, in order."""
    names = [path.name for path in Path(folder).glob("Robot*_*.dat")] if Path(folder).is_dir() else []
    found = (re.fullmatch(r"Robot(\d+)_(?:Measurement|Odometry)\.dat", name) for name in names)
    return tuple(sorted({int(match[1]) for match in found if match}))


def read_mrclam(folder: str | PathLike[str], robot: int) -> SightingLog:
    """Read one robot's log.

    Sightings of barcodes that ``Barcodes.dat`` does not list, of the robot itself, and with a range that is not
    positive are left out and counted. Subjects 1 to 5 are the robots.

    Raises:
        InputError: a file is missing or broken, the robot saw nothing that is known, its odometry is empty or not in
            the order of time, or its sightings and its odometry have no time in common.
    """
    folder = Path(folder)
    robots = mrclam_robots(folder)
    if not folder.is_dir() or not robots:
        raise InputError(f"{folder}: holds no RobotN_Odometry.dat; give a folder of the UTIAS MRCLAM data")
    if robot not in robots:
        listed = ", ".join(map(str, robots))
        raise InputError(f"{folder}: there is no robot {robot}; its robots are {listed}")
    report = ReadReport()
    odometry = _odometry(folder / f"Robot{robot}_Odometry.dat", report)
    seen = _sightings(folder, robot, report)
    inside = (seen.timestamp >= odometry.timestamp[0]) & (seen.timestamp <= odometry.timestamp[-1])
    report.skipped["sighting at a time without odometry"] += int(np.sum(~inside))
    seen = seen.take(inside)
    mates = np.isin(seen.identity, (*_ROBOTS, *robots))
    if mates.all():
        raise InputError(
            f"{folder}: robot {robot} has no sighting of a landmark at a time of its odometry "
            f"({odometry.timestamp[0]:.1f} to {odometry.timestamp[-1]:.1f} s); without any there is nothing to map"
        )
    report.used["odometry"] += len(odometry)
    report.used["landmark sightings"] += int(np.sum(~mates))
    report.used["robot sightings"] += int(np.sum(mates))
    report.skipped = type(report.skipped)({name: n for name, n in report.skipped.items() if n})
    truth_path = folder / f"Robot{robot}_Groundtruth.dat"
    truth = read_table(truth_path, 4, "time x y theta")[0] if truth_path.exists() else None
    return SightingLog(folder, robot, odometry, seen.take(~mates), seen.take(mates), truth, report)


def read_survey(folder: str | PathLike[str]) -> SurveyedLandmarks | None:
    """Surveyed landmarks, or None if the folder has none; raises `InputError` for a broken file."""
    path = Path(folder) / _SURVEY
    if not path.exists():
        return None
    rows, _ = read_table(path, 5, "subject x y sx sy")
    return SurveyedLandmarks(rows[:, 0].astype(np.int64), rows[:, 1:3].copy())


def _odometry(path: Path, report: ReadReport) -> Velocities:
    if not path.exists():
        raise InputError(f"{path}: is missing; the robot's odometry is needed")
    rows, lines = read_table(path, 3, "time v w")
    backwards = np.flatnonzero(np.diff(rows[:, 0]) < 0.0)
    if len(backwards):
        raise InputError(f"{path}, line {lines[backwards[0] + 1]}: the time steps back; sort the lines by time")
    later = np.append(np.diff(rows[:, 0]) > 0.0, True)  # of readings at one time the last one counts
    report.skipped["odometry replaced by another of the same time"] += int(np.sum(~later))
    rows = rows[later]
    if len(rows) < 2:
        raise InputError(f"{path}: holds {len(rows)} readings; at least two are needed")
    return Velocities(*(column.copy() for column in rows.T))


def _sightings(folder: Path, robot: int, report: ReadReport) -> Sightings:
    path = folder / f"Robot{robot}_Measurement.dat"
    if not path.exists():
        raise InputError(f"{path}: is missing; without sightings there is nothing to map")
    rows, lines = read_table(path, 4, "time barcode range bearing")
    turned = np.flatnonzero(np.abs(rows[:, 3]) > 2.0 * np.pi)
    if len(turned):
        raise InputError(
            f"{path}, line {lines[turned[0]]}: a bearing of {rows[turned[0], 3]:g} rad is more than a whole turn; "
            "give radians"
        )
    identity = _identities(folder / _BARCODES, rows[:, 1])
    reasons = {
        "sighting of an unknown barcode": identity < 0,
        "sighting of the robot itself": identity == robot,
        "sighting with a range that is not positive": rows[:, 2] <= 0.0,
    }
    good = np.ones(len(rows), bool)
    for reason, bad in reasons.items():
        report.skipped[reason] += int(np.sum(bad & good))
        good &= ~bad
    if not good.any():
        raise InputError(
            f"{path}: none of {len(rows)} sightings is of a barcode in {_BARCODES}; give the files of one set"
        )
    order = np.flatnonzero(good)[np.argsort(rows[good, 0], kind="stable")]
    return Sightings(rows[order, 0].copy(), identity[order], rows[order, 2].copy(), wrap(rows[order, 3]))


def _identities(path: Path, barcodes: Array) -> Indices:
    """Subject of each barcode, -1 for unknown ones."""
    if not path.exists():
        raise InputError(f"{path}: is missing; it tells which landmark a barcode stands for")
    rows, lines = read_table(path, 2, "subject barcode")
    order = np.argsort(rows[:, 1], kind="stable")
    known = rows[order]
    twice = np.flatnonzero((np.diff(known[:, 1]) == 0.0) & (np.diff(known[:, 0]) != 0.0))
    if len(twice):
        line = lines[order[twice[0] + 1]]
        raise InputError(
            f"{path}, line {line}: barcode {known[twice[0], 1]:g} stands for two subjects "
            f"({known[twice[0], 0]:g} and {known[twice[0] + 1, 0]:g}); correct the file"
        )
    place = np.minimum(np.searchsorted(known[:, 1], barcodes), len(known) - 1)
    return np.where(known[place, 1] == barcodes, known[place, 0], -1).astype(np.int64)
