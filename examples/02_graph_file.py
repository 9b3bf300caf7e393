"""A pose graph from a g2o file, optimised; a file of your own: ``python 02_graph_file.py FILE.g2o``.

Without a file it writes one first: a robot on a grid of streets whose odometry drifts and who recognises places.
Expected: the cost falls at least ten times, to about one for each number measured beyond those that are sought.
"""

import sys
from pathlib import Path

import numpy as np

import clew
from clew.io import read_graph, write_graph
from clew.view import before_after_figure, graph_scene, save_figure, solution_scene


def path_of(steps):
    """Poses from relative ones: dead reckoning."""
    poses = [clew.SE2.identity()]
    for step in steps:
        poses.append(poses[-1] @ step)
    return clew.SE2.from_array(np.stack([pose.array for pose in poses]))


def streets(rounds=3, side=12):
    """A graph whose values are odometry alone: `rounds` times along a square, each closed on the round before."""
    rng = np.random.default_rng(1)
    noise = np.array([0.05, 0.05, 0.01])
    steps = np.tile([[1.0, 0.0, 0.0]], (4 * side * rounds, 1))
    steps[side - 1 :: side, 2] = np.pi / 2
    truth = path_of(clew.SE2.from_array(steps))
    measured = clew.SE2.from_array(steps).retract(rng.normal(0.0, noise, steps.shape))
    graph = clew.FactorGraph()
    keys = graph.add_pose(path_of(measured))
    graph.add(clew.Between(keys[:-1], keys[1:], measured, sigmas=noise))
    again = np.arange(4 * side, len(keys), 3)
    seen = truth[again - 4 * side].between(truth[again])
    seen = seen.retract(rng.normal(0.0, noise, (len(again), 3)))
    graph.add(clew.Between(keys[again - 4 * side], keys[again], seen, sigmas=noise, role="loop"))
    return graph


path = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("streets.g2o")
if len(sys.argv) == 1:
    write_graph(path, streets())

file = read_graph(path)
solution = clew.optimize(file.graph)
print(solution)
save_figure(before_after_figure(graph_scene(file.graph), solution_scene(solution)), "02_before_after.png")
print("look at 02_before_after.png")

first = clew.optimize(file.graph, init="file", max_iterations=0).chi2
assert solution.status.ok
if len(sys.argv) == 1:
    beyond = 3 * (file.graph.factor_count - len(file.graph) + 1)
    assert solution.chi2 < 0.1 * first
    assert 0.6 * beyond < solution.chi2 < 1.5 * beyond
