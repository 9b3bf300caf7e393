"""A gyro takes over the rotation; its bias and scale are estimated in the graph, with the trajectory.

The wheels slip in turns, so their turn rate is of little use; the gyro is quiet but has a bias of more than one degree
a second and a scale that is 2 % off. Readings come 100 times a second, keyframes each half second. Expected: bias and
scale are found within three of their own standard deviations, and the trajectory is better than that of the wheels.
"""

import numpy as np

import clew
from clew.evaluate import align
from clew.factors import PreintegratedMotion
from clew.geometry import se2
from clew.motion import Gyro, VelocityNoise, cut, preintegrate, velocity_motion

rng = np.random.default_rng(3)
BIAS, SCALE = 0.02, 0.02  # rad/s, share
stamps = np.arange(0.0, 120.0, 0.01)
speed, rate = np.full(len(stamps), 0.6), 0.5 * np.sin(0.35 * stamps)
frames = np.arange(0.0, 119.6, 0.5)
wheels = VelocityNoise(0.02, 0.01, 0.02, 0.15, 0.001, 0.001)

# the truth, and what the sensors make of it
pieces = cut(stamps, frames)
held = pieces.reading
steps = preintegrate(velocity_motion(pieces.duration, speed[held], rate[held]).increment, pieces.first).motion
truth = np.zeros((len(frames), 3))
for k, step in enumerate(steps):
    truth[k + 1] = se2.compose(truth[k], step)
gyro = Gyro(density=0.002, wheels=wheels)
measured_rate = (1.0 + SCALE) * rate + BIAS + gyro.density / np.sqrt(0.01) * rng.standard_normal(len(stamps))
measured_speed = speed + wheels.along_per_metre * np.sqrt(0.6 / 0.01) * rng.standard_normal(len(stamps))
wheel_rate = 0.93 * rate + wheels.rotation_per_radian * np.sqrt(np.abs(rate) / 0.01) * rng.standard_normal(len(stamps))
landmarks = np.array([[5.0, 4.0], [20.0, -3.0], [35.0, 5.0], [50.0, -2.0], [62.0, 6.0]])


def solve(motion, by_parameter, covariance, reference):
    """Odometry whose two parameters are in the graph, and sightings of a few landmarks."""
    graph = clew.FactorGraph()
    start = [np.zeros(3)]
    for step in motion:
        start.append(se2.compose(start[-1], step))
    poses = graph.add_pose(clew.SE2.from_array(np.array(start)))
    graph.set_constant(poses[0])
    parameters = graph.add_point(clew.Point2(*reference))
    graph.add(clew.Prior(parameters, clew.Point2(0.0, 0.0), sigmas=[0.1, 0.1]))
    graph.add(PreintegratedMotion(poses[:-1], poses[1:], [parameters], motion, by_parameter, reference,
                                  covariance=covariance + 1e-10 * np.eye(3)))
    points = graph.add_point(landmarks)
    seen = np.argwhere(np.linalg.norm(truth[:, None, :2] - landmarks[None], axis=2) < 8.0)
    local = se2.act(se2.inverse(truth[seen[:, 0]]), landmarks[seen[:, 1]]) + rng.normal(0.0, 0.05, (len(seen), 2))
    graph.add(clew.PointObservation(poses[seen[:, 0]], points[seen[:, 1]], local, sigmas=0.05))
    solution = clew.optimize(graph, init="file")
    return solution, parameters


def error(solution):
    """RMSE of the positions after alignment."""
    own = solution.values(clew.SE2).array[:, :2]
    return np.sqrt(np.mean(np.sum((se2.act(align(truth[:, :2], own), own) - truth[:, :2]) ** 2, axis=1)))


found = gyro.motion(stamps, measured_rate, stamps, measured_speed, frames)
solution, parameters = solve(found.motion, found.by_parameter, found.covariance, found.reference)
estimate, deviation = solution.value(parameters).array, np.sqrt(np.diag(solution.covariance(parameters)))
print(f"bias {estimate[0]:.4f} +- {deviation[0]:.4f} rad/s (truth {BIAS}), "
      f"scale {estimate[1]:.4f} +- {deviation[1]:.4f} (truth {SCALE})")

alone = velocity_motion(pieces.duration, measured_speed[held], wheel_rate[held], wheels)
whole = preintegrate(alone.increment, pieces.first)
by_rate = alone.by_control[:, :, 1] * wheel_rate[held, None]  # the wheels' turn scale; the other column is not used
by_scale = whole.jacobian(np.stack([np.zeros_like(by_rate), by_rate], axis=2))
by_wheels, _ = solve(whole.motion, by_scale, whole.covariance(alone.covariance), np.zeros(2))
print(f"error of the trajectory: {error(solution):.3f} m with the gyro, {error(by_wheels):.3f} m with the wheels alone")
assert solution.status.ok
assert (np.abs(estimate - [BIAS, SCALE]) < 3.0 * deviation).all()
assert deviation[0] < 0.001
assert error(solution) < error(by_wheels)
