"""The scene of a report as JSON for its page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from clew.view.report.content import Landmarks, Path, Scene, Summarised
from clew.view.report.encode import pack, pack_grid, pack_scans

if TYPE_CHECKING:
    from clew.place import Closure

Array = NDArray[np.float64]


def scene_data(scene: Scene) -> dict[str, object]:
    """All of a scene; positions count from `centre`, so that 32 bits are enough for them, and times from `begin`."""
    centre = _centre(scene)
    begin = float(min([*(p.times[0] for p in scene.paths if len(p.times)), *scene.times[:1], *scene.times.tolist()],
                      default=0.0))
    covariances = scene.covariances
    return {
        "dim": scene.dim,
        "timed": scene.timed,
        "begin": begin,
        "centre": centre.tolist(),
        "robots": list(scene.robots),
        "poses": {
            "position": pack(scene.positions - centre, "f4"),
            "heading": pack(scene.headings, "f4"),
            "time": pack(scene.times - begin, "f4"),
            "robot": pack(scene.robot, "u1"),
            "name": _names(scene.names),
            "covariance": None if covariances is None else pack(_upper(covariances), "f4"),
        },
        "edges": {
            "ends": pack(scene.edges.ends, "i4"),
            "role": pack(scene.edges.role, "u1"),
            "squared": pack(scene.edges.squared, "f4"),
            "weight": pack(scene.edges.weight, "f4"),
        },
        "landmarks": _landmarks(scene.landmarks, centre),
        "summarised": _summarised(scene.summarised, centre, begin),
        "paths": [_path(path, centre, begin) for path in scene.paths],
        "closures": [_closure(closure) for closure in scene.closures],
        "scans": pack_scans(scene.scans) if len(scene.scans) else None,
        "grid": None if scene.grid is None else _grid(scene, centre),
    }


def _centre(scene: Scene) -> Array:
    points = np.concatenate([scene.positions, scene.landmarks.positions.reshape(-1, scene.dim)])
    points = points[np.isfinite(points).all(axis=1)]
    return np.round(points.mean(axis=0)) if len(points) else np.zeros(scene.dim)


def _names(names: Sequence[str]) -> object:
    """Numbers where all names are small numbers, for they are shorter."""
    if all(name.isdecimal() and len(name) < 10 for name in names):
        return pack([int(name) for name in names], "i4")
    return list(names)


def _upper(covariances: Array) -> Array:
    rows, cols = np.triu_indices(3)
    return covariances[:, rows, cols]


def _landmarks(landmarks: Landmarks, centre: Array) -> dict[str, object]:
    covariances = landmarks.covariances
    return {
        "position": pack(landmarks.positions - centre if len(landmarks.positions) else [], "f4"),
        "covariance": None if covariances is None else pack(covariances[:, [0, 0, 1], [0, 1, 1]], "f4"),
        "name": list(landmarks.names),
        "sightings": pack(landmarks.sightings, "i4"),
    }


def _summarised(summarised: Summarised, centre: Array, begin: float) -> dict[str, object]:
    poses = summarised.poses
    return {
        "position": pack(poses[:, : len(centre)] - centre if len(poses) else [], "f4"),
        "heading": pack(poses[:, 2], "f4"),
        "time": pack(summarised.times - begin, "f4"),
        "name": _names(summarised.names),
    }


def _path(path: Path, centre: Array, begin: float) -> dict[str, object]:
    poses = path.poses.copy()
    poses[:, :2] -= centre[:2]
    return {"name": path.name, "kind": path.kind, "robot": path.robot, "time": pack(path.times - begin, "f4"),
            "pose": pack(poses, "f4")}


def _closure(closure: Closure) -> dict[str, object]:
    return {
        "source": closure.source,
        "target": closure.target,
        "verdict": closure.verdict.name.lower(),
        "reason": closure.verdict.value,
        "measured": _rounded(closure.T_target_source),
        "predicted": _rounded(closure.T_predicted) if np.isfinite(closure.T_predicted).all() else None,
        "similarity": _number(closure.similarity),
        "likelihood": _number(closure.likelihood),
        "overlap": _number(closure.overlap),
        "rms": _number(closure.rms),
        "contradiction": _number(closure.contradiction),
        "innovation": _rounded(closure.innovation),
        "seen_through": _number(closure.seen_through),
        "rival": _number(closure.rival),
        "distance": _number(closure.distance),
        "supporters": closure.supporters,
        "telling": closure.telling,
        "within": _number(closure.within),
        "in_row": closure.in_row,
    }


def _rounded(values: Array | tuple[float, ...]) -> list[float | None]:
    return [_number(value) for value in values]


def _number(value: float) -> float | None:
    return round(float(value), 5) if math.isfinite(value) else None


def _grid(scene: Scene, centre: Array) -> dict[str, object]:
    assert scene.grid is not None
    packed = pack_grid(scene.grid)
    packed["origin"] = (scene.grid.origin - centre[:2]).tolist()
    return packed
