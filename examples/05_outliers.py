"""False loop closures, and robust kernels that do not believe them.

A robot drives three rounds; ten of its loop closures are wrong. A strict kernel such as DCS doubts everything that
the first guess, odometry, contradicts, true closures included; a gentle one such as Cauchy brings the path near, and
from there the strict one tells true from false. Expected: without a kernel the path is bent by more than a metre, in
the end it is right to 20 cm, the ten have lost their weight and the true ones have not.
"""

import numpy as np

import clew
from clew.evaluate import absolute_trajectory_error, factor_residuals
from clew.view import graph_figure, residuals_figure, save_figure, solution_scene

rng = np.random.default_rng(5)
noise = np.array([0.03, 0.03, 0.005])
a_round = 60
angle = 2.0 * np.pi * np.arange(3 * a_round) / a_round
truth = clew.SE2.from_array(np.column_stack([8.0 * np.sin(angle), -8.0 * np.cos(angle), angle]))
steps = truth[:-1].between(truth[1:]).retract(rng.normal(0.0, noise, (len(angle) - 1, 3)))
odometry = [truth[0]]
for step in steps:
    odometry.append(odometry[-1] @ step)

graph = clew.FactorGraph()
keys = graph.add_pose(clew.SE2.from_array(np.stack([pose.array for pose in odometry])))
graph.set_constant(keys[0])
graph.add(clew.Between(keys[:-1], keys[1:], steps, sigmas=noise))
again = np.arange(a_round, len(angle), 4)
seen = truth[again - a_round].between(truth[again])
seen = seen.retract(rng.normal(0.0, noise, (len(again), 3)))
true_ids = graph.add(clew.Between(keys[again - a_round], keys[again], seen, sigmas=noise, role="loop"))
# Two places that look the same: the robot believes that it stands where it does not.
wrong_a, wrong_b = rng.choice(len(angle), (2, 10), replace=False)
false_ids = graph.add(clew.Between(keys[wrong_a], keys[wrong_b], clew.SE2.identity(), sigmas=noise, role="loop"))

times, errors = np.arange(len(angle), dtype=float), {}
for name, kernel in (("no kernel", None), ("Cauchy", clew.Cauchy()), ("DCS after Cauchy", clew.DCS())):
    solution = clew.optimize(graph, init="file", robust=kernel, update=kernel is not None)
    found = solution.values().array
    errors[name] = absolute_trajectory_error(times, truth.array, times, found).translation.rmse
    print(f"{name}: {errors[name]:.2f} m from the truth (RMSE); {solution.status.value}")

residuals = factor_residuals(solution.graph, clew.DCS())
weight = dict(zip(residuals.ids.tolist(), residuals.weight, strict=True))
print(f"weights of the false closures: at most {max(weight[i] for i in false_ids.tolist()):.4f}")
print(f"weights of the true closures: median {np.median([weight[i] for i in true_ids.tolist()]):.2f}")
scene = solution_scene(solution, covariances=False, residuals=residuals)
save_figure(graph_figure(scene, "Ten false closures, not believed"), "05_graph.png")
save_figure(residuals_figure(residuals, "Residuals and weights"), "05_residuals.png")
print("look at 05_graph.png and 05_residuals.png")
assert errors["no kernel"] > 1.0
assert errors["DCS after Cauchy"] < 0.2
assert max(weight[i] for i in false_ids.tolist()) < 0.01
assert np.median([weight[i] for i in true_ids.tolist()]) > 0.99
