"""Lines, corners, round things and reflectors in scans of known worlds: bias, covariance, what is not one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from clew.errors import InputError
from clew.geometry import se2, wrap
from clew.io import open_log, read_tum
from clew.scan import (
    CircleOptions,
    LaserScan,
    LineOptions,
    Lines,
    ReflectorOptions,
    ReturnOptions,
    find_circles,
    find_corners,
    find_lines,
    find_reflectors,
)
from clew.sim import LaserModel, cast_rays
from clew.sim.world import box, pillar

Array = NDArray[np.float64]

PLACE = np.array([0.2, -0.1, 0.4])  # of the laser on the robot
SIGMA = 0.01
RETURNS = ReturnOptions(sigma_range=SIGMA, sigma_bearing=1e-6, sigma_surface=0.0)  # walls of a simulation are straight
LINES, CIRCLES = LineOptions(RETURNS), CircleOptions(RETURNS)
LIDAR = Path(__file__).parents[3] / "shared" / "data" / "lidar"


def scans_of(segments: Array, poses: Array, *, beams: int = 721, seed: int = 0, sigma: float = SIGMA,
             dropout: float = 0.0, place: Array = PLACE) -> list[LaserScan]:
    """Scans of a laser all round, at true poses of the robot."""
    laser = LaserModel(beams=beams, field_of_view=2 * np.pi * (1 - 1 / beams), sigma_range=sigma, resolution=0.0,
                       dropout=dropout)
    distances = cast_rays(segments, se2.compose(poses, place), laser.angles, laser.range_max)
    ranges = laser.measure(distances, np.random.default_rng(seed))
    return [LaserScan(float(k), r, laser.angle_min, laser.angle_increment, 0.1, 30.0, place)
            for k, r in enumerate(ranges)]


def poses_in(low: tuple[float, float], high: tuple[float, float], count: int, seed: int = 1) -> Array:
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(low, high, (count, 2)), rng.uniform(-np.pi, np.pi, count)])


def check_nees(errors: Array, covariances: Array, *, band: float = 0.15) -> None:
    """Mean normalised error near its dimension: within the 99.9 % band of independent errors, or `band` of it."""
    n, d = errors.shape
    nees = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(covariances), errors).mean()
    low, high = chi2.ppf([0.0005, 0.9995], d * n) / n
    assert min(low, (1 - band) * d) < nees < max(high, (1 + band) * d), nees


def line_errors(lines: Lines, poses: Array, walls: list[tuple[float, float]]) -> Array:
    """Errors ``(K, 2)`` of each line against the wall nearest to it; walls as angle and distance in the world."""
    pose = poses[lines.scan]
    errors = []
    for angle, distance in walls:
        rho = distance - pose[:, 0] * np.cos(angle) - pose[:, 1] * np.sin(angle)
        errors.append(np.stack([wrap(lines.parameters[:, 0] - wrap(angle - pose[:, 2])),
                                lines.parameters[:, 1] - rho], axis=1))
    stacked = np.stack(errors, axis=1)
    nearest = np.abs(stacked).sum(axis=2).argmin(axis=1)
    return np.asarray(stacked[np.arange(len(lines)), nearest])


ROOM = box(0, 0, 8, 6)
ROOM_WALLS = [(np.pi, 0.0), (-np.pi / 2, 0.0), (0.0, 8.0), (np.pi / 2, 6.0)]


def test_walls_of_a_room_without_bias_and_with_their_covariance() -> None:
    poses = poses_in((2, 2), (6, 4), 150)
    lines = find_lines(scans_of(ROOM, poses), LINES)
    assert 4 * 150 <= len(lines) <= 5 * 150 + 30  # the wall behind is cut in two where the scan begins
    errors = line_errors(lines, poses, ROOM_WALLS)
    assert np.abs(errors).max() < 0.2
    assert np.abs(errors.mean(axis=0) / errors.std(axis=0)).max() < 4 / np.sqrt(len(errors))
    check_nees(errors, lines.covariances)
    alpha = lines.parameters[:, :1]
    on_line = lines.ends[..., 0] * np.cos(alpha) + lines.ends[..., 1] * np.sin(alpha)
    np.testing.assert_allclose(on_line, np.broadcast_to(lines.parameters[:, 1:], on_line.shape), atol=1e-9)


def test_exact_ranges_give_exact_lines_and_corners() -> None:
    poses = poses_in((2, 2), (6, 4), 10)
    lines = find_lines(scans_of(ROOM, poses, sigma=0.0), LINES)
    np.testing.assert_allclose(line_errors(lines, poses, ROOM_WALLS), 0, atol=1e-9)
    corners = find_corners(lines)
    np.testing.assert_allclose(corners.openings, np.pi / 2, atol=1e-9)


def test_walls_that_are_shifted_and_bent_keep_their_covariance() -> None:
    """However many returns: what all of a wall share does not average out."""
    rng = np.random.default_rng(5)
    shared = 0.02
    options = LineOptions(replace(RETURNS, sigma_range=0.003, sigma_surface=shared))
    errors, covariances = [], []
    for seed in range(150):
        length = rng.uniform(1.0, 6.0)
        tilt, shift = np.sqrt(12.0) * shared / length * rng.standard_normal(), shared * rng.standard_normal()
        along = 0.5 * length * np.array([[-np.sin(tilt), np.cos(tilt)]])
        middle = np.array([[3.0 + shift, 1.0]])
        scan = scans_of(np.stack([middle - along, middle + along], axis=1), np.zeros((1, 3)), seed=seed, sigma=0.001)
        lines = find_lines(scan, options)
        assert len(lines) == 1
        errors.append(lines.parameters[0] - [0.0, 3.0])
        covariances.append(lines.covariances[0])
    check_nees(np.array(errors), np.array(covariances))


def test_covariance_of_a_laser_far_from_the_centre() -> None:
    """Angle and distance are correlated by the lever arm; only their joint covariance shows it."""
    poses = np.column_stack([np.full((200, 2), (5.0, 4.0)), np.linspace(-0.3, 0.3, 200)])
    lines = find_lines(scans_of(ROOM, poses, place=np.array([-2.0, -2.0, 1.0])), LINES)
    check_nees(line_errors(lines, poses, ROOM_WALLS), lines.covariances)


def test_one_scan_or_many_is_the_same() -> None:
    scans = scans_of(ROOM, poses_in((2, 2), (6, 4), 5))
    together = find_lines(scans, LINES)
    for number, scan in enumerate(scans):
        alone = find_lines([scan], LINES)
        np.testing.assert_array_equal(alone.parameters, together.parameters[together.scan == number])
        np.testing.assert_array_equal(alone.covariances, together.covariances[together.scan == number])


def test_corners_of_a_room_and_of_a_pillar() -> None:
    world = np.concatenate([ROOM, box(3.5, 2.6, 4.5, 3.4)])
    true = np.array([[0, 0], [8, 0], [8, 6], [0, 6], [3.5, 2.6], [4.5, 2.6], [4.5, 3.4], [3.5, 3.4]])
    poses = np.concatenate([poses_in((1, 1), (2.5, 5), 60), poses_in((5.5, 1), (7, 5), 60, seed=2)])
    corners = find_corners(find_lines(scans_of(world, poses, beams=1441), LINES))
    local = se2.act(se2.inverse(poses)[:, None], true)
    away = corners.positions[:, None] - local[corners.scan]
    which = np.hypot(away[..., 0], away[..., 1]).argmin(axis=1)
    errors = away[np.arange(len(corners)), which]
    assert np.abs(errors).max() < 0.05
    check_nees(errors, corners.covariances)
    assert (which < 4).sum() > 250
    assert (which >= 4).sum() > 60
    np.testing.assert_allclose(corners.openings[which < 4], np.pi / 2, atol=0.1)
    np.testing.assert_allclose(corners.openings[which >= 4], 3 * np.pi / 2, atol=0.2)
    # The corner of the room at the origin opens towards the first quadrant of the world.
    origin = which == 0
    in_world = wrap(corners.orientations[origin] + poses[corners.scan[origin], 2])
    np.testing.assert_allclose(in_world, np.pi / 4, atol=0.05)


TREES = np.array([[10.0, 10.0, 0.3], [14.0, 10.0, 0.15], [10.0, 13.0, 0.5]])
FOREST = np.concatenate([box(0, 0, 20, 20), *(pillar(x, y, r, 256) for x, y, r in TREES)])


@pytest.mark.parametrize("number", range(3))
def test_round_things_without_bias_and_with_their_covariance(number: int) -> None:
    poses = poses_in((11, 11), (13, 12), 150)
    circles = find_circles(scans_of(FOREST, poses, beams=1441), CIRCLES)
    local = se2.act(se2.inverse(poses)[circles.scan], TREES[number, :2])
    mine = np.hypot(*(circles.centres - local).T) < 0.2
    assert mine.sum() > 140
    errors = np.column_stack([circles.centres - local, circles.radii - TREES[number, 2]])[mine]
    covariances = circles.covariances[mine]
    assert abs(errors[:, 2].mean()) < 0.5 * np.sqrt(covariances[:, 2, 2].mean())
    check_nees(errors, covariances, band=0.35)


def test_walls_and_boxes_are_not_round() -> None:
    poses = poses_in((2, 2), (6, 4), 60)
    world = np.concatenate([ROOM, box(3.9, 0.8, 4.2, 1.1), box(1.0, 5.0, 1.6, 5.3)])
    circles = find_circles(scans_of(world, poses, dropout=0.01), CIRCLES)
    assert len(circles) <= 6  # a box seen over its corner from afar may pass for round now and then


def test_round_things_are_no_lines() -> None:
    poses = poses_in((11, 11), (13, 12), 40)
    lines = find_lines(scans_of(FOREST, poses, beams=1441), LINES)
    wall = line_errors(lines, poses, [(np.pi, 0.0), (-np.pi / 2, 0.0), (0.0, 20.0), (np.pi / 2, 20.0)])
    assert (np.abs(wall).max(axis=1) < 0.2).mean() > 0.99


def test_reflectors_by_intensity() -> None:
    poses = poses_in((2, 2), (6, 4), 80)
    marks = np.array([[0.0, 2.0], [8.0, 3.5], [4.0, 6.0]])  # strips 0.2 m wide on the walls
    scans = []
    for pose, scan in zip(poses, scans_of(ROOM, poses, beams=1441), strict=True):
        sensor = se2.compose(pose, PLACE)
        true = cast_rays(ROOM, sensor[None], scan.angles)[0]
        hits = se2.act(sensor, true[:, None] * np.stack([np.cos(scan.angles), np.sin(scan.angles)], axis=1))
        bright = (np.hypot(*np.moveaxis(hits[:, None] - marks, 2, 0)) < 0.1).any(axis=1)
        scans.append(replace(scan, intensities=np.where(bright, 200.0, 40.0)))
    found = find_reflectors(scans, ReflectorOptions(150.0, RETURNS))
    assert 3 * 80 <= len(found) <= 3 * 80 + 3  # the strip behind may be cut in two where the scan begins
    local = se2.act(se2.inverse(poses)[:, None], marks)
    away = found.positions[:, None] - local[found.scan]
    which = np.hypot(away[..., 0], away[..., 1]).argmin(axis=1)
    whole = np.bincount(found.scan)[found.scan] == 3
    errors = away[np.arange(len(found)), which][whole]
    assert np.hypot(*errors.T).max() < 0.05
    check_nees(errors, found.covariances[whole], band=0.3)  # an oblique strip's middle is not that of its beams
    np.testing.assert_array_equal(found.intensities, 200.0)
    with pytest.raises(InputError, match="scan 1 has no intensities"):
        find_reflectors([scans[0], replace(scans[1], intensities=None)], ReflectorOptions(150.0))


def test_scans_with_nothing_in_them() -> None:
    nothing = LaserScan(0.0, np.full(181, np.inf), -np.pi / 2, np.pi / 180, 0.1, 30.0)
    strange = LaserScan(0.0, np.where(np.arange(181) % 2, np.nan, 5.0), -np.pi / 2, np.pi / 180, 0.1, 30.0)
    for scans in ([], [nothing], [strange], [nothing, nothing]):
        lines = find_lines(scans, LINES)
        assert len(find_corners(lines)) == 0
        assert len(find_circles(scans, CIRCLES)) == 0
        bright = [replace(scan, intensities=np.zeros(181)) for scan in scans]
        assert len(find_reflectors(bright, ReflectorOptions(1.0))) == 0
    assert len(find_lines([], LINES)) == 0


@pytest.mark.skipif(not LIDAR.exists(), reason="needs ../shared/data/lidar")
def test_lines_of_a_real_log_stand_still() -> None:
    """Walls seen from neighbouring poses of the reference are the same walls (their relation is good to 2 to 3 cm)."""
    log = open_log(LIDAR / "mit-csail.clf.bz2")
    stamps, reference = read_tum(LIDAR / "mit-csail.reference.tum")
    wanted = {float(stamp): pose for stamp, pose in zip(stamps, reference, strict=True)}
    scans = [m for m in log.measurements() if isinstance(m, LaserScan) and m.timestamp in wanted][:300]
    seven = np.stack([wanted[scan.timestamp] for scan in scans])
    poses = np.column_stack([seven[:, :2], 2 * np.arctan2(seven[:, 5], seven[:, 6])])
    lines = find_lines(scans)
    assert len(lines) > 3 * len(scans)
    pairs = []
    for number in range(len(scans) - 1):
        relative = se2.between(poses[number], poses[number + 1])
        a, b = np.flatnonzero(lines.scan == number), np.flatnonzero(lines.scan == number + 1)
        alpha = lines.parameters[b, 0] + relative[2]
        rho = lines.parameters[b, 1] + relative[0] * np.cos(alpha) + relative[1] * np.sin(alpha)
        angle = np.abs(wrap(lines.parameters[a, :1] - alpha))
        offset = np.abs(lines.parameters[a, 1:] - rho)
        near = (angle < 0.1) & (offset < 0.3)
        pairs.append(np.column_stack([angle[near], offset[near]]))
    found = np.concatenate(pairs)
    assert len(found) > 300
    assert np.median(found[:, 0]) < np.radians(0.7)
    assert np.median(found[:, 1]) < 0.03
