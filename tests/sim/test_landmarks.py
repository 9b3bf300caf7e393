"""Worlds of landmarks and fleets in them: determinism, and errors as the models say."""

from __future__ import annotations

import numpy as np
import pytest

from clew.errors import InputError
from clew.geometry import se2, wrap
from clew.sim import (
    ANONYMOUS,
    NO_LANDMARK,
    FleetModel,
    LandmarkWorld,
    MeetingModel,
    OdometryModel,
    RobotRun,
    SightingModel,
    landmark_field,
    simulate_fleet,
    step_covariances,
)

MODEL = FleetModel(
    sightings=SightingModel(missed=0.2, false=0.3, misread=0.1),
    meetings=MeetingModel(range_max=10.0),
    duration=400.0,
)


@pytest.fixture(scope="module")
def world() -> LandmarkWorld:
    return landmark_field(50, (30.0, 20.0), seed=3, identified=0.6)


@pytest.fixture(scope="module")
def runs(world: LandmarkWorld) -> list[RobotRun]:
    return simulate_fleet(world, 3, seed=4, model=MODEL)


def test_field_keeps_its_promises(world: LandmarkWorld) -> None:
    apart = np.hypot(*np.moveaxis(world.positions[:, None] - world.positions, 2, 0)) + 9 * np.eye(50)
    assert apart.min() >= 1.0
    assert (world.positions >= 0).all()
    assert (world.positions <= world.size).all()
    named = world.identities[world.identities != ANONYMOUS]
    assert len(named) == len(set(named.tolist())) == 30


def test_same_seed_same_bytes(world: LandmarkWorld) -> None:
    first, again = (simulate_fleet(world, 2, seed=7, model=MODEL) for _ in range(2))
    other = simulate_fleet(world, 2, seed=8, model=MODEL)
    for a, b in zip(first, again, strict=True):
        assert a.increments.tobytes() == b.increments.tobytes()
        assert a.sightings.ranges.tobytes() == b.sightings.ranges.tobytes()
        assert a.meetings.headings.tobytes() == b.meetings.headings.tobytes()
    assert first[0].increments.tobytes() != other[0].increments.tobytes()


def test_robots_have_streams_of_their_own(runs: list[RobotRun]) -> None:
    assert not np.array_equal(runs[0].T_world_robot[:20], runs[1].T_world_robot[:20])


def test_odometry_errors_have_the_covariance_told(runs: list[RobotRun]) -> None:
    nees = []
    for run in runs:
        true = se2.between(run.T_world_robot[:-1], run.T_world_robot[1:])
        error = se2.local(run.increments, true)
        nees.append(np.einsum("ni,nij,nj->n", error, np.linalg.inv(run.covariances), error))
    # The floor of the covariance makes standing still look worse than it is.
    moving = np.concatenate(nees)[np.concatenate([np.hypot(*r.increments[:, :2].T) for r in runs]) > 0.3]
    assert len(moving) > 300
    assert 2.5 < moving.mean() < 3.3


def test_covariance_of_steps_that_turn() -> None:
    model = OdometryModel(sigma_distance=0.05, sigma_side=0.005, sigma_turn=0.01)
    true = np.broadcast_to([1.0, 0.2, 0.9], (20_000, 3))
    reported = model.perturb(true, np.random.default_rng(2))
    sampled = np.cov(se2.local(reported, true).T)
    told = step_covariances(model, true[:1], floor=0.0)[0]
    np.testing.assert_allclose(sampled, told, atol=0.05 * np.sqrt(np.outer(np.diag(told), np.diag(told))).max())


def test_sightings_have_the_noise_told(world: LandmarkWorld, runs: list[RobotRun]) -> None:
    for run in runs:
        s = run.sightings
        real = s.landmarks != NO_LANDMARK
        seen = se2.act(se2.inverse(run.T_world_robot[s.poses[real]]), world.positions[s.landmarks[real]])
        ranges = (s.ranges[real] - np.hypot(*seen.T)) / MODEL.sightings.sigma_range
        bearings = wrap(s.bearings[real] - np.arctan2(seen[:, 1], seen[:, 0])) / MODEL.sightings.sigma_bearing
        for normal in (ranges, bearings):
            assert abs(normal.mean()) < 4 / np.sqrt(len(normal))
            assert abs(normal.std() - 1) < 4 / np.sqrt(2 * len(normal))


def test_missed_false_and_misread(world: LandmarkWorld, runs: list[RobotRun]) -> None:
    poses = np.concatenate([run.T_world_robot for run in runs])
    local = se2.act(se2.inverse(poses)[:, None], world.positions)
    in_reach = (np.hypot(local[..., 0], local[..., 1]) < MODEL.sightings.range_max).sum()
    landmarks = np.concatenate([run.sightings.landmarks for run in runs])
    identities = np.concatenate([run.sightings.identities for run in runs])
    real = landmarks != NO_LANDMARK
    assert real.sum() / in_reach == pytest.approx(0.8, abs=0.03)
    assert (~real).sum() / len(poses) == pytest.approx(0.3, abs=0.06)
    assert (identities[~real] == ANONYMOUS).all()
    carries = real & (world.identities[landmarks] != ANONYMOUS)
    assert (identities[real & ~carries] == ANONYMOUS).all()
    wrong = identities[carries] != world.identities[landmarks[carries]]
    assert wrong.mean() == pytest.approx(0.1, abs=0.03)
    assert np.isin(identities[carries], world.identities).all()


def test_meetings_tell_where_the_other_is(runs: list[RobotRun]) -> None:
    for robot, run in enumerate(runs):
        met = run.meetings
        assert len(met.poses) > 10
        assert (met.others != robot).all()
        others = np.stack([runs[o].T_world_robot[p] for o, p in zip(met.others, met.other_poses, strict=True)])
        true = se2.between(run.T_world_robot[met.poses], others)
        np.testing.assert_allclose(met.ranges, np.hypot(*true[:, :2].T), atol=5 * MODEL.meetings.sigma_range)
        assert np.abs(wrap(met.bearings - np.arctan2(true[:, 1], true[:, 0]))).max() < 5 * MODEL.meetings.sigma_bearing
        assert np.abs(wrap(met.headings - true[:, 2])).max() < 5 * MODEL.meetings.sigma_heading


def test_bad_requests() -> None:
    with pytest.raises(InputError, match="do not fit"):
        landmark_field(100, (5.0, 5.0), seed=0)
    with pytest.raises(InputError, match="probabilities"):
        SightingModel(missed=1.5)
    with pytest.raises(InputError, match="one a robot"):
        simulate_fleet(landmark_field(5, (9.0, 9.0), seed=0), 2, seed=0, areas=[(0, 0, 9, 9)])
