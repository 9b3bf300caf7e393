"""TUM, KITTI and relations files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from carmen_lines import DATA
from clew import _native
from clew.errors import InputError
from clew.io import Relations, read_relations, read_tum, write_kitti, write_relations, write_tum

RNG = np.random.default_rng(5)


def spatial(n: int) -> np.ndarray:
    quaternions = Rotation.random(n, rng=np.random.default_rng(n)).as_quat(canonical=True)
    return np.column_stack([RNG.normal(0, 100, (n, 3)), quaternions])


def test_tum_round_trip(tmp_path: Path) -> None:
    path, poses = tmp_path / "t.tum", spatial(200)
    times = 976052857.337 + np.cumsum(RNG.random(200))
    write_tum(path, times, poses)
    read_times, read_poses = read_tum(path)
    np.testing.assert_array_equal(read_times, times)
    np.testing.assert_allclose(read_poses, poses, atol=1e-9)


def test_planar_poses_and_the_text_itself(tmp_path: Path) -> None:
    path = tmp_path / "t.tum"
    write_tum(path, np.array([1.5]), np.array([[1.0, -2.0, np.pi / 2]]))
    assert path.read_text() == ("# timestamp x y z qx qy qz qw\n"
                                "1.500000 1.000000000 -2.000000000 0.000000000 "
                                "0.000000000000 0.000000000000 0.707106781187 0.707106781187\n")
    write_tum(path, np.array([1.5]), np.array([[0.0, 0.0, -3.0]]))
    turned = read_tum(path)[1][0, 3:]
    np.testing.assert_allclose(Rotation.from_quat(turned).as_rotvec(), [0, 0, -3.0], atol=1e-11)


def test_real_reference() -> None:
    path = DATA / "lidar" / "intel.reference.tum"
    if not path.exists():
        pytest.skip(f"needs the real trajectory {path}")
    times, poses = read_tum(path)
    assert times[0] == 976053557.767368
    np.testing.assert_allclose(poses[0], [4.775, -5.841, 0, 0, 0, 0.746752572, -0.665101944] * np.array(
        [1, 1, 1, 1, 1, -1, -1]), atol=1e-9)
    assert len(times) == sum(line[0] != "#" for line in path.read_text().splitlines())


@pytest.mark.parametrize(("text", "says"), [
    ("1 2 3\n", "line 1: 8 finite numbers .* found 3"),
    ("# c\n\n1 0 0 0 0 0 0 1\n1 0 0 0 0 0 x 1\n", "line 4"),
    ("1 0 0 0 0 0 0 1 9\n", "line 1"), ("1 0 0 0 0 0 0 nan\n", "line 1"),
    ("1 0 0 0 0 0 0 2\n", "line 1: .*length 2"), ("1 0 0 0 0 0 0 0\n", "length 0"),
    ("# only\n", "no line"), ("", "empty"),
    ("1 0 0 0 0 0 0 1 text\n", "text behind"),
])
def test_broken_tum_files_name_the_line(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "t.tum"
    path.write_text(text)
    with pytest.raises(InputError, match=says):
        read_tum(path)


def test_wrong_arrays(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="shape"):
        write_tum(tmp_path / "t", np.zeros(2), np.zeros((2, 4)))
    with pytest.raises(InputError, match="timestamps"):
        write_tum(tmp_path / "t", np.zeros(3), np.zeros((2, 3)))
    with pytest.raises(InputError, match="pose 1 is not finite"):
        write_tum(tmp_path / "t", np.zeros(2), np.array([[0, 0, 0], [0, np.nan, 0]]))
    assert not (tmp_path / "t").exists()


def test_kitti_is_the_matrix(tmp_path: Path) -> None:
    poses = spatial(20)
    write_kitti(tmp_path / "k", poses)
    rows = np.loadtxt(tmp_path / "k").reshape(-1, 3, 4)
    np.testing.assert_allclose(rows[:, :, :3], Rotation.from_quat(poses[:, 3:]).as_matrix(), atol=1e-11)
    np.testing.assert_allclose(rows[:, :, 3], poses[:, :3], rtol=1e-11)


def test_relations_round_trip_and_their_angles(tmp_path: Path) -> None:
    poses = spatial(50)
    times = np.sort(RNG.random((2, 50)) * 1e6, axis=0)
    write_relations(tmp_path / "r", Relations(times[0], times[1], poses))
    table = np.loadtxt(tmp_path / "r")
    np.testing.assert_allclose(Rotation.from_euler("xyz", table[:, 5:]).as_matrix(),
                               Rotation.from_quat(poses[:, 3:]).as_matrix(), atol=1e-9)
    relations = read_relations(tmp_path / "r")
    np.testing.assert_allclose(relations.first, times[0], atol=1e-8)
    np.testing.assert_allclose(relations.second, times[1], atol=1e-8)
    np.testing.assert_allclose(relations.T_first_second, poses, atol=1e-8)


@settings(max_examples=200, deadline=None)
@given(number=st.floats(allow_nan=False, allow_infinity=False),
       style=st.sampled_from(["%r", "%.6f", "%.12g", "%.20f", "%.17e", "%.3f", "+%r", "%.0f"]))
def test_numbers_are_read_exactly(number: float, style: str) -> None:
    text = (style % abs(number) if style[0] == "+" else style % number)
    values, _, bad, _ = _native.io.parse_table(text.encode(), 1)
    assert not bad
    assert values[0, 0] == float(text)
