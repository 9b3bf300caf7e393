"""The picture of a run: what is drawn lies where the world has it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from clew.mapping import OccupancyGrid
from clew.view import save_overview_png
from clew.view.ellipses import ellipse_outlines
from clew.view.style import CLOSURE, FREE, OCCUPIED, ODOMETRY, TRAJECTORY, UNCERTAINTY, UNKNOWN
from view.pictures import Pixels, close_to, pixels_of, rgb

CHI2_95 = 5.991464547107979  # chi-square of two degrees of freedom, from tables
ORIGIN = np.array([-2.0, 5.0])
ROWS, COLS, RESOLUTION = 200, 250, 0.1  # 20 m high, 25 m wide


def run(**changes: Any) -> dict[str, Any]:
    log_odds = np.full((ROWS, COLS), -2.0)
    log_odds[:10] = 0.0
    log_odds[150, :] = 3.5
    around = ORIGIN + np.array([[2.0, 3.0], [20.0, 3.0], [20.0, 12.0], [2.0, 12.0], [2.0, 4.0]])
    return {
        "grid": OccupancyGrid(log_odds, RESOLUTION, ORIGIN),
        "odometry_xy": around + np.linspace(0.0, 2.0, 5)[:, None],
        "trajectory_xy": around,
        "keyframes": np.column_stack([around, np.zeros(5)]),
        "closures_accepted": np.array([[0, 2]]),
        "title": "A run", "subtitle": "5 scans",
    } | changes


def draw(folder: Path, **changes: Any) -> Pixels:
    save_overview_png(folder / "overview.png", **run(**changes))
    return pixels_of(folder / "overview.png")


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Pixels:
    return draw(tmp_path_factory.mktemp("plain"))


def map_part(picture: Pixels) -> tuple[Pixels, float]:
    """The rows of the map, and its pixels per metre: a map of 250 columns is drawn with 8 pixels a cell."""
    bottom = np.flatnonzero((picture == rgb(UNKNOWN)).all(axis=(1, 2)))[-1] + 1
    return picture[bottom - 8 * ROWS:bottom], 8 / RESOLUTION


def at(picture: Pixels, x: float, y: float) -> Pixels:
    """The colours of 5 x 5 pixels around a world position."""
    part, scale = map_part(picture)
    col, row = int((x - ORIGIN[0]) * scale), part.shape[0] - 1 - int((y - ORIGIN[1]) * scale)
    return part[row - 2:row + 3, col - 2:col + 3]


def test_map_paths_and_closures_lie_where_they_belong(plain: Pixels) -> None:
    picture = plain
    assert (at(picture, ORIGIN[0] + 5.0, ORIGIN[1] + 15.05) == rgb(OCCUPIED)).all()
    assert (at(picture, ORIGIN[0] + 23.0, ORIGIN[1] + 18.0) == rgb(FREE)).all()
    assert (at(picture, ORIGIN[0] + 23.0, ORIGIN[1] + 0.5) == rgb(UNKNOWN)).all()
    assert close_to(at(picture, ORIGIN[0] + 11.0, ORIGIN[1] + 3.0), TRAJECTORY).any()
    assert close_to(at(picture, ORIGIN[0] + 20.0, ORIGIN[1] + 6.0), TRAJECTORY).any()
    assert close_to(at(picture, ORIGIN[0] + 11.0, ORIGIN[1] + 7.5), CLOSURE).any()  # halfway from 0 to 2
    assert not close_to(at(picture, ORIGIN[0] + 11.0, ORIGIN[1] + 9.0), CLOSURE).any()
    drawn = close_to(map_part(picture)[0], ODOMETRY)
    assert 0.2 * 1300 < drawn.sum() < 20_000  # a dashed line


def test_odometry_that_flies_off_leaves_map_and_heading_as_they_are(plain: Pixels, tmp_path: Path) -> None:
    calm = plain
    scale = np.array([[1.0], [1.0], [300.0], [-300.0], [1.0]])
    wild = draw(tmp_path, odometry_xy=run()["odometry_xy"] * scale)
    assert wild.shape == calm.shape
    height = map_part(calm)[0].shape[0]
    top = np.flatnonzero((calm == rgb(UNKNOWN)).all(axis=(1, 2)))[-1] + 1 - height
    assert (wild[:top] == calm[:top]).all()
    assert (at(wild, ORIGIN[0] + 5.0, ORIGIN[1] + 15.05) == rgb(OCCUPIED)).all()
    # Only the legend's words differ below the map: it says that the odometry leaves the picture.
    foot_calm, foot_wild = calm[top + height:], wild[top + height:]
    assert (foot_calm != foot_wild).any()
    assert close_to(foot_calm, ODOMETRY).sum() == close_to(foot_wild, ODOMETRY).sum()


def test_rejected_closures_and_ellipses_show_only_when_given(plain: Pixels, tmp_path: Path) -> None:
    covariances = np.tile(np.diag([0.5, 0.1]), (5, 1, 1))
    full = draw(tmp_path, closures_rejected=np.array([[1, 3]]), covariances=covariances)
    assert not close_to(plain, UNCERTAINTY, 20).any()
    assert close_to(full, UNCERTAINTY, 60).any()
    # The ellipse around a keyframe that looks along x is long along x.
    half_x, half_y = np.sqrt(CHI2_95 * np.array([0.5, 0.1]))
    x, y = ORIGIN[0] + 20.0, ORIGIN[1] + 12.0
    assert close_to(at(full, x + half_x, y), UNCERTAINTY, 90).any()
    assert close_to(at(full, x, y + half_y), UNCERTAINTY, 90).any()


@pytest.mark.parametrize("shape", [(2000, 30), (30, 2000), (3, 3), (2500, 2600)])
def test_maps_of_any_shape_give_a_readable_picture(tmp_path: Path, shape: tuple[int, int]) -> None:
    picture = draw(tmp_path, grid=OccupancyGrid(np.full(shape, -2.0), RESOLUTION, ORIGIN))
    height, width = picture.shape[:2]
    assert 1000 <= width <= 2000
    assert 200 < height <= 2600


def test_a_run_without_closures_or_motion_can_be_drawn(tmp_path: Path) -> None:
    one = np.array([[0.0, 10.0]])
    draw(tmp_path, closures_accepted=np.zeros((0, 2), np.int64), keyframes=np.zeros((0, 3)), odometry_xy=one,
         trajectory_xy=one)
    draw(tmp_path, closures_accepted=np.zeros((0, 2), np.int64), keyframes=np.zeros((0, 3)),
         odometry_xy=np.zeros((0, 2)), trajectory_xy=np.zeros((0, 2)))


def test_the_same_run_gives_the_same_bytes(tmp_path: Path) -> None:
    draw(tmp_path)
    first = (tmp_path / "overview.png").read_bytes()
    draw(tmp_path)
    assert (tmp_path / "overview.png").read_bytes() == first


def test_ellipses_hold_the_stated_share() -> None:
    rng = np.random.default_rng(0)
    factor = rng.normal(size=(6, 2, 2))
    covariances = factor @ factor.transpose(0, 2, 1)
    centres = rng.normal(size=(6, 2))
    for confidence, quantile in ((0.95, CHI2_95), (0.5, 1.386294361119891)):
        offsets = ellipse_outlines(centres, covariances, confidence) - centres[:, None]
        distance = np.einsum("kni,kij,knj->kn", offsets, np.linalg.inv(covariances), offsets)
        np.testing.assert_allclose(distance, quantile)
        samples = rng.multivariate_normal(np.zeros(2), covariances[0], 20_000)
        inside = np.einsum("ni,ij,nj->n", samples, np.linalg.inv(covariances[0]), samples) < quantile
        assert inside.mean() == pytest.approx(confidence, abs=0.01)
