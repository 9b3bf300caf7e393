"""Damaged files by the thousand: an answer or a `ClewError` of one line, never a crash or a hang."""

from __future__ import annotations

import bz2
import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from carmen_lines import flaser, odom, robotlaser
from clew.errors import ClewError
from clew.io import open_log, read_graph, read_relations, read_ros_map, read_tum, write_ros_map
from clew.scan import LaserScan

RNG = np.random.default_rng(11)
LOG = "\n".join(["# CARMEN", "PARAM robot_frontlaser_offset 0.1 host 0"] + [
    line for t in range(1, 9) for line in (
        odom(t - 0.5, (t, 0.1, 0.01)), flaser(float(t), np.round(RNG.uniform(0.5, 82, 20), 2).tolist()),
        robotlaser(t + 0.25, np.round(RNG.uniform(0.5, 82, 21), 2).tolist(), remissions=(1.0, 2.0)))]
).encode()
GRAPH = ("\n".join(
    [f"VERTEX_SE2 {i} {i}.25 -{i}e-1 0.{i}" for i in range(8)] + ["DATA_FEATURE_POINTXY 0 2 1 2 1 0 1"]
    + ["VERTEX_XY 20 1 2", "FIX 0"]
    + [f"EDGE_SE2 {i} {i + 1} 1 0 0.1 2 0.1 0 2 0 5" for i in range(7)]
    + ["EDGE_SE2_XY 3 20 1 2 1 0 1", "EDGE_BEARING_SE2_XY 1 20 0.5 9"]
    + [f"VERTEX_SE3:QUAT {i} 0 0 {i} 0 0 0.6 0.8" for i in (100, 101)]
    + ["EDGE_SE3:QUAT 100 101 0 0 1 0 0 0 1 " + " ".join(map(str, np.eye(6)[np.triu_indices(6)]))])).encode()
TABLE = b"".join(b"%d.5 0.1 0.2 0.3 0 0 0 1\n" % i for i in range(30))

#: Bytes that do more harm than random ones: ends of lines and fields, signs, letters of numbers.
NASTY = b"\n\r \t\0-+.eE09nNaAiIfF#,:\xff"
HOW = st.sampled_from(["set", "cut", "insert", "drop", "copy"])
DAMAGE = st.lists(st.tuples(st.floats(0, 1, exclude_max=True), HOW,
                            st.sampled_from(list(NASTY)) | st.integers(0, 255)), min_size=1, max_size=12)


def damaged(data: bytes, damage: list[tuple[float, str, int]]) -> bytes:
    out = bytearray(data)
    for where, how, byte in damage:
        if not out:
            break
        at = int(where * len(out))
        if how == "set":
            out[at] = byte
        elif how == "insert":
            out.insert(at, byte)
        elif how == "drop":
            del out[at : at + byte]
        elif how == "copy":
            out[at:at] = out[max(0, at - 4 * byte) : at]
        elif byte < 32:  # cutting off happens more rarely, or little would be left of every file
            del out[at:]
    return bytes(out)


def survives(path: Path, data: bytes, read: Callable[[Path], object]) -> bool:
    """Whether an answer came; an error must be ours and of one line."""
    path.write_bytes(data)
    try:
        read(path)
    except ClewError as error:
        message = str(error)
    else:
        return True
    assert "\n" not in message
    assert str(path.parent) in message
    return False


def whole_log(path: Path) -> None:
    log = open_log(path)
    measurements = list(log.measurements())
    times = np.array([m.timestamp for m in measurements])
    assert np.isfinite(times).all()
    assert np.all(np.diff(times) >= 0)
    scans = [m for m in measurements if isinstance(m, LaserScan)]
    assert len(scans) == log.scan_count > 0
    assert all(np.isfinite([s.angle_min, s.angle_increment, s.range_min]).all() for s in scans)
    assert all(len(s.ranges) for s in scans)
    assert all(np.isfinite(s.T_robot_sensor).all() for s in scans)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("damage")


def test_the_whole_files_are_read(folder: Path) -> None:
    assert survives(folder / "log", LOG, whole_log)
    assert survives(folder / "graph", GRAPH, read_graph)
    assert survives(folder / "table", TABLE, read_tum)


@settings(max_examples=400, deadline=None, derandomize=True)
@given(damage=DAMAGE)
def test_damaged_logs(folder: Path, damage: list[tuple[float, str, int]]) -> None:
    survives(folder / "log", damaged(LOG, damage), whole_log)


@pytest.mark.parametrize("pack", [gzip.compress, bz2.compress])
@settings(max_examples=150, deadline=None, derandomize=True)
@given(damage=DAMAGE)
def test_damaged_packed_logs(folder: Path, pack: Callable[[bytes], bytes],
                             damage: list[tuple[float, str, int]]) -> None:
    survives(folder / "log", damaged(pack(LOG), damage), whole_log)


@settings(max_examples=400, deadline=None, derandomize=True)
@given(damage=DAMAGE)
def test_damaged_graphs(folder: Path, damage: list[tuple[float, str, int]]) -> None:
    survives(folder / "graph", damaged(GRAPH, damage), read_graph)


@settings(max_examples=150, deadline=None, derandomize=True)
@given(damage=DAMAGE)
def test_damaged_tables(folder: Path, damage: list[tuple[float, str, int]]) -> None:
    survives(folder / "table", damaged(TABLE, damage), read_tum)
    survives(folder / "table", damaged(TABLE, damage), read_relations)


@settings(max_examples=100, deadline=None, derandomize=True)
@given(damage=DAMAGE, image=st.booleans())
def test_damaged_maps(folder: Path, damage: list[tuple[float, str, int]], image: bool) -> None:
    files = write_ros_map(folder / "map", np.eye(9), 0.05, np.zeros(2))
    broken = files[0] if image else files[1]
    broken.write_bytes(damaged(broken.read_bytes(), damage))
    survives(files[1], files[1].read_bytes(), read_ros_map)


@settings(max_examples=50, deadline=None, derandomize=True)
@given(data=st.binary(max_size=400))
def test_noise(folder: Path, data: bytes) -> None:
    for head in (b"", b"FLASER ", b"BZh9", b"\x1f\x8b\x08", b"VERTEX_SE2 ", b"#ROSBAG V2.0\n",
                 b"SQLite format 3\0", b"\x89MCAP0\r\n"):
        survives(folder / "noise", head + data, open_log)
        survives(folder / "noise", head + data, read_graph)
