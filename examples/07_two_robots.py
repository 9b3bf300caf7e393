"""Two robots that mapped the same place, each in a frame of its own, become one graph.

They share landmarks with names (tags, reflectors), and nobody says where one robot started as seen from the
other. Expected: the frame of the second is found within 10 cm and 0.02 rad.
"""

import numpy as np

import clew
from clew.fleet import merge, robot_graph
from clew.view import graph_figure, save_figure, solution_scene

rng = np.random.default_rng(7)
names = [f"tag {n}" for n in range(12)]
tags = rng.uniform(-8.0, 8.0, (len(names), 2))
T_first_second = clew.SE2(3.0, -2.0, 2.5)  # the truth that is sought


def drive(T_world_own, turns):
    """One robot's graph: odometry and sightings of tags, all in the robot's own frame."""
    angle = np.linspace(0.0, 2.0 * np.pi * turns, 40)
    truth = clew.SE2.from_array(np.column_stack([5.0 * np.sin(angle), 5.0 - 5.0 * np.cos(angle), angle]))
    graph = clew.FactorGraph()
    keys = graph.add_pose(truth)
    steps = truth[:-1].between(truth[1:])
    noise = np.array([0.02, 0.02, 0.005])
    graph.add(clew.Between(keys[:-1], keys[1:], steps.retract(rng.normal(0.0, noise, (39, 3))), sigmas=noise))
    own = T_world_own.inverse().act(tags)
    points = graph.add_point(own)
    offset = truth[:, None].inverse().act(own[None])
    pose, tag = np.nonzero(np.linalg.norm(offset, axis=2) < 6.0)
    seen = offset[pose, tag] + rng.normal(0.0, 0.05, (len(pose), 2))
    graph.add(clew.PointObservation(keys[pose], points[tag], seen, sigmas=0.05))
    return graph, dict(zip(points.tolist(), names, strict=True))


robots = []
for name, frame, turns in (("ann", clew.SE2.identity(), 1.0), ("bob", T_first_second, -0.8)):
    graph, identities = drive(frame, turns)
    robots.append(robot_graph(name, graph, identities=identities))
merged = merge(robots)
print(merged.solution)
found = merged.frames[1]
print("bob's frame seen from ann's:", found.round(3), "- the truth:", T_first_second.array)
colours = {name: keys[1] for name, keys in zip(merged.names, merged.keys, strict=True)}
save_figure(graph_figure(solution_scene(merged.solution, robots=colours), "Ann and Bob"), "07_two_robots.png")
print("look at 07_two_robots.png")
assert np.hypot(*(found[:2] - T_first_second.array[:2])) < 0.10
assert abs(found[2] - T_first_second.array[2]) < 0.02
