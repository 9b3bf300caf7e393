"""Tags in rendered images: identities, poses in the robot's frame with honest covariance, missing and old OpenCV."""

from __future__ import annotations

import importlib.util
import sys
import types
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from clew.errors import InputError, MissingDependencyError
from clew.geometry import se3, so3
from clew.scan.tags import Camera, find_tags

Array = NDArray[np.float64]

SIZE = 0.2
#: Looks ahead from 0.3 m in front of and 0.5 m above the robot's centre, 10 degrees to the left.
LOOKING_AHEAD = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
yaw = np.radians(10.0)
TURNED = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]]) @ LOOKING_AHEAD


def quaternion(matrix: Array) -> Array:
    from scipy.spatial.transform import Rotation

    return np.asarray(so3.canonical(Rotation.from_matrix(matrix).as_quat()))


CAMERA = Camera(np.array([[700.0, 0, 330], [0, 705, 236], [0, 0, 1]]), np.zeros(0),
                np.concatenate([[0.3, 0.0, 0.5], quaternion(TURNED)]))


@pytest.fixture(scope="module")
def cv2() -> Any:
    return pytest.importorskip("cv2", reason="needs opencv-python-headless (clew[camera])")


def render(cv2: Any, T_camera_tag: Array, number: int, dictionary: str, rng: np.random.Generator | None = None) -> Any:
    """Image ``(480, 640)`` of one tag on a grey wall, four times finer inside, with a white margin about it."""
    cells, fine = 10, 4  # 8 x 8 cells with the border of apriltag-36h11, 6 x 6 for aruco-4x4
    inner = 8 if "APRILTAG" in dictionary else 6
    marker = cv2.aruco.generateImageMarker(
        cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary)), number, inner * cells)
    board = np.pad(marker, cells, constant_values=255)
    pixel = SIZE / (inner * cells)
    # Board pixel (column, row) to metres on the tag, x right, y up.
    middle = (len(board) - 1) / 2
    to_tag = np.array([[pixel, 0, -middle * pixel], [0, -pixel, middle * pixel], [0, 0, 1]])
    rotation = so3.matrix(T_camera_tag[3:])
    plane = np.column_stack([rotation[:, 0], rotation[:, 1], T_camera_tag[:3]])
    to_fine = np.array([[fine, 0, (fine - 1) / 2], [0, fine, (fine - 1) / 2], [0, 0, 1]])
    size = (640 * fine, 480 * fine)
    image = np.full(size[::-1], 150, dtype=np.uint8)
    cv2.warpPerspective(board, to_fine @ CAMERA.matrix @ plane @ to_tag, size, dst=image, flags=cv2.INTER_LINEAR,
                        borderMode=cv2.BORDER_TRANSPARENT)
    image = cv2.resize(image, (640, 480), interpolation=cv2.INTER_AREA)
    image = cv2.GaussianBlur(image, (0, 0), 0.7)
    if rng is not None:
        image = np.clip(image + 4.0 * rng.standard_normal(image.shape), 0, 255).astype(np.uint8)
    return image


def facing(x: float, y: float, z: float, tilt: tuple[float, float, float]) -> Array:
    """Pose of a tag in the camera's frame: upright, towards the camera, then tilted by a rotation vector."""
    towards = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])
    return np.concatenate([[x, y, z], quaternion(towards @ so3.matrix(so3.exp(np.array(tilt))))])


@pytest.mark.parametrize(("family", "dictionary"),
                         [("apriltag-36h11", "DICT_APRILTAG_36h11"), ("aruco-4x4", "DICT_4X4_1000")])
def test_identity_and_pose(cv2: Any, family: str, dictionary: str) -> None:
    for number, pose in ((17, facing(0.1, -0.05, 1.2, (0.3, 0.5, 0.2))), (3, facing(-0.4, 0.2, 2.0, (0.6, -0.4, 1.0)))):
        tags = find_tags(render(cv2, pose, number, dictionary), CAMERA, SIZE, family=family)
        assert tags.identities.tolist() == [number]
        error = se3.local(se3.compose(CAMERA.T_robot_camera, pose), tags.T_robot_tag[0])
        assert np.linalg.norm(error[:3]) < 0.01 * pose[2]
        assert np.linalg.norm(error[3:]) < np.radians(2.0)
        # Independent of the pose maths: a robot sees the tag where the camera's mounting says.
        x, y = (so3.matrix(CAMERA.T_robot_camera[3:]) @ pose[:3] + CAMERA.T_robot_camera[:3])[:2]
        distance, bearing, _ = tags.range_bearing()
        assert distance[0] == pytest.approx(np.hypot(x, y), abs=0.01 * pose[2])
        assert bearing[0] == pytest.approx(np.arctan2(y, x), abs=0.003)


