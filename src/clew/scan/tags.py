"""Fiducial tags in camera images (ArUco, AprilTag 36h11) as landmarks with identity, through OpenCV."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError, MissingDependencyError
from clew.geometry import se3, so3

Array = NDArray[np.float64]
Index = NDArray[np.int64]

#: Families by the name of OpenCV's dictionary.
FAMILIES = {
    "apriltag-36h11": "DICT_APRILTAG_36h11",
    "aruco-4x4": "DICT_4X4_1000",
    "aruco-5x5": "DICT_5X5_1000",
    "aruco-6x6": "DICT_6X6_1000",
    "aruco-original": "DICT_ARUCO_ORIGINAL",
}
ITERATIONS = 10


def _identity() -> Array:
    return np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Camera:
    """A calibrated camera and its mounting.

    Attributes:
        matrix: ``(3, 3)`` intrinsics, pixels; the centre of the first pixel is (0, 0).
        distortion: ``(0,)``, ``(4,)``, ``(5,)`` or ``(8,)`` coefficients as OpenCV has them.
        T_robot_camera: ``(7,)`` SE3 storage of the camera's optical frame (x right, y down, z forwards) on the robot.
    """

    matrix: Array
    distortion: Array
    T_robot_camera: Array

    def __post_init__(self) -> None:
        shapes = (np.shape(self.matrix), np.shape(self.T_robot_camera))
        if shapes != ((3, 3), (7,)) or np.shape(self.distortion) not in ((0,), (4,), (5,), (8,)):
            raise InputError(f"Camera: matrix {shapes[0]}, distortion {np.shape(self.distortion)}, mounting "
                             f"{shapes[1]}: must be (3, 3), (0,), (4,), (5,) or (8,), and (7,)")


@dataclass(frozen=True, eq=False)
class Tags:
    """``K`` tags seen in one image, in the frame of the robot.

    Attributes:
        family: see `FAMILIES`.
        identities: ``(K,)`` numbers within the family.
        T_robot_tag: ``(K, 7)`` SE3 storage; a tag's x axis points to its right, y up, z out of it.
        covariances: ``(K, 6, 6)`` in the tangent of the pose, translation first.
        ambiguity: ``(K,)`` reprojection error of this pose over that of the other one which a flat square has; near
            1 the orientation may be the other, the position is good all the same.
        corners: ``(K, 4, 2)`` pixels.
    """

    family: str
    identities: Index
    T_robot_tag: Array
    covariances: Array
    ambiguity: Array
    corners: Array

    def __len__(self) -> int:
        return len(self.identities)

    @property
    def position_covariances(self) -> Array:
        """``(K, 3, 3)`` of the tags' centres in the robot's frame."""
        rotation = so3.matrix(self.T_robot_tag[:, 3:])
        return np.asarray(rotation @ self.covariances[:, :3, :3] @ np.swapaxes(rotation, 1, 2))

    def range_bearing(self) -> tuple[Array, Array, Array]:
        """Ranges ``(K,)`` and bearings ``(K,)`` in the robot's plane, and their covariances ``(K, 2, 2)``."""
        x, y = self.T_robot_tag[:, 0], self.T_robot_tag[:, 1]
        distance = np.hypot(x, y)
        jacobian = np.stack([
            np.stack([x / distance, y / distance], axis=1),
            np.stack([-y / distance**2, x / distance**2], axis=1),
        ], axis=1)  # fmt: skip
        covariances = jacobian @ self.position_covariances[:, :2, :2] @ np.swapaxes(jacobian, 1, 2)
        return distance, np.arctan2(y, x), covariances


