"""UTIAS MRCLAM folders: what is read, what is skipped, and what is said about broken ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from clew.errors import InputError
from clew.io import is_mrclam, mrclam_robots, read_mrclam, read_survey


def write(folder: Path, **changes: str | None) -> Path:
    files: dict[str, str | None] = {
        "Barcodes.dat": "# Subject Barcode\n 1 5\n 2 14\n 6 72\n 7 27\n",
        "Landmark_Groundtruth.dat": "6 1.0 2.0 0.001 0.001\n7 3.0 4.0 0.001 0.001\n",
        "Robot1_Odometry.dat": "0.0 0.1 0.0\n1.0 0.1 0.2\n1.0 0.1 0.3\n2.0 0.0 0.0\n",
        "Robot1_Measurement.dat": "0.5 72 1.5 0.1\n0.2 27 2.5 -0.1\n0.6 14 3.0 0.0\n0.7 99 1.0 0.0\n0.8 5 1.0 0.0\n"
        "0.9 27 -1.0 0.0\n9.0 27 1.0 0.0\n",
    }
    for name, text in {**files, **{key.replace("__", "."): value for key, value in changes.items()}}.items():
        if text is not None:
            (folder / name).write_text(text)
    return folder


def test_what_is_used_and_what_is_skipped(tmp_path: Path) -> None:
    log = read_mrclam(write(tmp_path), 1)
    assert is_mrclam(tmp_path)
    assert mrclam_robots(tmp_path) == (1,)
    assert log.odometry.turn_rate.tolist() == [0.0, 0.3, 0.0]  # of two readings at one time the later one
    assert log.landmarks.identity.tolist() == [7, 6]
    assert log.landmarks.range.tolist() == [2.5, 1.5]
    assert log.robots.identity.tolist() == [2]  # a robot although it has no files here
    assert log.truth is None
    assert log.report.skipped == {
        "sighting of an unknown barcode": 1, "sighting of the robot itself": 1,
        "sighting with a range that is not positive": 1, "sighting at a time without odometry": 1,
        "odometry replaced by another of the same time": 1,
    }  # fmt: skip
    survey = read_survey(tmp_path)
    assert survey is not None
    np.testing.assert_array_equal(survey.position, [[1.0, 2.0], [3.0, 4.0]])


@pytest.mark.parametrize(
    ("changes", "robot", "words"),
    [
        ({}, 3, "no robot 3; its robots are 1"),
        ({"Robot1_Measurement__dat": None}, 1, "Measurement.dat: is missing"),
        ({"Robot1_Odometry__dat": None}, 1, "Odometry.dat: is missing"),
        ({"Barcodes__dat": None}, 1, "Barcodes.dat: is missing"),
        ({"Robot1_Measurement__dat": "# none\n"}, 1, "holds no line"),
        ({"Robot1_Measurement__dat": "0.5 99 1 0\n"}, 1, "none of 1 sightings"),
        ({"Robot1_Measurement__dat": "0.5 14 1 0\n"}, 1, "no sighting of a landmark"),
        ({"Robot1_Measurement__dat": "0.5 14 1\n"}, 1, "line 1: 4 finite numbers"),
        ({"Robot1_Measurement__dat": "0.5 72 1 0.1\n0.6 72 1 24.0\n"}, 1, "line 2: a bearing of 24 rad"),
        ({"Robot1_Odometry__dat": "1.0 0 0\n0.0 0 0\n"}, 1, "line 2: the time steps back"),
        ({"Barcodes__dat": "6 72\n7 72\n"}, 1, "line 2: barcode 72 stands for two subjects"),
    ],
)
def test_broken_folders_are_named(tmp_path: Path, changes: dict[str, str | None], robot: int, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_mrclam(write(tmp_path, **changes), robot)


def test_a_folder_of_something_else(tmp_path: Path) -> None:
    assert not is_mrclam(tmp_path)
    with pytest.raises(InputError, match="MRCLAM"):
        read_mrclam(tmp_path, 1)


def test_bearings_counted_from_zero_to_a_whole_turn_are_the_same(tmp_path: Path) -> None:
    (tmp_path / "turn").mkdir()
    signed = "0.5 72 1.5 0.1\n0.2 27 2.5 -0.1\n"
    whole = f"0.5 72 1.5 0.1\n0.2 27 2.5 {2 * np.pi - 0.1:.12f}\n"
    one = read_mrclam(write(tmp_path, Robot1_Measurement__dat=signed), 1)
    other = read_mrclam(write(tmp_path / "turn", Robot1_Measurement__dat=whole), 1)
    np.testing.assert_allclose(other.landmarks.bearing, one.landmarks.bearing, atol=1e-9)
