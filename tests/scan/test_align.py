"""Alignment: one linearisation against numeric derivatives, known motions, honest information."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from clew.geometry import se2
from clew.scan import (
    Alignment,
    AlignmentOptions,
    ScanPoints,
    SourceClouds,
    align,
    concatenate,
    index_cloud,
    join,
    merge_surfels,
    slope_share,
    with_new_partners,
)
from clew.sim.world import pillar
from scan import twins
from scan.clouds import CORRIDOR, EMPTY, ROOM, cloud_of, random_cloud

Array = NDArray[np.float64]
ONE = np.zeros((1, 2), dtype=np.int32)


def single(target: ScanPoints, source: ScanPoints, start: Array, **others: object) -> Alignment:
    return align(index_cloud(target), SourceClouds.single(source), ONE, start[None], **others)  # type: ignore[arg-type]  # tests pass options by name


def cost_and_normal_equations(target: ScanPoints, source: ScanPoints, pose: Array,
                              o: AlignmentOptions) -> tuple[Array, Array, float, float]:
    """Hessian and gradient of the reweighted cost by numeric Jacobians; overlap and rms."""
    partner = twins.partners(target, source, pose, o.radius_end, o.facing)
    found = np.flatnonzero(partner >= 0)
    part = ScanPoints(*(getattr(source, name)[found] for name in ("points", "normals", "along", "weights")))
    partner = partner[found]

    def stacked(delta: Array) -> Array:
        return np.concatenate(twins.residuals(target, part, se2.retract(pose, delta), partner))

    e, step = stacked(np.zeros(3)), 1e-6
    jacobian = np.stack([(stacked(step * d) - stacked(-step * d)) / (2 * step) for d in np.eye(3)], axis=1)
    robust = 1 / (1 + e**2 / (o.robust * o.sigma) ** 2)
    weights = np.concatenate([part.weights, part.weights * target.along[partner]]) * robust
    hessian = jacobian.T @ (weights[:, None] * jacobian) / o.sigma**2
    gradient = jacobian.T @ (weights * e) / o.sigma**2
    across = weights[: len(found)]
    rms = np.sqrt(across @ e[: len(found)] ** 2 / across.sum()) if len(found) else 0.0
    return hessian, gradient, len(found) / max(len(source), 1), float(rms)


@pytest.mark.parametrize("seed", range(8))
def test_information_and_step_are_those_of_the_linearised_cost(seed: int) -> None:
    rng = np.random.default_rng(seed)
    target, source = random_cloud(rng, 150), random_cloud(rng, 80)
    options = AlignmentOptions(radius_start=0.5, radius_end=0.5, sigma=0.1, iterations=3)
    out = single(target, source, rng.uniform(-0.5, 0.5, 3), options=options)
    hessian, gradient, overlap, rms = cost_and_normal_equations(target, source, out.T_target_source[0], options)
    np.testing.assert_allclose(out.information[0], hessian, rtol=1e-6, atol=1e-6 * np.abs(hessian).max())
    np.testing.assert_allclose(out.step[0], -np.linalg.solve(hessian, gradient), rtol=1e-5, atol=1e-7)
    assert out.overlap[0] == overlap > 0.1
    assert out.rms[0] == pytest.approx(rms)


@pytest.mark.parametrize("seed", range(6))
def test_the_push_of_the_residuals_is_that_of_its_definition(seed: int) -> None:
    """Against plain sums over pairs of returns; the first one too far from a return ends its neighbours."""
    rng = np.random.default_rng(seed)
    target, source = random_cloud(rng, 150), random_cloud(rng, 60)
    o = AlignmentOptions(radius_start=0.5, radius_end=0.5, sigma=0.1, iterations=3, correlated=2.0)
    out = single(target, source, rng.uniform(-0.5, 0.5, 3), options=o)
    pose = out.T_target_source[0]
    partner = twins.partners(target, source, pose, o.radius_end, o.facing)
    found = np.flatnonzero(partner >= 0)
    part = ScanPoints(*(getattr(source, name)[found] for name in ("points", "normals", "along", "weights")))
    across, step = len(found), 1e-6

    def residual(delta: Array) -> Array:
        return twins.residuals(target, part, se2.retract(pose, delta), partner[found])[0]

    e = residual(np.zeros(3))
    jacobian = np.stack([(residual(step * d) - residual(-step * d)) / (2 * step) for d in np.eye(3)], axis=1)
    weights = part.weights / (1 + e**2 / (o.robust * o.sigma) ** 2)
    near = np.eye(across)
    for i in range(across):
        distances = np.hypot(*(source.points[found[i] :] - source.points[found[i]]).T)
        apart = np.hypot(*(part.points - part.points[i]).T)
        ends = np.flatnonzero(distances >= o.correlated)
        last = int(np.searchsorted(found, found[i] + ends[0])) if len(ends) else across
        near[i, i + 1 : last] = near[i + 1 : last, i] = 1 - apart[i + 1 : last] / o.correlated
    score = weights * e
    parts = score[:, None] * jacobian / o.sigma**2
    np.testing.assert_allclose(out.push[0], parts.T @ near @ parts, rtol=1e-5, atol=1e-6 * np.abs(out.push[0]).max())
    spread = (weights[:, None] * jacobian / o.sigma**2).T @ (weights[:, None] * jacobian / o.sigma**2)
    np.testing.assert_allclose(out.spread[0], spread, rtol=1e-5, atol=1e-6 * np.abs(spread).max())
    together = max(score @ near @ score, 0.0)
    assert out.correlation[0] == pytest.approx(together / (score @ score))
    assert out.variance[0] == pytest.approx(together / (weights @ weights))


def noisy_room(noise: Array) -> Alignment:
    """A room in front of an exact map, its returns moved along their normals by `noise`, aligned where it is."""
    seen = cloud_of(ROOM, np.zeros(3))
    moved = ScanPoints(seen.points + noise[: len(seen), None] * seen.normals, seen.normals, seen.along, seen.weights)
    return single(seen, moved, np.zeros(3), options=AlignmentOptions(sigma=0.02))


def test_what_neighbours_have_in_common_is_found() -> None:
    rng = np.random.default_rng(1)
    white = [noisy_room(0.01 * rng.standard_normal(1000)) for _ in range(30)]
    assert np.mean([o.correlation[0] for o in white]) == pytest.approx(1.0, abs=0.15)
    assert np.sqrt(np.mean([o.variance[0] for o in white])) == pytest.approx(0.01, rel=0.15)
    rough = [noisy_room(0.01 * np.repeat(rng.standard_normal(250), 4)) for _ in range(30)]
    assert np.mean([o.correlation[0] for o in rough]) > 2.0


@pytest.mark.parametrize("width", [1, 2])
def test_information_with_the_push_is_that_of_the_errors(width: int) -> None:
    """Independent or not, poses scatter as the sandwich of slope and push says."""
    rng = np.random.default_rng(2)
    found = [noisy_room(0.004 * np.repeat(rng.standard_normal(1000), width)) for _ in range(200)]
    error = np.array([o.T_target_source[0] for o in found])
    inverse = np.linalg.inv(found[0].information[0])
    stated = inverse @ np.mean([o.push[0] for o in found], axis=0) @ inverse
    scatter = error.T @ error / len(error)
    ratio = np.diag(scatter) / np.diag(stated)  # 1.8 where neighbours were taken as independent
    assert 0.65 < ratio.min() < ratio.max() < 1.5


def test_a_target_as_thick_as_its_noise_resists_less() -> None:
    shares = []
    for sigma in (0.002, 0.03):
        clouds = [cloud_of(ROOM, np.zeros(3), sigma=sigma, seed=k) for k in range(8)]
        target = index_cloud(merge_surfels(concatenate(clouds), 0.05))
        source = SourceClouds.single(cloud_of(ROOM, np.zeros(3), sigma=sigma, seed=99))
        options = AlignmentOptions(sigma=max(0.015, sigma))
        found = align(target, source, ONE, np.zeros((1, 3)), options=options)
        shares.append(slope_share(target, source, ONE, found.T_target_source, found.information, options)[0])
    assert 0.6 < shares[0] < 1.0
    assert 0.2 < shares[1] < 0.7 * shares[0]


@pytest.mark.parametrize("seed", range(10))
def test_recovers_known_motions_to_millimetres(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = np.array([*rng.uniform(-0.25, 0.25, 2), rng.uniform(-0.12, 0.12)])
    target, source = cloud_of(ROOM, np.zeros(3), sigma=0.01, seed=seed), cloud_of(ROOM, truth, sigma=0.01, seed=99)
    out = single(target, source, np.zeros(3))
    error = se2.between(truth, out.T_target_source[0])
    assert np.hypot(error[0], error[1]) < 0.004
    assert abs(error[2]) < 0.001
    assert out.overlap[0] > 0.9
    assert 0.003 < out.rms[0] < 0.02
    assert np.abs(out.step[0]).max() < 1e-3


def test_without_noise_the_optimum_is_exact_on_plane_walls() -> None:
    square = np.array([[[-3.0, -2.0], [3.0, -2.0]], [[3.0, -2.0], [3.0, 2.0]], [[3.0, 2.0], [-3.0, 2.0]],
                       [[-3.0, 2.0], [-3.0, -2.0]]])
    truth = np.array([0.11, -0.07, 0.05])
    out = single(cloud_of(square, np.zeros(3)), cloud_of(square, truth), np.zeros(3))
    np.testing.assert_allclose(out.T_target_source[0], truth, atol=2e-4)


def test_corridor_is_weak_along_its_axis_and_strong_across() -> None:
    at = np.array([0.0, 0.2, 0.3])
    target, source = cloud_of(CORRIDOR, at, sigma=0.01), cloud_of(CORRIDOR, at, sigma=0.01, seed=5)
    out = single(target, source, np.zeros(3))
    along = np.array([np.cos(-0.3), np.sin(-0.3)])
    across = np.array([-along[1], along[0]])
    translation = out.information[0, :2, :2]
    assert along @ translation @ along < 0.01 * (across @ translation @ across)
    # and the estimate goes nowhere along the axis, where a prior alone decides
    prior = np.diag([1e4, 1e4, 1e4])[None]
    held = single(target, source, np.zeros(3), T_prior=np.array([[*0.05 * along, 0.0]]), prior_information=prior)
    assert held.T_target_source[0, :2] @ along == pytest.approx(0.05, abs=0.02)
    assert held.T_target_source[0, :2] @ across == pytest.approx(0.0, abs=0.003)


def test_prior_alone_decides_where_nothing_overlaps() -> None:
    far, near = cloud_of(ROOM, np.zeros(3)).transformed(np.array([500.0, 0.0, 0.0])), cloud_of(ROOM, np.zeros(3))
    prior = np.array([0.02, -0.03, 0.01])
    out = single(far, near, np.zeros(3), T_prior=prior[None], prior_information=np.diag([4.0, 9.0, 1.0])[None])
    np.testing.assert_allclose(out.T_target_source[0], prior, atol=1e-6)
    assert out.overlap[0] == out.rms[0] == 0.0
    assert not out.information.any()
    free = single(far, near, np.array([0.1, 0.2, 0.3]))
    np.testing.assert_array_equal(free.T_target_source[0], [0.1, 0.2, 0.3])


def test_prior_and_returns_are_weighed_by_their_information() -> None:
    truth = np.array([0.05, -0.03, 0.02])
    target, source = cloud_of(ROOM, np.zeros(3)), cloud_of(ROOM, truth)
    data = single(target, source, np.zeros(3))
    prior, information = truth + np.array([0.02, 0.02, 0.01]), 0.5 * data.information[0]
    out = single(target, source, np.zeros(3), T_prior=prior[None], prior_information=information[None])
    # at the optimum the pull of both is in balance: the step that the returns ask for, against the prior's residual
    pose = out.T_target_source[0]
    pull = out.information[0] @ out.step[0]
    residual, (_, jacobian) = se2.local(prior, pose), se2.local_jacobians(prior, pose)
    np.testing.assert_allclose(pull, jacobian.T @ information @ residual, rtol=1e-3, atol=1.0)
    assert np.linalg.norm(pull) > 100.0


@pytest.mark.parametrize("target", [EMPTY, random_cloud(np.random.default_rng(0), 1)])
@pytest.mark.parametrize("source", [EMPTY, random_cloud(np.random.default_rng(0), 1)])
def test_hardly_any_points(target: ScanPoints, source: ScanPoints) -> None:
    start = np.array([0.01, 0.0, 0.02])
    out = single(target, source, start)
    assert all(np.isfinite(a).all() for a in (out.T_target_source, out.information, out.step, out.overlap, out.rms))
    if not (len(target) and len(source)):
        np.testing.assert_array_equal(out.T_target_source[0], start)
        assert out.overlap[0] == 0.0


def test_batch_is_its_pairs_whatever_the_threads() -> None:
    rng = np.random.default_rng(1)
    poses = np.column_stack([rng.uniform(-0.2, 0.2, (6, 2)), rng.uniform(-0.1, 0.1, 6)])
    clouds = [cloud_of(ROOM, pose, sigma=0.01, seed=i) for i, pose in enumerate(poses)]
    clouds[3] = EMPTY
    indexed = join([index_cloud(c) for c in clouds])
    pairs = np.array([(a, b) for a in range(6) for b in range(6)], dtype=np.int32)
    start = np.zeros((36, 3))
    one, *others = (align(indexed, indexed.as_sources(), pairs, start, threads=threads) for threads in (1, 2, 5, 64))
    for other in others:
        np.testing.assert_array_equal(other.T_target_source, one.T_target_source)
        np.testing.assert_array_equal(other.information, one.information)
    for row in (0, 8, 19, 35):
        alone = single(clouds[pairs[row, 0]], clouds[pairs[row, 1]], np.zeros(3))
        np.testing.assert_array_equal(alone.T_target_source[0], one.T_target_source[row])
        assert alone.overlap[0] == one.overlap[row]
    assert len(align(indexed, indexed.as_sources(), pairs[:0], start[:0]).rms) == 0


def test_normals_keep_the_two_sides_of_a_wall_apart() -> None:
    seen = cloud_of(np.array([[[1.0, -3.0], [1.0, 3.0]], [[-2.0, -3.0], [-2.0, 3.0]]]), np.zeros(3))
    behind = ScanPoints(seen.points, -seen.normals, seen.along, seen.weights)
    assert single(seen, seen, np.zeros(3)).overlap[0] == 1.0
    assert single(seen, behind, np.zeros(3)).overlap[0] == 0.0


@pytest.mark.parametrize("people", [2, 5])
def test_a_scan_full_of_people_weighs_less(people: int) -> None:
    """They have no partner in the map: what is left of the scan decides, and the information says how much that is."""
    truth = np.array([0.3, -0.2, 0.4])
    target = cloud_of(ROOM, np.zeros(3), sigma=0.005)
    around = 2 * np.pi * np.arange(people) / people
    crowd = [pillar(truth[0] + 1.2 * np.cos(a), truth[1] + 1.2 * np.sin(a), 0.25, 24) for a in around]
    alone, crowded = (single(target, cloud_of(world, truth, sigma=0.005, seed=1), truth)
                      for world in (ROOM, np.concatenate([ROOM, *crowd])))
    hidden = people * 2 * np.arcsin(0.25 / 1.2) / (2 * np.pi)  # share of the view
    ratio = np.linalg.det(crowded.information[0]) / np.linalg.det(alone.information[0])
    assert ratio < (1 - 0.5 * hidden) ** 3
    off = se2.between(truth, crowded.T_target_source[0])
    assert np.hypot(off[0], off[1]) < 0.01
    assert abs(off[2]) < 0.004


def information_along(walls: Array, smear: float) -> tuple[float, float]:
    """What an alignment with a map smeared along the corridor seems to tell of the way along it, and what is left."""
    shifts = np.linspace(-smear, smear, 9)
    clouds = [cloud_of(walls, np.zeros(3), sigma=0.01, seed=k).transformed(np.array([shift, 0.0, 0.0]))
              for k, shift in enumerate(shifts)]
    target = index_cloud(merge_surfels(concatenate(clouds), 0.05))
    source, options = SourceClouds.single(cloud_of(walls, np.zeros(3), sigma=0.01, seed=99)), AlignmentOptions()
    found = align(target, source, ONE, np.zeros((1, 3)), options=options)
    left = with_new_partners(target, source, ONE, found.T_target_source, found.information, options)[0]
    assert np.linalg.eigvalsh(left).min() > 0
    assert np.all(np.diag(left) <= np.diag(found.information[0]) * (1 + 1e-9))
    np.testing.assert_allclose(left[1, 1], found.information[0, 1, 1], rtol=1e-2)
    return float(found.information[0, 0, 0]), float(left[0, 0])


def test_edges_smeared_along_a_corridor_tell_little_of_the_way_along_it() -> None:
    edges = np.array([[[2.0, -1.2], [2.0, -1.0]], [[2.0, -1.0], [2.4, -1.0]], [[2.4, -1.0], [2.4, -1.2]],
                      [[-3.0, 1.2], [-3.0, 1.05]], [[-3.0, 1.05], [-2.5, 1.05]], [[-2.5, 1.05], [-2.5, 1.2]]])
    seemed, left = information_along(np.concatenate([CORRIDOR, edges]), 0.15)
    assert left < 0.2 * seemed


def test_a_wall_across_a_corridor_is_still_told_by() -> None:
    seemed, left = information_along(np.concatenate([CORRIDOR, [[[4.0, -1.2], [4.0, 1.2]]]]), 0.0)
    assert left > 0.1 * seemed
    assert 1.0 / np.sqrt(left) < 0.01


def test_information_in_a_room_stays_as_it_is() -> None:
    target, source = index_cloud(cloud_of(ROOM, np.zeros(3))), SourceClouds.single(cloud_of(ROOM, np.zeros(3)))
    found = align(target, source, ONE, np.zeros((1, 3)))
    left = with_new_partners(target, source, ONE, np.zeros((1, 3)), found.information, AlignmentOptions())[0]
    np.testing.assert_array_equal(left, found.information[0])
