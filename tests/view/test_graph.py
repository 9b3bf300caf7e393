"""Pictures of factor graphs in the plane and in space."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from clew.errors import InputError
from clew.view import Scene, graph_figure, save_figure
from clew.view.style import CLOSURE, INK, LANDMARK, PAPER, TRAJECTORY, UNCERTAINTY
from view.pictures import Pixels, close_to, pixels_of, rgb

Array = NDArray[np.float64]


def plot_graph(
    path: Path, poses: Array, edges: dict[str, Array], points: Array | None = None, covariances: Array | None = None,
    title: str = "",
) -> None:
    save_figure(graph_figure(Scene(poses, edges, points, covariances), title), path)


def chain(poses: Array) -> Array:
    return np.stack([poses[:-1], poses[1:]], axis=1)


def loop_of(poses: Array) -> dict[str, Array]:
    return {"odometry": chain(poses), "loop": poses[[[0, -1]]]}


def graph_part(picture: Pixels) -> Pixels:
    """What lies between heading and legend."""
    return picture[100:-120]


def test_edges_are_drawn_between_their_poses_in_the_colour_of_their_role(tmp_path: Path) -> None:
    # A square of 10 m, open on the left: odometry along three sides, the loop closure along the fourth.
    poses = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])
    plot_graph(tmp_path / "g.png", poses, loop_of(poses), title="square")
    part = graph_part(pixels_of(tmp_path / "g.png"))
    rows, cols = np.nonzero(close_to(part, TRAJECTORY, 60))
    side = rows.max() - rows.min()
    assert side == pytest.approx(cols.max() - cols.min(), abs=3)  # equal scales
    assert side == pytest.approx(1500, abs=4)
    # The closure lies on the left side and nowhere else; it is drawn see-through.
    tinted = (0.6 * rgb(CLOSURE) + 0.4 * rgb(PAPER)).astype(np.int16)
    near = np.abs(part - tinted).max(axis=-1) < 20
    assert near.sum() > 1000
    assert np.abs(np.nonzero(near)[1] - cols.min()).max() <= 3


def test_landmarks_and_ellipses_show_only_when_given(tmp_path: Path) -> None:
    poses = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]])
    plot_graph(tmp_path / "g.png", poses, loop_of(poses))
    plain = pixels_of(tmp_path / "g.png")
    points, covariances = np.array([[2.0, 7.0]]), np.tile(np.eye(2), (3, 1, 1))
    plot_graph(tmp_path / "g.png", poses, loop_of(poses), points, covariances)
    full = pixels_of(tmp_path / "g.png")
    assert not close_to(plain, LANDMARK, 10).any()
    assert close_to(graph_part(full), LANDMARK, 10).any()
    assert not close_to(plain, UNCERTAINTY, 40).any()
    assert close_to(full, UNCERTAINTY, 60).any()


def test_a_graph_in_space_keeps_equal_axes_and_shows_height_upwards(tmp_path: Path) -> None:
    # Three poles of 3 m from one corner: in an isometric picture they are equally long.
    ends = {"x": (3.0, 0.0, 0.0), "y": (0.0, 3.0, 0.0), "z": (0.0, 0.0, 3.0)}
    poses = np.array([[0.0, 0.0, 0.0], *ends.values()])
    edges = np.stack([np.zeros((3, 3)), poses[1:]], axis=1)
    for edges_by_role, colour in (({"odometry": edges}, TRAJECTORY), ({}, INK)):
        plot_graph(tmp_path / "g.png", poses, edges_by_role)
        rows, cols = np.nonzero(close_to(graph_part(pixels_of(tmp_path / "g.png")), colour, 60))
        height, width = np.ptp(rows), np.ptp(cols)
        # x and y reach down and up by half a length to the right; z a whole length up.
        assert height / width == pytest.approx(1.5 / np.sqrt(0.75), rel=0.03)  # dots have a size
        assert cols[rows.argmin()] == pytest.approx(cols.min(), abs=8)


def test_fifteen_thousand_poses_take_seconds_not_minutes(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    poses = np.cumsum(rng.normal(size=(15_000, 2)), axis=0)
    pairs = rng.integers(0, len(poses), (5_000, 2))
    begin = time.perf_counter()
    plot_graph(tmp_path / "g.png", poses, {"odometry": chain(poses), "loop": poses[pairs]},
               covariances=np.tile(np.eye(2), (len(poses), 1, 1)))
    assert time.perf_counter() - begin < 20.0


@pytest.mark.parametrize("poses", [
    np.zeros((0, 2)), np.array([[3.0, 4.0]]), np.array([[0.0, 1.0], [5.0, 1.0]]),
    np.array([[1.0, 0.0], [1.0, 9.0]]), np.zeros((3, 2)), np.array([[0.0, 0.0, 0.0], [1e-9, 0.0, 0.0]]),
    1e6 + np.eye(3),
])
def test_degenerate_graphs_can_be_drawn(tmp_path: Path, poses: Array) -> None:
    no_loops = np.zeros((0, 2, poses.shape[1]))
    plot_graph(tmp_path / "g.png", poses, {"odometry": chain(poses), "loop": no_loops})
    height, width = pixels_of(tmp_path / "g.png").shape[:2]
    assert 600 < height < 2200
    assert 1000 < width < 2200


def test_roles_that_are_not_known_are_drawn_too(tmp_path: Path) -> None:
    poses = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0]])
    plot_graph(tmp_path / "g.png", poses, {"calibration": chain(poses)})
    assert close_to(graph_part(pixels_of(tmp_path / "g.png")), INK, 40).sum() > 3000


def test_the_same_graph_gives_the_same_bytes(tmp_path: Path) -> None:
    poses = np.random.default_rng(2).normal(size=(30, 3))
    for name in ("a.png", "b.png"):
        plot_graph(tmp_path / name, poses, loop_of(poses), title="graph")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


@pytest.mark.parametrize(("poses", "edges", "points", "covariances"), [
    (np.array([[0.0, np.nan]]), np.zeros((0, 2, 2)), None, None),
    (np.zeros((2, 4)), np.zeros((0, 2, 2)), None, None),
    (np.zeros((2, 2)), np.zeros((1, 2, 3)), None, None),
    (np.zeros((2, 2)), np.full((1, 2, 2), np.inf), None, None),
    (np.zeros((2, 2)), np.zeros((1, 2, 2)), np.zeros((1, 3)), None),
    (np.zeros((2, 2)), np.zeros((1, 2, 2)), None, np.zeros((1, 2, 2))),
    (np.zeros((2, 3)), np.zeros((1, 2, 3)), None, np.zeros((2, 2, 2))),
])
def test_what_cannot_be_drawn_is_refused(
    tmp_path: Path, poses: Array, edges: Array, points: Array | None, covariances: Array | None
) -> None:
    with pytest.raises(InputError):
        plot_graph(tmp_path / "g.png", poses, {"odometry": edges}, points, covariances)
    assert list(tmp_path.iterdir()) == []
