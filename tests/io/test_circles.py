"""The DLR circles: what is read, in which frame, and what is said about broken files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from clew.errors import InputError
from clew.geometry import se2
from clew.io import is_feature_log, open_log, read_feature_log

DATA = Path(__file__).parents[2].parent / "shared" / "data" / "landmarks"
STEP = "STEP image.0001 0.1 -0.5 0.2 0.0004 0.00001 0.0009 0.0 0.0 0.0001\n"
MARK = "LANDMARK_C 0.3 -2.0 0.9 0.01 0.001 0.04 7\n"


def write(folder: Path, text: str) -> Path:
    path = folder / "log.circles"
    path.write_text("# header\n \n" + text)
    return path


def test_the_robot_looks_along_x_and_has_y_to_its_left(tmp_path: Path) -> None:
    path = write(tmp_path, STEP + MARK + STEP + "LANDMARK_C 1 -1 0.5 0.01 0 0.01 -1\nREMARK x\n")
    assert is_feature_log(path)
    log = read_feature_log(path)
    np.testing.assert_array_equal(log.keys, [0, 1, 2])
    np.testing.assert_allclose(log.motion[0], [0.5, -0.1, -0.2])  # forward, to the right, clockwise
    np.testing.assert_array_equal(log.features.keys, [1, 2])
    np.testing.assert_allclose(log.features.measurement[0], [2.0, -0.3])
    np.testing.assert_allclose(np.linalg.inv(log.features.information[0]), [[0.04, 0.001], [0.001, 0.01]])
    assert log.identity is not None
    assert log.identity.tolist() == [7, -1]
    assert log.report.skipped == {"line of the unknown kind REMARK": 1}


def test_the_covariance_of_a_step_is_turned_to_its_end(tmp_path: Path) -> None:
    log = read_feature_log(write(tmp_path, STEP + MARK))
    before = np.array([[0.0009, 0.00001, 0.0], [0.00001, 0.0004, 0.0], [0.0, 0.0, 0.0001]])
    # by sampling: errors that are added in the frame before the step, seen in the tangent at its end
    error = np.random.default_rng(0).multivariate_normal(np.zeros(3), before, 200_000)
    tangent = se2.local(np.broadcast_to(log.motion[0], error.shape), log.motion[0] + error)
    np.testing.assert_allclose(np.linalg.inv(log.information[0]), np.cov(tangent.T), atol=1.5e-5)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (STEP, "1 steps and 0 landmarks"),
        (STEP + MARK + "STEP image 0.1\n", "line 5: 9 finite numbers"),
        (STEP + "LANDMARK_C 0.3 nan 0.9 0.01 0.001 0.04 7\n", "line 4: 6 finite numbers"),
        (STEP + "LANDMARK_C 0.3 2.0 0.9 0.01 0.001 0.04\n", "line 4: no identity"),
        (STEP + "LANDMARK_C 0.3 2.0 0.9 0.01 0.5 0.04 7\n", "line 4: the covariance is not positive definite"),
        (STEP.replace("0.0004", "-0.0004") + MARK, "step 1 is not positive definite"),
    ],
)
def test_broken_files(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_feature_log(write(tmp_path, text))


def test_other_files_are_no_feature_logs(tmp_path: Path) -> None:
    path = tmp_path / "a.g2o"
    path.write_text("VERTEX_SE2 0 0 0 0\nVERTEX_SE2 1 1 0 0\nEDGE_SE2 0 1 1 0 0 1 0 0 1 0 1\n")
    assert not is_feature_log(path)
    with pytest.raises(InputError, match="holds no features"):
        read_feature_log(path)
    path.write_text("VERTEX_SE2 0 0 0 0\nDATA_FEATURE_POINTXY 0 0 1 1 4 0 4\nVERTEX_SE2 1 1 0 0\n")
    assert is_feature_log(path)
    with pytest.raises(InputError, match="pose 1 has no relative pose"):
        read_feature_log(path)
    with pytest.raises(InputError):
        open_log(write(tmp_path, STEP + MARK))


def test_the_real_file() -> None:
    path = DATA / "dlr.circles"
    if not path.exists():
        pytest.skip(f"needs {path}")
    log = read_feature_log(path)
    assert len(log.motion) == 3297
    assert len(log.features.keys) == 14_745
    assert log.identity is not None
    assert len(np.unique(log.identity[log.identity >= 0])) == 576
