"""What `clew convert` does: one file in, another out, and a word on what is lost."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from clew.cli.formats import ENDINGS, GRAPHS, LOGS, MAPS, TRAJECTORIES, Format, format_of
from clew.cli.progress import stages
from clew.errors import InputError
from clew.geometry import SE2, SE3
from clew.io import (
    FileKind,
    GraphFile,
    Log,
    file_kind,
    open_log,
    read_csv,
    read_graph,
    read_kitti,
    read_png_map,
    read_ros_map,
    read_tum,
    write_bag,
    write_carmen_log,
    write_csv,
    write_graph,
    write_kitti,
    write_png_map,
    write_ros_map,
    write_tum,
)

Array = NDArray[np.float64]

_STYLES = {Format.ROS1: "ros1", Format.SQLITE3: "sqlite3", Format.MCAP: "mcap"}
_MAKES_SENSE: dict[FileKind, tuple[Format, ...]] = {
    FileKind.CARMEN: LOGS, FileKind.ROS1_BAG: LOGS, FileKind.ROS2_SQLITE: LOGS, FileKind.ROS2_MCAP: LOGS,
    FileKind.G2O: GRAPHS + TRAJECTORIES, FileKind.TORO: GRAPHS + TRAJECTORIES, FileKind.TUM: TRAJECTORIES,
    FileKind.KITTI: TRAJECTORIES, FileKind.CSV: TRAJECTORIES, FileKind.ROS_MAP: MAPS, FileKind.PNG_MAP: MAPS,
}  # fmt: skip


@dataclass(frozen=True)
class Conversion:
    """What was done: source, target, their formats, how much, and what was lost or made up, a sentence each."""

    source: Path
    target: Path
    kind: str
    format: str
    content: str
    notes: tuple[str, ...]

    def sentence(self) -> str:
        """For people: one line, and one for each note."""
        head = f"{self.source} ({self.kind}) -> {self.target} ({self.format}): {self.content}"
        return "\n".join([head, *(f"! {note}" for note in self.notes)])

    def to_dict(self) -> dict[str, object]:
        """For programs."""
        return {"source": str(self.source), "target": str(self.target), "from": self.kind, "to": self.format,
                "content": self.content, "notes": list(self.notes)}


def convert_file(source: Path, target: Path, to: Format | None, scan_topic: str | None, odometry_topic: str | None,
                 console: Console, imu_topic: str | None = None) -> Conversion:
    """Read, write, and tell.

    Raises:
        InputError: a file that cannot be read or written, or a conversion that makes no sense.
    """
    kind = file_kind(source)
    formats = _MAKES_SENSE.get(kind)
    if formats is None:
        raise InputError(f"{source}: a file of the kind {kind.value!r} has no other format; give a graph, a "
                         "trajectory, a log or a map")
    wanted = format_of(target, _sensible(source, kind, formats, target)) if to is None else to
    if wanted not in formats:
        raise InputError(f"{source}: a {kind.value} cannot become {wanted.value}; choose "
                         f"{', '.join(f.value for f in formats)}")
    if target.resolve() == source.resolve():
        raise InputError(f"{target}: is the file to read; give another name to write")
    if not target.resolve().parent.is_dir():
        raise InputError(f"{target}: the folder {target.parent} does not exist; make it first")
    with stages(console) as shown:
        shown.begin("reading", note=source.name)
        if formats is LOGS:
            log = open_log(source, scan_topic=scan_topic, odometry_topic=odometry_topic, imu_topic=imu_topic,
                           order="recorded")
            shown.begin("writing", note=target.name)
            content, notes = _write_log(log, target, wanted)
        elif formats is MAPS:
            content, notes = _convert_map(source, kind, target, wanted)
        elif wanted in GRAPHS:
            content, notes = _convert_graph(read_graph(source), target, wanted)
        else:
            content, notes = _convert_poses(source, kind, target, wanted)
    return Conversion(source, target, kind.value, wanted.value, content, tuple(notes))


def _sensible(source: Path, kind: FileKind, formats: tuple[Format, ...], target: Path) -> tuple[Format, ...]:
    """Formats for the ending to choose from; an ending of another family gets an error that says what is wrong."""
    asked = ENDINGS.get(target.suffix.lower())
    if asked is not None and asked not in formats:
        raise InputError(f"{source}: a {kind.value} cannot become {asked.value}; choose "
                         f"{', '.join(f.value for f in formats)}")
    return formats


def _write_log(log: Log, target: Path, wanted: Format) -> tuple[str, list[str]]:
    notes = [f"left out: {count:,} x {reason}" for reason, count in sorted(log.report.skipped.items())]
    if wanted is Format.CARMEN:
        write_carmen_log(target, log)
        notes.append("rounded: times to microseconds, ranges to 32-bit floats; lost: the shortest range of the laser, "
                     "records that are neither scan nor odometry")
        if log.has_gyro:
            notes.append(f"lost: {log.report.used['gyro']:,} turn rates of the gyro, for which the format has none")
    else:
        write_bag(target, log, _STYLES[wanted])
        notes.append("rounded: ranges to 32-bit floats; lost: records that are neither scan nor odometry"
                     + (" nor turn rate" if log.has_gyro else ""))
    gyro = f", {log.report.used['gyro']:,} turn rates" if log.has_gyro else ""
    return f"{log.scan_count:,} scans, {log.report.used['odometry']:,} odometry readings{gyro}", notes


def _convert_map(source: Path, kind: FileKind, target: Path, wanted: Format) -> tuple[str, list[str]]:
    grid = read_png_map(source) if kind is FileKind.PNG_MAP else read_ros_map(source)
    if wanted is Format.PNG:
        write_png_map(target, grid)
    else:
        write_ros_map(target, grid.occupancy, grid.resolution, grid.origin)
    rows, columns = grid.occupancy.shape
    return f"{columns:,} x {rows:,} cells", ["lost: grey values between free, occupied and unknown"]


def _convert_graph(file: GraphFile, target: Path, wanted: Format) -> tuple[str, list[str]]:
    notes = []
    if len(file.report.reduced):
        notes.append(f"changed: {len(file.report.reduced):,} indefinite information matrices are written as they are "
                     "used, by their diagonal blocks")
    if len(file.report.created):
        notes.append(f"made up: {len(file.report.created):,} vertices that the file only mentions are written at the "
                     "identity")
    toro = wanted is Format.TORO
    if toro and file.features is not None:
        notes.append(f"lost: {len(file.features.keys):,} sightings without association")
    if file.report.unknown:
        notes.append(f"{'lost' if toro else 'kept as they are'}: {len(file.report.unknown):,} lines that clew does not "
                     "understand")
    write_graph(target, file.graph, style=wanted.value, features=None if toro else file.features,
                unknown=() if toro else file.report.unknown)
    return f"{len(file.graph):,} variables, {file.graph.factor_count:,} edges", notes


def _convert_poses(source: Path, kind: FileKind, target: Path, wanted: Format) -> tuple[str, list[str]]:
    notes = []
    if kind in (FileKind.G2O, FileKind.TORO):
        stamps, poses = poses_of_graph(read_graph(source))
        notes.append("lost: edges and landmarks" + ("" if wanted is Format.KITTI else "; ids stand for the times"))
    elif kind is FileKind.KITTI:
        poses = read_kitti(source)
        stamps = np.arange(len(poses), dtype=np.float64)
        if wanted is not Format.KITTI:
            notes.append("made up: times; they count the poses from 0")
    else:
        stamps, poses = (read_csv if kind is FileKind.CSV else read_tum)(source)
    if wanted is Format.KITTI:
        write_kitti(target, poses)
        if kind in (FileKind.TUM, FileKind.CSV):
            notes.append("lost: times")
    else:
        (write_csv if wanted is Format.CSV else write_tum)(target, stamps, poses)
    return f"{len(poses):,} poses", notes


def poses_of_graph(file: GraphFile) -> tuple[Array, Array]:
    """Ids as times ``(N,)`` and poses of a graph in the order of their ids.

    Raises:
        InputError: the graph has no poses, or poses of two kinds, or no values.
    """
    poses = [variables for variables in file.graph.variables() if variables.kind in (SE2, SE3)]
    if len(poses) != 1 or not file.has_values:
        what = "gives no values of its poses; optimise it first" if poses else "has no poses"
        raise InputError(f"{file.path}: {what if len(poses) < 2 else 'has poses in the plane and in space'}")
    order = np.argsort(poses[0].keys)
    return poses[0].keys[order].astype(np.float64), poses[0].values[order]
