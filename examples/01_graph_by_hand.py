"""A factor graph in twenty lines: two poses, a tree seen from the second one.

Prints the solution and how sure it is of the second pose; expected: chi2 below 0.1 and the second pose
within 5 cm of (1, 0).
"""

import numpy as np

import clew

graph = clew.FactorGraph()
a = graph.add_pose(clew.SE2(0, 0, 0))
b = graph.add_pose(clew.SE2(1.1, 0, 0.1))
tree = graph.add_point([2.0, 1.0])
graph.add(clew.Prior(a, clew.SE2.identity(), sigmas=(0.01, 0.01, 0.001)))
graph.add(clew.Between(a, b, clew.SE2(1, 0, 0), sigmas=(0.1, 0.1, 0.02)))
graph.add(clew.RangeBearing(a, tree, range=2.236, bearing=0.4636, sigmas=(0.1, 0.01)))
graph.add(clew.RangeBearing(b, tree, range=1.414, bearing=0.7854, sigmas=(0.1, 0.01)))

solution = clew.optimize(graph, robust=clew.Huber(1.0))
print(solution)
print("b =", solution.value(b))
print("standard deviations of b:", np.sqrt(np.diag(solution.covariance(b))).round(4))
assert solution.chi2 < 0.1
assert np.hypot(*(solution.value(b).array[:2] - [1.0, 0.0])) < 0.05
