"""ROS maps: what map_server makes of the files."""

from __future__ import annotations

from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from clew.errors import InputError
from clew.io import read_ros_map, write_ros_map

OCCUPANCY = np.array([[0.9, 0.1, np.nan], [0.5, 0.0, 1.0]])  # row 0 is the lowest y


def test_the_files_themselves(tmp_path: Path) -> None:
    image, description = write_ros_map(tmp_path, OCCUPANCY, 0.05, np.array([-1.0, 2.5]))
    assert image == tmp_path / "map.pgm"
    assert image.read_bytes() == b"P5\n3 2\n255\n" + bytes([205, 254, 0, 0, 254, 205])
    assert description.read_text().splitlines() == [
        "image: map.pgm", "resolution: 0.05", "origin: [-1.0, 2.5, 0.0]", "negate: 0",
        "occupied_thresh: 0.65", "free_thresh: 0.196"]
    pixels = matplotlib.image.imread(image)
    assert pixels.shape[:2] == (2, 3)


def test_round_trip_by_stem(tmp_path: Path) -> None:
    stem = tmp_path / "deep" / "floor.pgm"
    image, description = write_ros_map(stem, OCCUPANCY, 0.1, np.array([1.0, 2.0, 0.5]))
    assert (image.name, description.name) == ("floor.pgm", "floor.yaml")
    read = read_ros_map(description)
    np.testing.assert_array_equal(read.occupancy, [[1, 0, np.nan], [np.nan, 0, 1]])
    np.testing.assert_array_equal(read.origin, [1.0, 2.0, 0.5])
    assert read.resolution == 0.1


def test_grey_values_are_written_as_they_are(tmp_path: Path) -> None:
    image, _ = write_ros_map(tmp_path, np.array([[1, 2], [3, 4]], dtype=np.uint8), 1.0, np.zeros(2))
    assert image.read_bytes()[-4:] == bytes([3, 4, 1, 2])


def test_other_writers_files(tmp_path: Path) -> None:
    (tmp_path / "a.pgm").write_bytes(b"P2 # made by hand\n# more\n2 2\n100\n0 100\n 50 100\n")
    (tmp_path / "m.yaml").write_text(
        "# a map\nimage: 'a.pgm'\nresolution: 5e-2 # m\norigin: [0,0, 0.0]\nnegate: 1\n")
    np.testing.assert_array_equal(read_ros_map(tmp_path / "m.yaml").occupancy, [[np.nan, 1], [0, 1]])


@pytest.mark.parametrize(("yaml", "pgm", "says"), [
    ("", b"P5 1 1 255\n0", "empty"), ("image: a.pgm\n", b"P5 1 1 255\n0", "resolution"),
    ("image: a.pgm\nresolution: 1\norigin: [0, 0]\n", b"P5 1 1 255\n0", "origin"),
    ("image: a.pgm\nresolution: x\norigin: [0, 0, 0]\n", b"P5 1 1 255\n0", "not a number"),
    ("image: a.pgm\nresolution: 1\norigin: [0, 0, 0]\n", b"P6 1 1 255\n0", "no PGM"),
    ("image: a.pgm\nresolution: 1\norigin: [0, 0, 0]\n", b"P5 2 2 255\n000", "after 3 of 4"),
    ("image: b.pgm\nresolution: 1\norigin: [0, 0, 0]\n", b"P5 2 2 255\n000", "no such file"),
])
def test_broken_maps(tmp_path: Path, yaml: str, pgm: bytes, says: str) -> None:
    (tmp_path / "m.yaml").write_text(yaml)
    (tmp_path / "a.pgm").write_bytes(pgm)
    with pytest.raises(InputError, match=says):
        read_ros_map(tmp_path / "m.yaml")


def test_wrong_arguments(tmp_path: Path) -> None:
    for grid, resolution, origin in ((np.zeros(3), 1.0, np.zeros(2)), (np.zeros((1, 1)), 0.0, np.zeros(2)),
                                     (np.zeros((1, 1)), 1.0, np.full(3, np.nan))):
        with pytest.raises(InputError):
            write_ros_map(tmp_path, grid, resolution, origin)
    assert not list(tmp_path.iterdir())
