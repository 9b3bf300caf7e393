"""Landmarks seen from a drive, and how sure their places are.

Expected: the true landmarks lie within their 95 % ellipses about 95 times in 100 (here: at least 85), most within
10 cm; the picture shows the ellipses.
"""

from itertools import pairwise

import numpy as np

import clew
from clew.view import graph_figure, save_figure, solution_scene

rng = np.random.default_rng(3)
landmarks = rng.uniform([-2.0, -2.0], [22.0, 12.0], (60, 2))
corners = np.array([[0.0, 0.0], [20.0, 0.0], [20.0, 10.0], [0.0, 10.0], [0.0, 0.0]])
way = np.concatenate([np.linspace(a, b, 20, endpoint=False) for a, b in pairwise(corners)])
heading = np.arctan2(*np.roll(way, -1, axis=0).T[::-1] - way.T[::-1])
truth = clew.SE2.from_array(np.column_stack([way, heading]))

# What the robot measures: its steps, and range and bearing of what is nearer than 5 m.
odometry_noise, sighting_noise = np.array([0.03, 0.02, 0.01]), np.array([0.05, 0.02])
steps = truth[:-1].between(truth[1:])
steps = steps.retract(rng.normal(0.0, odometry_noise, (len(way) - 1, 3)))
offset = truth[:, None].inverse().act(landmarks[None])
distance = np.linalg.norm(offset, axis=2)
pose, mark = np.nonzero(distance < 5.0)
ranges = distance[pose, mark] + rng.normal(0.0, sighting_noise[0], len(pose))
bearings = np.arctan2(offset[pose, mark, 1], offset[pose, mark, 0]) + rng.normal(0.0, sighting_noise[1], len(pose))

# The graph. The initial guess is odometry, and each landmark where its first sighting puts it.
guess = [truth[0]]
for step in steps:
    guess.append(guess[-1] @ step)
guess = clew.SE2.from_array(np.stack([pose.array for pose in guess]))
graph = clew.FactorGraph()
poses = graph.add_pose(guess)
graph.set_constant(poses[0])
graph.add(clew.Between(poses[:-1], poses[1:], steps, sigmas=odometry_noise))
seen, first = np.unique(mark, return_index=True)
sight = np.column_stack([ranges * np.cos(bearings), ranges * np.sin(bearings)])[first]
points = graph.add_point(guess[pose[first]].act(sight))
graph.add(clew.RangeBearing(poses[pose], points[np.searchsorted(seen, mark)], ranges, bearings, sigmas=sighting_noise))

solution = clew.optimize(graph)
print(solution)
error = solution.values(clew.Point2).array - landmarks[seen]
surprise = np.einsum("ni,nij,nj->n", error, np.linalg.inv(solution.covariances(clew.Point2)), error)
inside = (surprise < 5.991).mean()
print(f"{len(seen)} landmarks, median error {100 * np.median(np.hypot(*error.T)):.1f} cm")
print(f"{100 * inside:.0f} % of the landmarks lie within their 95 % ellipses")
save_figure(graph_figure(solution_scene(solution), "Landmarks"), "04_landmarks.png")
print("look at 04_landmarks.png")
assert solution.status.ok
assert inside >= 0.85
assert np.median(np.hypot(*error.T)) < 0.10
