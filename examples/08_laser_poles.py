"""Poles in laser scans as landmarks: found in the scans, told apart without identity, mapped.

Expected: nearly every pole that was seen is in the map once, within 3 cm; the path is found within 3 cm of the truth
although odometry alone is off by metres.
"""

from pathlib import Path

import numpy as np

from clew.evaluate import align
from clew.geometry import se2
from clew.io import FeatureLog, Features, ReadReport
from clew.scan import CircleOptions, ReturnOptions, find_circles
from clew.sim import LaserModel, OdometryModel, World, drive, landmark_field, simulate, step_covariances
from clew.slam.landmarks import map_features
from clew.view import save_landmarks_png

# A yard with 45 poles, and a robot that drives round it twice; no walls, so that a scan matcher has little to go by.
poles = landmark_field(45, (36.0, 26.0), seed=8, spacing=2.5, identified=0.0).positions
radii = np.random.default_rng(8).uniform(0.12, 0.25, len(poles))
angles = 2.0 * np.pi * np.arange(33) / 32
outline = poles[:, None] + radii[:, None, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
walls = np.stack([outline[:, :-1], outline[:, 1:]], axis=2).reshape(-1, 2, 2)
world = World("yard", walls, poles, np.empty((0, 2), int))
corners = np.array([[6.0, 6.0], [30.0, 6.0], [30.0, 20.0], [18.0, 13.0], [6.0, 20.0]])
driven = drive(np.vstack([corners, corners, corners[:1]]), rate=1.0)
laser = LaserModel(beams=1081, field_of_view=np.radians(270.0), range_max=12.0, resolution=0.0)
noise = OdometryModel(sigma_distance=0.03, sigma_side=0.02, sigma_turn=0.05, sigma_drift=0.02)
log = simulate(world, driven, laser, noise, seed=8)

# Circles with their covariance, for all scans at once. The sensor's noise is 1 cm.
scans = [log.scan(index) for index in range(log.scan_count)]
circles = find_circles(scans, CircleOptions(returns=ReturnOptions(sigma_range=0.01)))
steps = se2.between(log.T_odom_robot[:-1], log.T_odom_robot[1:])
features = Features(circles.scan, circles.centres, np.linalg.inv(circles.covariances[:, :2, :2]))
recorded = FeatureLog(log.path, np.arange(log.scan_count), steps, np.linalg.inv(step_covariances(noise, steps)),
                      features, None, ReadReport())  # fmt: skip

found = map_features(recorded)
truth = log.T_world_robot
shift = align(truth[:, :2], found.T_world_robot[:, :2])
error = np.hypot(*(se2.act(shift, found.T_world_robot[:, :2]) - truth[:, :2]).T)
drift = np.hypot(*(se2.act(align(truth[:, :2], log.T_odom_robot[:, :2]), log.T_odom_robot[:, :2]) - truth[:, :2]).T)

# Which pole is which landmark, from the truth: to judge the map, not to make it.
offset = np.linalg.norm(se2.act(shift, found.position)[:, None] - poles, axis=2)
nearest, off = offset.argmin(axis=1), offset.min(axis=1)
seen = np.linalg.norm(se2.act(truth[circles.scan], circles.centres)[:, None] - poles, axis=2)
real = np.unique(seen.argmin(axis=1)[seen.min(axis=1) < 0.3])
print(f"{len(circles)} circles in {len(scans)} scans, of {len(real)} poles")
print(f"{len(found.identity)} landmarks, {len(np.unique(nearest[off < 0.3]))} of them poles, "
      f"rms {100 * np.sqrt(np.mean(off[off < 0.3] ** 2)):.1f} cm off")  # fmt: skip
print(f"path {np.sqrt(np.mean(error**2)):.3f} m off (odometry alone {np.sqrt(np.mean(drift**2)):.2f} m)")
save_landmarks_png(
    Path("08_laser_poles.png"),
    [("path", found.T_world_robot[:, :2]), ("odometry alone", found.T_odom_robot[:, :2])],
    found.position, found.covariance, None, "Poles in laser scans",
    f"{len(circles)} circles of {len(found.identity)} poles",
)  # fmt: skip
print("look at 08_laser_poles.png")
assert len(np.unique(nearest[off < 0.3])) >= 0.95 * len(real)
assert len(found.identity) <= 1.05 * len(real)
assert off.max() < 0.30
assert np.sqrt(np.mean(off**2)) < 0.03
assert np.sqrt(np.mean(error**2)) < 0.03 < 0.05 * np.sqrt(np.mean(drift**2))
