"""What `clew info` says of each kind of file but graphs."""

from __future__ import annotations

import json
from collections.abc import Callable
from datetime import datetime, timezone
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from clew.cli.describe_graph import describe_graph
from clew.cli.description import Description, Table, count, metres, seconds
from clew.errors import InputError
from clew.geometry import so3
from clew.io import (
    UNNAMED,
    FileKind,
    StreamHealth,
    file_kind,
    list_topics,
    log_health,
    mrclam_robots,
    open_log,
    read_csv,
    read_feature_log,
    read_kitti,
    read_mrclam,
    read_relations,
    read_ros_map,
    read_survey,
    read_tum,
    stream_health,
)

Array = NDArray[np.float64]

_EPOCH = 1e8  # seconds; later times are those of a calendar
_PACKED = {b"BZh": "bzip2", b"\x1f\x8b": "gzip"}


def describe(path: Path) -> Description:
    """What the file or folder at `path` holds.

    Raises:
        InputError: it cannot be read, or is of no kind that clew knows.
    """
    kind = file_kind(path)
    makers: dict[FileKind, Callable[[Path, str], Description]] = {
        FileKind.CARMEN: describe_log, FileKind.ROS1_BAG: describe_bag, FileKind.ROS2_SQLITE: describe_bag,
        FileKind.ROS2_MCAP: describe_bag, FileKind.MRCLAM: describe_mrclam, FileKind.G2O: describe_graph,
        FileKind.TORO: describe_graph, FileKind.TUM: describe_trajectory, FileKind.KITTI: describe_kitti,
        FileKind.CSV: describe_trajectory, FileKind.RELATIONS: describe_relations, FileKind.ROS_MAP: describe_map,
        FileKind.OUTPUT: describe_output, FileKind.CIRCLES: describe_features,
    }  # fmt: skip
    if kind not in makers:
        raise InputError(f"{path}: is a picture; give the file that it was made from")
    about = makers[kind](path, kind.value + packing(path))
    about.data = {"path": str(path), "format": kind.name.lower(), "bytes": size_of(path), **about.data}
    about.lines.insert(0, ("size", _bytes(size_of(path))))
    return about


def packing(path: Path) -> str:
    """How a file is packed, as words behind its kind."""
    if path.is_dir():
        return ""
    with path.open("rb") as file:
        head = file.read(3)
    return next((f", {name}" for magic, name in _PACKED.items() if head.startswith(magic)), "")


def size_of(path: Path) -> int:
    """Bytes of a file, or of all files in a folder."""
    return sum(p.stat().st_size for p in path.rglob("*") if p.is_file()) if path.is_dir() else path.stat().st_size


def _bytes(size: int) -> str:
    for unit, scale in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size >= scale:
            return f"{size / scale:.1f} {unit}"
    return f"{size} bytes"


def _period(first: float, last: float) -> str:
    """When it was recorded, if the times are those of a calendar."""
    if first < _EPOCH:
        return f"{first:.3f} to {last:.3f} s"
    begin = datetime.fromtimestamp(first, timezone.utc)
    return f"{begin:%Y-%m-%d %H:%M:%S} UTC"


def _stream(stream: StreamHealth, noun: str) -> str:
    rate = f", {stream.rate:.3g} a second" if stream.rate else ""
    return count(stream.count, noun) + rate


def describe_log(path: Path, kind: str) -> Description:
    """Sensors, rates, duration, laser, and what is wrong with the log."""
    health = log_health(open_log(path))
    laser = health.laser
    beams = max(laser.beams, key=lambda number: laser.beams[number])
    reach = f"reach {laser.range_max:.4g} m, " if np.isfinite(laser.range_max) else ""
    about = Description(kind, data=health.to_dict(), problems=list(health.problems))
    about.lines = [
        ("duration", f"{seconds(health.duration)}, from {_period(health.scans.first, health.scans.last)}"),
        ("laser", _stream(health.scans, "scan")),
        ("", f"{beams} beams over {np.degrees(laser.field_of_view):.4g} degrees, "
             f"{np.degrees(laser.resolution):.3g} degrees apart"),
        ("", f"{reach}returns to {laser.longest:.4g} m (median {laser.median:.3g} m), "
             f"{100 * laser.no_return:.2g} % of the beams without"),
    ]  # fmt: skip
    x, y, turn = laser.T_robot_sensor.tolist()
    if x or y or turn:
        about.lines.append(("", f"{x:.3g} m ahead, {y:.3g} m left of the robot's centre, turned by "
                                f"{np.degrees(turn):.3g} degrees"))  # fmt: skip
    if health.odometry is not None:
        about.lines += [("odometry", _stream(health.odometry, "reading")), ("", f"way {metres(health.distance)}")]
    if health.gyro is not None:
        about.lines += [("gyro", _stream(health.gyro.stream, "reading")),
                        ("", f"at most {np.degrees(health.gyro.fastest):.3g} degrees a second, "
                             f"{np.degrees(health.gyro.quiet):+.2g} where it is quiet")]  # fmt: skip
    return about