def test_covariance_is_that_of_the_errors(cv2: Any) -> None:
    rng = np.random.default_rng(1)
    nees, polar = [], []
    for _ in range(60):
        pose = facing(*rng.uniform((-0.4, -0.3, 1.0), (0.4, 0.3, 2.2)), tuple(rng.uniform(-0.6, 0.6, 3)))
        tags = find_tags(render(cv2, pose, 5, "DICT_APRILTAG_36h11", rng), CAMERA, SIZE)
        if len(tags) == 0 or tags.ambiguity[0] > 0.7:
            continue
        true = se3.compose(CAMERA.T_robot_camera, pose)
        error = se3.local(tags.T_robot_tag[0], true)
        nees.append(error @ np.linalg.solve(tags.covariances[0], error))
        distance, bearing, covariance = tags.range_bearing()
        off = np.array([distance[0] - np.hypot(true[0], true[1]), bearing[0] - np.arctan2(true[1], true[0])])
        polar.append(off @ np.linalg.solve(covariance[0], off))
    assert len(nees) > 40
    # Corners come out some 0.15 pixels too far inside and scatter as much; the 0.3 told is a little cautious.
    assert 1.5 < np.mean(nees) < 7.5
    assert 0.6 < np.mean(polar) < 2.6


def test_several_tags_in_order_of_identity(cv2: Any) -> None:
    left = render(cv2, facing(-0.3, 0, 1.5, (0.4, 0, 0)), 40, "DICT_APRILTAG_36h11")
    right = render(cv2, facing(0.3, 0, 1.5, (0.4, 0, 0)), 8, "DICT_APRILTAG_36h11")
    image = np.where(np.arange(640) < 320, left, right).astype(np.uint8)
    tags = find_tags(image, CAMERA, SIZE)
    assert tags.identities.tolist() == [8, 40]
    assert tags.covariances.shape == (2, 6, 6)
    assert (np.linalg.eigvalsh(tags.covariances) > 0).all()
    assert tags.T_robot_tag[0, 1] < tags.T_robot_tag[1, 1]  # 8 stands to the right


def test_no_tag_and_the_wrong_family(cv2: Any) -> None:
    empty = find_tags(np.full((480, 640), 150, dtype=np.uint8), CAMERA, SIZE)
    assert len(empty) == 0
    assert empty.T_robot_tag.shape == (0, 7)
    assert [len(column) for column in empty.range_bearing()] == [0, 0, 0]
    image = render(cv2, facing(0, 0, 1.2, (0.2, 0.2, 0)), 5, "DICT_APRILTAG_36h11")
    assert len(find_tags(image, CAMERA, SIZE, family="aruco-4x4")) == 0


def test_a_nearer_tag_is_known_better(cv2: Any) -> None:
    near, far = (
        find_tags(render(cv2, facing(0, 0, z, (0.5, 0.3, 0)), 5, "DICT_APRILTAG_36h11"), CAMERA, SIZE)
        for z in (1.0, 3.0)
    )
    assert 20 * near.range_bearing()[2][0, 0, 0] < far.range_bearing()[2][0, 0, 0]


def test_a_far_tag_seen_head_on_is_ambiguous(cv2: Any) -> None:
    rng = np.random.default_rng(3)
    clear, doubtful = (
        np.array([find_tags(render(cv2, facing(0, 0, z, (0.0, tilt, 0)), 5, "DICT_APRILTAG_36h11", rng), CAMERA,
                            SIZE).ambiguity[0] for _ in range(5)])
        for z, tilt in ((1.0, 0.8), (3.0, 0.15))
    )  # fmt: skip
    assert clear.max() < 0.3
    assert doubtful.max() > 0.5


def test_bad_requests(cv2: Any) -> None:
    image = np.zeros((48, 64), dtype=np.uint8)
    with pytest.raises(InputError, match="tag family 'qr'"):
        find_tags(image, CAMERA, SIZE, family="qr")
    with pytest.raises(InputError, match="must be positive"):
        find_tags(image, CAMERA, 0.0)
    with pytest.raises(InputError, match="uint8"):
        find_tags(image.astype(float), CAMERA, SIZE)  # type: ignore[arg-type] # what is refused
    with pytest.raises(InputError, match="mounting"):
        Camera(np.eye(3), np.zeros(0), np.zeros(3))


def test_missing_and_incompatible_are_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    image = np.zeros((48, 64), dtype=np.uint8)
    with monkeypatch.context() as patch:
        patch.setattr(importlib.util, "find_spec", lambda name: None)
        with pytest.raises(MissingDependencyError, match=r"is missing; install it with: pip install 'clew\[camera\]'"):
            find_tags(image, CAMERA, SIZE)
    old = types.ModuleType("cv2")
    old.__spec__ = importlib.util.spec_from_loader("cv2", None)
    old.__version__ = "4.5.1"  # type: ignore[attr-defined] # modules take any attribute
    monkeypatch.setitem(sys.modules, "cv2", old)
    with pytest.raises(MissingDependencyError, match=r"OpenCV 4\.5\.1 does not fit: it has no aruco"):
        find_tags(image, CAMERA, SIZE)