def find_tags(image: NDArray[np.uint8], camera: Camera, size: float, *, family: str = "apriltag-36h11",
              sigma_pixel: float = 0.3) -> Tags:
    """Find tags in an image and where they stand to the robot.

    The first pose of each is that of a square (IPPE, Collins & Bartoli, IJCV 2014), refined on the reprojection of
    its four corners; the covariance is that of the refinement.

    Args:
        image: ``(h, w)`` grey or ``(h, w, 3)`` blue, green, red.
        camera: intrinsics and mounting.
        size: side of a tag's black square, metres.
        family: one of `FAMILIES`.
        sigma_pixel: standard deviation of a corner, pixels; it also stands for the blur's pull of corners inwards.

    Raises:
        InputError: no image, an unknown family, or a size that is not positive.
        MissingDependencyError: OpenCV is missing or has no tag detector.
    """
    cv2 = _library()
    if family not in FAMILIES:
        raise InputError(f"tag family {family!r}: choose {', '.join(FAMILIES)}")
    if image.dtype != np.uint8 or image.ndim not in (2, 3) or not image.size:
        raise InputError(f"an image is an array (h, w) or (h, w, 3) of uint8, not {image.shape} of {image.dtype}")
    if not size > 0 or not sigma_pixel > 0:
        raise InputError(f"tag size {size:g} m, corner noise {sigma_pixel:g} pixels: both must be positive")
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, FAMILIES[family]))
    corners, identities, _ = cv2.aruco.ArucoDetector(dictionary, parameters).detectMarkers(image)
    count = 0 if identities is None else len(identities)
    found = np.array(corners, dtype=np.float64).reshape(count, 4, 2)
    numbers = np.empty(0, np.int64) if identities is None else np.asarray(identities, dtype=np.int64).reshape(-1)
    order = np.lexsort((found[:, 0, 0], numbers)) if count else np.empty(0, np.int64)
    found, numbers = found[order], numbers[order]
    square = size / 2 * np.array([[-1.0, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])
    fits = [_fit(cv2, tag, square, camera) for tag in found]
    T_camera_tag = np.array([pose for pose, _, _ in fits]).reshape(-1, 7)
    covariances = sigma_pixel**2 * np.array([inverse for _, inverse, _ in fits]).reshape(-1, 6, 6)
    ambiguity = np.array([ratio for _, _, ratio in fits])
    return Tags(family, numbers, se3.compose(camera.T_robot_camera, T_camera_tag), covariances, ambiguity, found)


def _fit(cv2: Any, corners: Array, square: Array, camera: Camera) -> tuple[Array, Array, float]:
    """Pose ``(7,)`` of a tag in the camera's frame, its covariance for corners known to one pixel, and the ratio of
    the errors of the two poses that a square has."""
    _, turns, shifts, _ = cv2.solvePnPGeneric(square, corners, camera.matrix, camera.distortion,
                                              flags=cv2.SOLVEPNP_IPPE_SQUARE)
    found = zip(shifts, turns, strict=True)
    poses = [np.concatenate([np.ravel(shift), so3.exp(np.ravel(turn))]) for shift, turn in found]
    fits = sorted((_refine(cv2, pose, corners, square, camera) for pose in poses), key=lambda fit: fit[2])
    ratio = np.sqrt(fits[0][2] / max(fits[1][2], 1e-12)) if len(fits) > 1 else 0.0
    return fits[0][0], fits[0][1], float(min(ratio, 1.0))


def _refine(cv2: Any, pose: Array, corners: Array, square: Array, camera: Camera) -> tuple[Array, Array, float]:
    """Gauss-Newton on the corners: pose, inverse information at one pixel, sum of squares."""
    for _ in range(ITERATIONS):
        error, jacobian = _reproject(cv2, pose, corners, square, camera)
        inverse = np.linalg.inv(jacobian.T @ jacobian)
        pose = se3.retract(pose, -inverse @ jacobian.T @ error)
    error, jacobian = _reproject(cv2, pose, corners, square, camera)
    return pose, np.asarray(np.linalg.inv(jacobian.T @ jacobian)), float(error @ error)


def _reproject(cv2: Any, pose: Array, corners: Array, square: Array, camera: Camera) -> tuple[Array, Array]:
    """Predicted minus measured pixels ``(8,)`` and the derivative ``(8, 6)`` by the tangent of the pose."""
    predicted, by_all = cv2.projectPoints(square, so3.log(pose[3:]), pose[:3], camera.matrix, camera.distortion)
    by_point = by_all[:, 3:6].reshape(4, 2, 3)  # a shift of the tag shifts each corner alike
    rotation = so3.matrix(pose[3:])
    by_turn = rotation @ np.cross(np.eye(3)[None], square[:, None]).swapaxes(1, 2)  # R [w]x p
    return (predicted.reshape(4, 2) - corners).ravel(), np.concatenate(
        [by_point @ rotation, by_point @ by_turn], axis=2).reshape(8, 6)


def _library() -> Any:
    """OpenCV with its tag detector."""
    advice = "install it with: pip install 'clew[camera]'"
    if importlib.util.find_spec("cv2") is None:
        raise MissingDependencyError(f"finding tags needs the library OpenCV, which is missing; {advice}")
    try:
        import cv2
    except ImportError as error:
        raise MissingDependencyError(f"the installed OpenCV cannot be loaded ({error}); {advice}") from error
    lacking = [name for name in ("ArucoDetector", "getPredefinedDictionary") if not hasattr(cv2.aruco, name)] if (
        hasattr(cv2, "aruco")) else ["aruco"]
    if lacking:
        raise MissingDependencyError(f"the installed OpenCV {cv2.__version__} does not fit: it has no {lacking[0]} "
                                     f"(4.7 or later has); {advice}")
    return cv2