def describe_bag(path: Path, kind: str) -> Description:
    """As `describe_log`, with the topics; a bag without scans has topics all the same."""
    topics = list_topics(path)
    try:
        about = describe_log(path, kind)
    except InputError as error:
        about = Description(kind, problems=[str(error)])
        about.data["problems"] = about.problems
    about.data["topics"] = [{"name": t.name, "type": t.type, "messages": t.messages} for t in topics]
    about.table = Table(("topic", "type", "messages"), [(t.name, t.type, f"{t.messages:,}") for t in topics])
    return about


def describe_mrclam(path: Path, kind: str) -> Description:
    """Odometry and sightings of each robot."""
    about = Description(kind)
    rows, robots = [], []
    for number in mrclam_robots(path):
        try:
            log = read_mrclam(path, number)
        except InputError as error:
            about.problems.append(str(error))
            continue
        odometry = stream_health("odometry", log.odometry.timestamp)
        span = odometry.last - odometry.first
        speed = float(np.sum(np.abs(log.odometry.speed[:-1]) * np.diff(log.odometry.timestamp)))
        rows.append((str(number), f"{span:,.1f}", f"{odometry.count:,}", f"{odometry.rate:.3g}", f"{speed:.0f}",
                     f"{len(log.landmarks):,}", f"{len(np.unique(log.landmarks.identity))}", f"{len(log.robots):,}",
                     "-" if log.truth is None else f"{len(log.truth):,}"))
        robots.append({"robot": number, "duration_s": span, "odometry": odometry.to_dict(), "distance_m": speed,
                       "landmark_sightings": len(log.landmarks), "robot_sightings": len(log.robots),
                       "truth": 0 if log.truth is None else len(log.truth), "skipped": dict(log.report.skipped)})
        about.problems += [f"robot {number}: left out: {many:,} x {reason}"
                           for reason, many in sorted(log.report.skipped.items())]
    survey = read_survey(path)
    about.lines = [("robots", str(len(rows)))]
    if survey is not None:
        about.lines.append(("landmarks", f"{len(survey.identity)} surveyed"))
    about.table = Table(("robot", "seconds", "odometry", "a second", "metres", "sightings", "landmarks", "of robots",
                         "truth"), rows)  # fmt: skip
    about.data = {"robots": robots, "landmarks": 0 if survey is None else len(survey.identity),
                  "problems": about.problems}
    return about


def describe_features(path: Path, kind: str) -> Description:
    """Steps and features of a drive, and how many of the features the file names."""
    log = read_feature_log(path)
    where, distances = log.features.keys, np.hypot(*log.features.measurement.T)
    named = np.empty(0, np.int64) if log.identity is None else log.identity[log.identity != UNNAMED]
    way, blind = float(np.hypot(*log.motion[:, :2].T).sum()), len(log.keys) - len(np.unique(where))
    turned = float(np.degrees(np.abs(log.motion[:, 2]).sum()))
    about = Description(kind)
    about.lines = [
        ("odometry", f"{count(len(log.motion), 'step')}, way {metres(way)}, turned by {turned:,.0f} degrees in all"),
        ("features", f"{len(where):,} seen, {len(where) / len(log.keys):.2g} a pose, none at {count(blind, 'pose')}; "
                     f"median {np.median(distances):.3g} m away, at most {distances.max():.3g} m"),
        ("identities", f"{len(named):,} features of {count(len(np.unique(named)), 'landmark')}, "
                       f"{len(where) - len(named):,} without"),
    ]  # fmt: skip
    about.problems += [f"left out: {many:,} x {reason}" for reason, many in sorted(log.report.skipped.items())]
    about.data = {"poses": len(log.keys), "distance_m": way, "features": len(where), "named": len(named),
                  "landmarks": len(np.unique(named)), "poses_without": blind, "problems": about.problems}
    return about


def describe_trajectory(path: Path, kind: str) -> Description:
    """Poses, duration, length, extent."""
    stamps, poses = (read_csv if kind.startswith(FileKind.CSV.value) else read_tum)(path)
    stream = stream_health("poses", stamps)
    about = _path(Description(kind), poses, _stream(stream, "pose"))
    about.lines.insert(1, ("duration", f"{seconds(stream.last - stream.first)}, from "
                                       f"{_period(stream.first, stream.last)}"))  # fmt: skip
    about.data |= {"duration_s": stream.last - stream.first, "rate_hz": stream.rate, "first": stream.first}
    if len(stream.steps_back):
        about.problems.append(f"the time steps back {len(stream.steps_back):,} times, first after "
                              f"{stream.steps_back[0, 0]:.3f} s")
    twice = len(stamps) - len(np.unique(stamps))
    if twice:
        about.problems.append(f"{count(twice, 'pose')} at a time that another pose has")
    if len(stream.gaps):
        about.problems.append(f"{count(len(stream.gaps), 'gap')}, at most {np.max(stream.gaps[:, 1]):.1f} s")
    about.data["problems"] = about.problems
    return about


