"""Drives with features in simulated worlds: identities found or given, and a noise that the log tells wrongly."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from clew.errors import InputError
from clew.evaluate import align
from clew.geometry import Point2, se2
from clew.io import FeatureLog, Features, ReadReport
from clew.sim import FleetModel, RobotRun, SightingModel, landmark_field, simulate_fleet
from clew.slam.landmarks import map_features

CLAIM = 16.0  # times that the log makes variances larger than they are


def simulate(seed: int, claim: float = 1.0, false: float = 0.05) -> tuple[RobotRun, FeatureLog]:
    model = FleetModel(duration=240.0, sightings=SightingModel(false=false, missed=0.2))
    world = landmark_field(30, (30.0, 24.0), seed=seed, spacing=2.0, identified=0.0)
    (run,) = simulate_fleet(world, 1, seed=seed, model=model)
    seen, sensor = run.sightings, model.sightings
    z = np.stack([seen.ranges * np.cos(seen.bearings), seen.ranges * np.sin(seen.bearings)], axis=1)
    ray = z / seen.ranges[:, None]
    across = np.stack([-ray[:, 1], ray[:, 0]], axis=1)
    spread = sensor.sigma_range**2 * ray[:, :, None] * ray[:, None]
    spread += ((sensor.sigma_bearing * seen.ranges) ** 2)[:, None, None] * across[:, :, None] * across[:, None]
    features = Features(seen.poses, z, np.linalg.inv(claim * spread))
    keys = np.arange(len(run.T_world_robot))
    information = np.linalg.inv(claim * run.covariances)
    log = FeatureLog(Path("simulated"), keys, run.increments, information, features, seen.landmarks, ReadReport())
    return run, log


def position_error(run: RobotRun, T_world_robot: np.ndarray) -> float:
    true = run.T_world_robot[:, :2]
    moved = se2.act(align(true, T_world_robot[:, :2]), T_world_robot[:, :2])
    return float(np.sqrt(np.mean(np.sum((moved - true) ** 2, axis=1))))


@pytest.mark.parametrize("claim", [1.0, CLAIM])
def test_landmarks_are_told_apart_and_false_ones_found_out(claim: float) -> None:
    run, log = simulate(4, claim)
    found = map_features(log, identities=False)
    truth, mine = run.sightings.landmarks, found.landmark
    for number in found.identity:
        of = truth[(mine == number) & (truth >= 0)]
        assert len(np.unique(of)) <= 1  # never two landmarks in one
    real = np.unique(truth[truth >= 0])
    assert np.mean([len(np.unique(mine[truth == number])) for number in real]) < 1.1  # hardly one in two
    assert np.mean(mine[truth >= 0] >= 0) > 0.98
    assert np.mean(mine[truth < 0] < 0) > 0.6
    assert abs(len(found.identity) - len(real)) <= 2
    assert position_error(run, found.T_world_robot) < 0.2 * position_error(run, found.T_odom_robot)
    assert found.components is not None
    assert found.components.sightings * claim == pytest.approx(1.0, rel=0.25)
    assert found.unit_variance * claim == pytest.approx(1.0, rel=0.25)


def test_given_identities() -> None:
    run, log = simulate(4)
    found = map_features(log)
    assert found.components is None
    real = np.unique(log.identity[log.identity >= 0])  # type: ignore[index]
    np.testing.assert_array_equal(found.identity, real)
    assert found.sightings.sum() == np.sum(run.sightings.landmarks >= 0)
    world = landmark_field(30, (30.0, 24.0), seed=4, spacing=2.0, identified=0.0).positions[real]
    off = se2.act(align(world, found.position), found.position) - world
    assert np.hypot(*off.T).max() < 0.15
    assert len(found.graph.keys(Point2)) == len(real)
    assert position_error(run, found.T_world_robot) < 0.05


def test_nothing_to_map() -> None:
    _, log = simulate(4)
    empty = Features(np.empty(0, np.int64), np.empty((0, 2)), np.empty((0, 2, 2)))
    with pytest.raises(InputError, match="no features"):
        map_features(replace(log, features=empty, identity=None))
    with pytest.raises(InputError, match="has an identity"):
        map_features(replace(log, identity=np.full(len(log.features.keys), -1)))
