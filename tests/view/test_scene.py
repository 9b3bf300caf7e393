"""From graphs and solutions to what is drawn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import clew
from clew.errors import InputError
from clew.evaluate import factor_residuals
from clew.view import DARK, Scene, before_after_figure, graph_figure, graph_scene, save_figure, solution_scene
from clew.view.ellipses import readable_ellipses
from view.pictures import close_to, pixels_of

TURN = 0.5


def small_graph() -> tuple[clew.FactorGraph, np.ndarray]:
    """Two poses, the second turned to the left; a landmark; a closure that nobody can believe."""
    graph = clew.FactorGraph()
    keys = graph.add_pose(clew.SE2.from_array(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, TURN]])))
    point = graph.add_point(np.array([2.0, 1.0]))
    graph.add(clew.Prior(keys[0], clew.SE2.identity(), sigmas=1e-6))
    graph.add(clew.Between(keys[0], keys[1], clew.SE2(1.0, 0.0, TURN), sigmas=(0.3, 0.1, 0.01)))
    graph.add(clew.PointObservation(keys[0], point, np.array([2.0, 1.0]), sigmas=(0.2, 0.4)))
    graph.add(clew.Between(keys[0], keys[1], clew.SE2(90.0, 0.0, 0.0), sigmas=0.1, role="loop", kernel=clew.DCS()))
    return graph, keys


def test_a_solution_is_drawn_where_it_is_with_covariances_in_the_world() -> None:
    graph, _ = small_graph()
    solution = clew.optimize(graph, init="file")
    scene = solution_scene(solution)
    np.testing.assert_allclose(scene.poses, solution.values(clew.SE2).array[:, :2])
    np.testing.assert_allclose(scene.landmarks, solution.values(clew.Point2).array)
    np.testing.assert_allclose(scene.edges["odometry"], scene.poses[None])
    np.testing.assert_allclose(scene.edges["observation"], [[scene.poses[0], scene.landmarks[0]]])
    assert scene.pose_covariances is not None
    assert scene.point_covariances is not None
    # The residual of a relative pose is in the frame of the second pose, which is turned: its 0.3 m lie
    # along the direction in which that one looks.
    ahead, left = np.array([[np.cos(TURN), np.sin(TURN)], [-np.sin(TURN), np.cos(TURN)]])
    expected = 0.09 * np.outer(ahead, ahead) + 0.01 * np.outer(left, left)
    np.testing.assert_allclose(scene.pose_covariances[1], expected, rtol=0.02, atol=1e-4)
    np.testing.assert_allclose(scene.point_covariances[0], np.diag([0.04, 0.16]), rtol=1e-3, atol=1e-9)
    assert solution_scene(solution, covariances=False).pose_covariances is None


def test_edges_without_weight_and_edges_that_were_left_out_are_rejected() -> None:
    graph, keys = small_graph()
    residuals = factor_residuals(graph, None)
    scene = graph_scene(graph, residuals=residuals)
    assert {role: len(ends) for role, ends in scene.edges.items()} == {
        "odometry": 1, "observation": 1, "loop": 0, "rejected": 1}
    assert len(graph_scene(graph).edges["loop"]) == 1
    assert len(graph_scene(graph, rejected=[keys, keys]).edges["rejected"]) == 2


def test_robots_have_their_colours(tmp_path: Path) -> None:
    graph = clew.FactorGraph()
    a = graph.add_pose(clew.SE2.from_array(np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0]])))
    b = graph.add_pose(clew.SE2.from_array(np.array([[0.0, 8.0, 0.0], [10.0, 8.0, 0.0]])))
    for pair in (a, b):
        graph.add(clew.Between(pair[0], pair[1], clew.SE2(10.0, 0.0, 0.0), sigmas=0.1))
    scene = graph_scene(graph, robots={"ann": a, "bob": b})
    np.testing.assert_array_equal(scene.robot_of_pose, [0, 0, 1, 1])
    np.testing.assert_array_equal(scene.robot_of_edge, [0, 1])
    save_figure(graph_figure(scene, theme=DARK), tmp_path / "g.png")
    part = pixels_of(tmp_path / "g.png")[100:-120]
    rows = [np.nonzero(close_to(part, DARK.robot(robot), 30))[0].mean() for robot in (0, 1)]
    assert rows[0] > rows[1] + 500  # ann drives below bob


def test_before_and_after_share_one_scale(tmp_path: Path) -> None:
    small = Scene(np.array([[0.0, 0.0], [5.0, 0.0]]), {"odometry": np.array([[[0.0, 0.0], [5.0, 0.0]]])})
    large = Scene(np.array([[0.0, 0.0], [10.0, 0.0]]), {"odometry": np.array([[[0.0, 0.0], [10.0, 0.0]]])})
    save_figure(before_after_figure(small, large, theme=DARK), tmp_path / "g.png")
    picture = pixels_of(tmp_path / "g.png")
    assert picture.shape[1] <= 1800 + 4 * 40 + 40  # two graphs, their margins and what is between them
    part = picture[100:-120]
    half = part.shape[1] // 2
    lengths = [np.ptp(np.nonzero(close_to(side, DARK.trajectory, 40))[1]) for side in (part[:, :half], part[:, half:])]
    assert lengths[1] == pytest.approx(2 * lengths[0], abs=4)
    with pytest.raises(InputError):
        before_after_figure(small, Scene(np.zeros((1, 3))))


def test_ellipses_in_space_are_those_of_the_projected_position() -> None:
    covariance = np.diag([0.04, 0.09, 0.25])
    figure = graph_figure(Scene(np.array([[0.0, 0.0, 0.0], [9.0, 0.0, 0.0]]),
                                pose_covariances=np.stack([covariance, covariance])))
    outline = figure.axes[0].collections[-1].get_paths()[0].vertices
    extent = np.ptp(np.asarray(outline), axis=0) / 2.0
    # The picture's axes are sqrt(3)/2 (x + y) and z + (y - x) / 2.
    spread = np.sqrt([0.75 * (0.04 + 0.09), 0.25 + 0.25 * (0.04 + 0.09)])
    np.testing.assert_allclose(extent, np.sqrt(-2.0 * np.log(0.05)) * spread, rtol=0.01)


def test_ellipses_are_thinned_and_magnified_and_say_so() -> None:
    centres = np.column_stack([np.linspace(0.0, 100.0, 5001), np.zeros(5001)])
    wide = readable_ellipses(centres, np.tile(np.eye(2), (5001, 1, 1)), pixels_per_metre=10.0)
    assert wide.magnification == 1.0
    assert 20 <= len(wide.outlines) <= 80
    middles = np.sort(wide.outlines.mean(axis=1)[:, 0])
    assert np.diff(middles).min() > np.sqrt(5.991)  # half the sum of two half axes
    assert f"{len(wide.outlines)} among 5,001" in wide.label
    tiny = readable_ellipses(centres[::1000], np.tile(1e-6 * np.eye(2), (6, 1, 1)), pixels_per_metre=10.0)
    assert tiny.magnification == 500.0
    assert "500 times larger" in tiny.label
    assert np.ptp(tiny.outlines[0, :, 0]) == pytest.approx(2 * 500.0 * np.sqrt(5.991464547) * 1e-3, rel=0.01)
    none = readable_ellipses(np.zeros((1, 2)), np.zeros((1, 2, 2)), pixels_per_metre=10.0, confidence=0.5)
    assert none.label == "50 % ellipses"
    with pytest.raises(InputError):
        readable_ellipses(centres, np.tile(np.eye(2), (5001, 1, 1)), 10.0, confidence=95.0)


def test_scenes_that_do_not_fit_are_refused() -> None:
    poses = np.zeros((2, 2))
    for wrong in ({"robot_of_pose": np.zeros(3, int)}, {"robot_of_edge": np.zeros(1, int)},
                  {"point_covariances": np.zeros((1, 2, 2))}):
        with pytest.raises(InputError):
            Scene(poses, **wrong)