def describe_kitti(path: Path, kind: str) -> Description:
    """Poses, length, extent; there are no times."""
    poses = read_kitti(path)
    return _path(Description(kind), poses, f"{count(len(poses), 'pose')}; the format has no times")


def _path(about: Description, poses: Array, first: str) -> Description:
    planar = np.ptp(poses[:, 2]) == 0 and bool(np.abs(poses[:, 3:5]).max() < 1e-6)
    steps = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1)
    extent = np.ptp(poses[:, :3], axis=0)[: 2 if planar else 3]
    turned = np.linalg.norm(so3.log(so3.between(poses[:-1, 3:], poses[1:, 3:])), axis=1).sum()
    about.lines = [("poses", f"{first}, {'in the plane' if planar else 'in space'}"),
                   ("way", f"{metres(float(steps.sum()))}, turned by {np.degrees(turned):,.0f} degrees in all"),
                   ("extent", " x ".join(metres(float(side)) for side in extent))]
    about.data |= {"poses": len(poses), "planar": planar, "distance_m": float(steps.sum()),
                   "extent_m": extent.tolist(), "problems": about.problems}
    return about


def describe_relations(path: Path, kind: str) -> Description:
    """How many, and over which times and distances."""
    relations = read_relations(path)
    apart = np.linalg.norm(relations.T_first_second[:, :3], axis=1)
    later = relations.second - relations.first
    first, last = float(relations.first.min()), float(relations.second.max())
    lines = [("relations", f"{len(apart):,} true poses of the robot at one time seen from another"),
             ("times", f"{seconds(last - first)}, from {_period(first, last)}"),
             ("apart", f"median {np.median(later):.3g} s and {np.median(apart):.3g} m, at most {later.max():.4g} s and "
                       f"{apart.max():.4g} m")]  # fmt: skip
    data: dict[str, object] = {"relations": len(apart), "first": first, "last": last, "problems": []}
    return Description(kind, lines, data=data)


def describe_map(path: Path, kind: str) -> Description:
    """Size, resolution, and what is known of it."""
    grid = read_ros_map(path)
    rows, columns = grid.occupancy.shape
    shares = {"free": np.mean(grid.occupancy == 0), "occupied": np.mean(grid.occupancy == 1),
              "unknown": np.mean(np.isnan(grid.occupancy))}
    x, y, yaw = grid.origin.tolist()
    free = float(np.sum(grid.occupancy == 0)) * grid.resolution**2
    lines = [("cells", f"{columns:,} x {rows:,}, {100 * grid.resolution:.3g} cm each: "
                       f"{metres(columns * grid.resolution)} x {metres(rows * grid.resolution)}"),
             ("origin", f"x {x:.3f} m, y {y:.3f} m, yaw {np.degrees(yaw):.3g} degrees"),
             ("known", ", ".join(f"{100 * share:.1f} % {name}" for name, share in shares.items())
              + f"; {free:,.0f} m^2 free")]  # fmt: skip
    data: dict[str, object] = {"columns": columns, "rows": rows, "resolution_m": grid.resolution,
                               "origin": grid.origin.tolist(), "problems": [],
                               "shares": {name: float(share) for name, share in shares.items()}}
    return Description(kind, lines, data=data)


def describe_output(path: Path, kind: str) -> Description:
    """The summary of a run and its files."""
    about = Description(kind)
    summary = path / "summary.json"
    if summary.exists():
        try:
            content = json.loads(summary.read_text(encoding="utf-8"))
            about.lines = [(str(name).replace("_", " "), _value(value)) for name, value in content.items()]
        except (ValueError, AttributeError, OSError) as error:
            raise InputError(f"{summary}: is no summary of clew ({error}); run the job again") from None
        about.data["summary"] = content
    else:
        about.problems.append("no summary.json: the job did not end, or was no run of a log")
    files = sorted(p for p in path.iterdir() if p.is_file())
    about.table = Table(("file", "size"), [(p.name, _bytes(p.stat().st_size)) for p in files])
    about.data |= {"files": [p.name for p in files], "problems": about.problems}
    return about


def _value(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {_value(inner)}" for name, inner in value.items()) or "nothing"
    if isinstance(value, list):
        return ", ".join(map(_value, value))
    return f"{value:,}" if isinstance(value, int) and not isinstance(value, bool) else str(value)
