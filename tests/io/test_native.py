"""The native parsers against short twins in Python."""

from __future__ import annotations

import bz2
import math

import numpy as np
import pytest

from carmen_lines import DATA, flaser, odom, robotlaser
from clew import _native
from clew.io.graph_tags import RECORDS


def carmen_twin(text: str) -> tuple[list[list[float]], list[list[float]], list[float]]:
    """Scans (ipc time, laser pose, robot pose), odometry (time, pose, line) and ranges."""
    scans, odometry, ranges = [], [], []
    for number, line in enumerate(text.splitlines(), start=1):
        fields = line.split()
        if fields[:1] == ["ODOM"]:
            odometry.append([float(fields[7]), *map(float, fields[1:4]), float(number)])
        elif fields[:1] in (["FLASER"], ["ROBOTLASER1"]):
            begin = 1 if fields[0] == "FLASER" else 8
            end = begin + 1 + int(fields[begin])
            ranges += [float(field) for field in fields[begin + 1 : end]]
            poses = end if fields[0] == "FLASER" else end + 1 + int(fields[end])
            scans.append([float(fields[-3]), *map(float, fields[poses : poses + 6])])
    return scans, odometry, ranges


def check_carmen(text: str) -> None:
    records = _native.io.parse_carmen(text.encode())
    scans, odometry, ranges = carmen_twin(text)
    np.testing.assert_array_equal(records["scan_numbers"][:, [0, 2, 3, 4, 5, 6, 7]], scans)
    np.testing.assert_array_equal(records["odometry"][:, [0, 2, 3, 4, 5]], np.reshape(odometry, (-1, 5)))
    np.testing.assert_array_equal(records["ranges"], ranges)
    assert records["scan_integers"][:, 1].sum() == len(ranges)
    assert records["damaged"] == 0


def test_carmen_records_of_all_shapes() -> None:
    rng = np.random.default_rng(6)
    lines = []
    for t in range(300):
        values = [f"{v:.{rng.integers(0, 18)}f}" if rng.random() < 0.8 else f"{v:.9e}"
                  for v in rng.normal(0, 1, int(rng.integers(1, 30)))]
        pose = rng.normal(0, 1e3, 3).tolist()
        remissions = rng.random(int(rng.integers(0, 5))).tolist()
        lines.append(flaser(t, values, pose, pose[::-1]))
        lines.append(odom(t, pose))
        lines.append(robotlaser(t, values, remissions=remissions, laser=pose, robot=pose[::-1]))
    check_carmen("\r\n".join(lines))


def test_a_real_carmen_log() -> None:
    path = DATA / "lidar" / "mit-csail.clf.bz2"
    if not path.exists():
        pytest.skip(f"needs the real log {path}")
    check_carmen(bz2.decompress(path.read_bytes()).decode())


@pytest.mark.parametrize("name", ["graphs2d/city10000.g2o", "graphs3d/parking-garage.g2o",
                                  "graphs2d/FR079_P_toro.graph"])
def test_real_graphs(name: str) -> None:
    path = DATA / name
    if not path.exists():
        pytest.skip(f"needs the real graph {path}")
    text = path.read_text()
    tables = _native.io.parse_graph(text.encode(), RECORDS)["tables"]
    for tag, ids, _, _ in RECORDS:
        rows = [[number, *line.split()[1:]] for number, line in enumerate(text.splitlines(), start=1)
                if line.startswith(f"{tag} ")]
        assert (tag in tables) == bool(rows)
        if rows:
            np.testing.assert_array_equal(tables[tag][0], [[int(f) for f in row[: 1 + ids]] for row in rows])
            numbers = [[float(f) for f in row[1 + ids :]] for row in rows]
            np.testing.assert_array_equal(tables[tag][1], numbers)


def test_records_are_written_as_short_as_they_read_back() -> None:
    rng = np.random.default_rng(9)
    numbers = rng.normal(size=(500, 4)) * 10.0 ** rng.integers(-30, 30, (500, 4))
    numbers[0] = [0.1, -0.0, 1e22, -1.0 / 3]
    ids = rng.integers(-(2**62), 2**62, (500, 2))
    lines = _native.io.format_records("TAG", ids, numbers).decode().splitlines()
    assert lines[0].split()[3:] == ["0.1", "0", "1e+22", "-0.3333333333333333"]
    for line, row_ids, row in zip(lines, ids, numbers, strict=True):
        fields = line.split()
        assert [fields[0], *map(int, fields[1:3])] == ["TAG", *row_ids.tolist()]
        assert list(map(float, fields[3:])) == row.tolist()
        assert all(len(a) <= len(repr(b)) for a, b in zip(fields[3:], row.tolist(), strict=True))


def test_arguments_are_checked_at_the_door() -> None:
    with pytest.raises(ValueError, match="as many rows"):
        _native.io.format_records("T", np.zeros((1, 1), np.int64), np.zeros((2, 1)))
    with pytest.raises(ValueError, match="columns"):
        _native.io.parse_table(b"1 2", 0)
    with pytest.raises(ValueError, match="tag"):
        _native.io.parse_graph(b"", [("", 1, 1, False)])
    assert math.isnan(_native.io.parse_carmen(b"FLASER 1 NaN 0 0 0 0 0 0 1 h 1")["ranges"][0])
