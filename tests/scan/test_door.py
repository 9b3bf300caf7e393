"""What the native door refuses: nothing reaches the kernels that they could not index."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from clew import _native
from clew.scan import index_cloud
from scan.clouds import random_cloud

POINTS = np.random.default_rng(0).uniform(-1, 1, (20, 2))
ONES = np.ones(20)
BEAMS = np.arange(20, dtype=np.int32)
NAN = np.where(np.arange(40).reshape(20, 2) == 7, np.nan, POINTS)
VAST = np.where(np.arange(40).reshape(20, 2) == 7, np.inf, POINTS)
CELLS = np.zeros((3, 30, 30), dtype=np.uint8)


def refused(function: str, *arguments: Any) -> None:
    with pytest.raises((ValueError, TypeError)):
        getattr(_native.scan, function)(*arguments)


@pytest.mark.parametrize("points", [NAN, VAST, POINTS[:, :1], POINTS.ravel(), POINTS[None]])
def test_points_must_be_rows_of_two_finite_numbers(points: np.ndarray) -> None:
    refused("sort_into_buckets", points, POINTS, ONES, -1.0, -1.0, 0.1, 20, 20)
    refused("merge_surfels", points, POINTS, ONES, ONES, 0.1)
    refused("between_returns", points, POINTS, ONES, ONES, 0.1, 0.1, 0.1, 0.1, 0.1)
    refused("build_pyramid", points, 0.1, 3, 30, 30, -1.5, -1.5, 0.1)
    refused("correlate", *correlation(points=points))


@pytest.mark.parametrize("changed", [
    {"angles": ONES[:-1]}, {"angles": np.full(20, np.nan)}, {"at": np.zeros(2)}, {"farthest": np.inf},
    {"farthest": np.nan}, {"window": 0}, {"radius": 0.0},
], ids=lambda changed: next(iter(changed)))
def test_extract_returns_refuses(changed: dict[str, Any]) -> None:
    arguments = {"ranges": ONES, "angles": 0.01 * BEAMS, "at": np.zeros(3), "nearest": 0.0, "farthest": 5.0,
                 "window": 8, "radius": 0.2, "gap_base": 0.1, "gap_per_metre": 0.1, "blob": 0.4,
                 "weight_per_metre": 1.0}
    _native.scan.extract_returns(*arguments.values())
    refused("extract_returns", *{**arguments, **changed}.values())


def test_clouds_and_beams_must_fit_each_other() -> None:
    for part in range(4):
        cloud = [array[:-1] if k == part else array for k, array in enumerate([POINTS, POINTS, ONES, ONES])]
        refused("merge_surfels", *cloud, 0.1)
        refused("between_returns", *cloud, 0.1, 0.1, 0.1, 0.1, 0.1)
    refused("merge_surfels", POINTS, POINTS, ONES, 0.0 * ONES, 0.1)
    refused("between_returns", POINTS, POINTS, ONES, ONES, 0.0, 0.1, 0.1, 0.1, 0.1)
    refused("deskew", ONES, ONES[:-1], ONES, np.zeros(3), np.zeros(3))
    refused("deskew", ONES, ONES, ONES[:-1], np.zeros(3), np.zeros(3))
    refused("deskew", ONES, ONES, ONES, np.zeros(2), np.zeros(3))
    refused("deskew", ONES, ONES, ONES, np.zeros(3), np.zeros(2))


def test_grids_must_have_cells() -> None:
    for cell, width, height in ((0.0, 5, 5), (0.1, 0, 5), (0.1, 5, -1), (np.nan, 5, 5), (0.1, 2**30, 2**30)):
        refused("sort_into_buckets", POINTS, POINTS, ONES, 0.0, 0.0, cell, width, height)
    refused("merge_surfels", POINTS, POINTS, ONES, ONES, 0.0)
    refused("sort_into_buckets", POINTS, POINTS[:-1], ONES, 0.0, 0.0, 0.1, 5, 5)
    refused("sort_into_buckets", POINTS, POINTS, ONES[:-1], 0.0, 0.0, 0.1, 5, 5)
    for sigma, levels, height, width, resolution in ((0.1, 0, 9, 9, 0.1), (0.1, 13, 9, 9, 0.1), (0.1, 2, 0, 9, 0.1),
                                                     (0.0, 2, 9, 9, 0.1), (0.1, 2, 9, 9, 0.0)):
        refused("build_pyramid", POINTS, sigma, levels, height, width, 0.0, 0.0, resolution)


def correlation(**changed: Any) -> list[Any]:
    arguments = {"cells": CELLS, "x": 0.0, "y": 0.0, "resolution": 0.1, "points": POINTS, "centre": np.zeros(3),
                 "half": np.full(3, 0.2), "step": 0.05, "sigmas": np.ones(3), "weight": 0.0, "least": 0.0,
                 "excluded": np.zeros(0), "distance": 0.0, "angle": 0.0}
    return list({**arguments, **changed}.values())


@pytest.mark.parametrize("changed", [
    {"cells": CELLS[0]}, {"cells": CELLS[:0]}, {"resolution": 0.0}, {"step": 0.0}, {"centre": np.zeros(2)},
    {"centre": np.array([np.nan, 0, 0])}, {"half": np.array([0.1, -0.1, 0.1])}, {"half": np.array([np.inf, 0, 0])},
    {"half": np.array([1e5, 0, 0])}, {"half": np.zeros(4)}, {"sigmas": np.array([1.0, 0.0, 1.0])},
    {"excluded": np.zeros(2)}, {"excluded": np.zeros(4)},
], ids=lambda changed: next(iter(changed)))
def test_correlate_refuses(changed: dict[str, Any]) -> None:
    _native.scan.correlate(*correlation())
    refused("correlate", *correlation(**changed))


def alignment(**changed: Any) -> list[Any]:
    cloud = random_cloud(np.random.default_rng(0), 20)
    index = index_cloud(cloud)
    arguments = {
        "entries": index.entries, "target_offsets": index.offsets, "starts": index.starts,
        "starts_offsets": index.starts_offsets, "origins": index.origins, "shapes": index.shapes, "cells": index.cells,
        "points": cloud.points, "normals": cloud.normals, "weights": cloud.weights, "offsets": index.offsets,
        "pairs": np.zeros((1, 2), dtype=np.int32), "T_start": np.zeros((1, 3)), "T_prior": np.zeros((1, 3)),
        "information": np.zeros((1, 3, 3)), "radius_start": 0.4, "radius_end": 0.1, "sigma": 0.01, "robust": 2.0,
        "facing": 0.7, "iterations": 5, "correlated": 0.3, "threads": 1}
    made = {**arguments, **{k: v(arguments[k]) if callable(v) else v for k, v in changed.items()}}
    return list(made.values())


@pytest.mark.parametrize("changed", [
    {"pairs": np.array([[0, 1]], dtype=np.int32)}, {"pairs": np.array([[-1, 0]], dtype=np.int32)},
    {"pairs": np.zeros((2, 2), dtype=np.int32)}, {"T_start": np.zeros((1, 2))}, {"T_start": np.full((1, 3), np.nan)},
    {"T_prior": np.full((1, 3), np.inf)}, {"information": np.full((1, 3, 3), np.nan)},
    {"entries": lambda a: a[:-1]}, {"entries": lambda a: a[:, :-1].copy()}, {"weights": lambda a: a[:-1]},
    {"entries": lambda a: a * np.nan}, {"points": lambda a: a + np.inf}, {"starts": lambda a: a + 1},
    {"starts": lambda a: -a}, {"starts": lambda a: a[:-1]}, {"shapes": lambda a: a + 1}, {"shapes": lambda a: a * 0},
    {"target_offsets": lambda a: a + 1}, {"offsets": lambda a: a * 2}, {"cells": np.zeros(1)},
    {"offsets": np.array([0, 30, 20])}, {"offsets": np.zeros(0, dtype=np.int64)}, {"origins": np.full((1, 2), np.nan)},
    {"radius_start": 0.05}, {"radius_end": 0.0}, {"sigma": 0.0}, {"robust": -1.0}, {"iterations": 0},
    {"radius_start": np.inf}, {"correlated": -0.1}, {"correlated": np.nan},
], ids=lambda changed: next(iter(changed)))
def test_align_refuses(changed: dict[str, Any]) -> None:
    _native.scan.align(*alignment())
    refused("align", *alignment(**changed))
