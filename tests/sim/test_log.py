"""Simulated logs: determinism, noise as modelled, the form of a log, CARMEN files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from clew.errors import InputError
from clew.geometry import se2
from clew.io import open_log
from clew.motion import Odometry
from clew.scan import LaserScan
from clew.sim import (
    KINDS,
    Drive,
    LaserModel,
    OdometryModel,
    SimulatedLog,
    cast_rays,
    office_building,
    simulate,
    simulate_demo,
    simulate_kind,
    write_carmen,
)


def small_log(seed: int = 1, **options: int) -> SimulatedLog:
    return simulate_demo(seed, duration=10.0, **options)


@pytest.mark.parametrize("kind", KINDS)
def test_same_seed_same_bytes(kind: str) -> None:
    logs = [simulate_kind(kind, seed, duration=6.0, people=2) for seed in (5, 5, 6)]
    for name in ("timestamps", "T_world_robot", "T_odom_robot", "ranges", "moving"):
        arrays = [getattr(log, name) for log in logs]
        assert arrays[0].tobytes() == arrays[1].tobytes(), name
    assert logs[0].ranges.tobytes() != logs[2].ranges.tobytes()


def test_noise_has_streams_of_its_own() -> None:
    plain, crowded = small_log(), small_log(people=5)
    np.testing.assert_array_equal(plain.T_odom_robot, crowded.T_odom_robot)
    same = ~crowded.moving
    np.testing.assert_array_equal(plain.ranges[same], crowded.ranges[same])


def test_odometry_comes_right_before_its_scan() -> None:
    log = small_log()
    stream = list(log.measurements())
    assert len(stream) == 2 * log.scan_count == 2 * 51
    for index, (odometry, scan) in enumerate(zip(stream[::2], stream[1::2], strict=True)):
        assert isinstance(odometry, Odometry)
        assert isinstance(scan, LaserScan)
        assert odometry.timestamp == scan.timestamp == log.timestamps[index]
        assert scan.ranges is not None
        np.testing.assert_array_equal(scan.ranges, log.ranges[index])
        np.testing.assert_array_equal(scan.angles, log.laser.angles)
    assert log.duration == pytest.approx(10.0)
    assert log.has_odometry
    assert log.report.used == {"scan": 51, "odometry": 51}


def test_demo_dead_reckoning_fails_by_metres() -> None:
    log = simulate_demo()
    assert log.scan_count == 2001
    reckoned = se2.compose(log.T_world_robot[0], log.T_odom_robot)
    assert 3.0 < np.linalg.norm(reckoned[-1, :2] - log.T_world_robot[-1, :2]) < 30.0


def test_ranges_have_the_noise_of_the_model() -> None:
    log = small_log()
    truth = cast_rays(log.world.segments, se2.compose(log.T_world_robot, np.array(log.laser.T_robot_sensor)),
                      log.laser.angles)
    seen = np.isfinite(log.ranges)
    errors = (log.ranges - truth)[seen]
    expected = np.hypot(log.laser.sigma_range, log.laser.resolution / np.sqrt(12))
    assert errors.std() == pytest.approx(expected, rel=0.05)
    assert abs(errors.mean()) < 5 * expected / np.sqrt(errors.size)
    np.testing.assert_allclose(log.ranges[seen] / 0.01, np.round(log.ranges[seen] / 0.01), atol=1e-6)
    assert not seen[truth > log.laser.range_max + 0.1].any()


def test_laser_reports_nothing_outside_of_its_reach() -> None:
    laser = LaserModel(range_min=0.5, range_max=8.0, dropout=0.0, sigma_range=0.0)
    ranges = laser.measure(np.array([0.2, 0.5, 7.99, 8.0, 9.0, np.inf]), np.random.default_rng(1))
    np.testing.assert_array_equal(np.isfinite(ranges), [False, True, True, False, False, False])


def test_beams_drop_out_as_often_as_the_model_says() -> None:
    ranges = LaserModel(dropout=0.02).measure(np.full(500_000, 5.0), np.random.default_rng(1))
    assert np.isinf(ranges).mean() == pytest.approx(0.02, rel=0.05)


def test_odometry_without_errors_is_the_truth() -> None:
    driven = Drive(small_log().timestamps, small_log().T_world_robot)
    log = simulate(office_building(1), driven, LaserModel(), OdometryModel(), 1)
    reckoned = se2.compose(log.T_world_robot[0], log.T_odom_robot)
    np.testing.assert_allclose(reckoned, log.T_world_robot, atol=1e-9)


@pytest.mark.parametrize("model", [OdometryModel.good(), OdometryModel.medium(), OdometryModel.bad()])
def test_odometry_errors_follow_the_model(model: OdometryModel) -> None:
    count, step = 200_000, np.array([0.4, 0.0, -0.3])
    errors = model.perturb(np.tile(step, (count, 1)), np.random.default_rng(1)) - step
    sigma = np.array([model.sigma_distance * np.sqrt(0.4), model.sigma_side * np.sqrt(0.4),
                      np.sqrt(model.sigma_turn ** 2 * 0.3 + model.sigma_drift ** 2 * 0.4)])
    bias = np.array([0.4 * model.scale_bias, 0.0, -0.3 * model.turn_bias + 0.4 * model.drift_bias])
    np.testing.assert_allclose(errors.std(axis=0), sigma, rtol=0.01)
    np.testing.assert_allclose(errors.mean(axis=0), bias, atol=5 * sigma.max() / np.sqrt(count))


def test_odometry_noise_does_not_depend_on_the_rate() -> None:
    """1,000 drives of 4 m straight on, in 4 and in 40 steps: the same spread of the last heading."""
    spreads = []
    for steps in (4, 40):
        line = np.column_stack([np.linspace(0, 4, steps + 1), np.zeros((steps + 1, 2))])
        rng = np.random.default_rng(1)
        spreads.append(np.std([OdometryModel.medium().reckon(line, rng)[-1, 2] for _ in range(1000)]))
    assert spreads[0] == pytest.approx(spreads[1], rel=0.1)
    assert spreads[0] == pytest.approx(OdometryModel.medium().sigma_drift * 2, rel=0.1)


def test_people_are_seen_and_labelled() -> None:
    empty, crowded = simulate_demo(2, duration=60.0), simulate_demo(2, duration=60.0, people=12)
    assert not empty.moving.any()
    assert 0.0005 < crowded.moving.mean() < 0.2
    both = crowded.moving & np.isfinite(empty.ranges)
    assert (crowded.ranges[both] < empty.ranges[both] + 0.02).all()


def test_carmen_file_is_read_back(tmp_path: Path) -> None:
    log = small_log()
    path = tmp_path / "demo.log"
    write_carmen(log, path)
    stream = list(open_log(path).measurements())
    scans = [m for m in stream if isinstance(m, LaserScan)]
    odometry = [m for m in stream if isinstance(m, Odometry)]
    np.testing.assert_allclose([s.timestamp for s in scans], log.timestamps, atol=1e-6)
    np.testing.assert_allclose([s.ranges for s in scans], log.ranges, atol=1e-9)
    np.testing.assert_allclose([o.T_odom_robot for o in odometry], log.T_odom_robot, atol=1e-6)
    np.testing.assert_allclose(scans[0].angles, log.laser.angles, atol=1e-9)
    np.testing.assert_allclose(scans[0].T_robot_sensor, log.laser.T_robot_sensor, atol=1e-5)
    assert [p.name for p in tmp_path.iterdir()] == ["demo.log"]


def test_carmen_refuses_what_it_cannot_describe(tmp_path: Path) -> None:
    wide = simulate_kind("hall", 1, duration=2.0, laser=LaserModel(field_of_view=4.0))
    with pytest.raises(InputError, match="180 degrees"):
        write_carmen(wide, tmp_path / "wide.log")
    with pytest.raises(InputError, match="does not exist"):
        write_carmen(small_log(), tmp_path / "nowhere" / "demo.log")


@pytest.mark.parametrize("options", [
    {"beams": 1}, {"field_of_view": 7.0}, {"range_min": 9.0, "range_max": 8.0}, {"sigma_range": -1.0},
    {"dropout": 2.0},
])
def test_impossible_lasers_are_refused(options: dict[str, float]) -> None:
    with pytest.raises(InputError, match="LaserModel"):
        LaserModel(**options)  # type: ignore[arg-type]  # values of the wrong kind do not occur


def test_unknown_kind_is_refused() -> None:
    with pytest.raises(InputError, match="office, corridor, hall, loop"):
        simulate_kind("maze", 1)
