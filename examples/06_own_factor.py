"""A factor of one's own in plain NumPy: its exact Jacobian comes by itself.

Three beacons measure squared distances to a robot; expected: the robot is found at (1, 2) within a millimetre.
"""

import numpy as np

import clew


def squared_distance(robot, beacon, measured):
    """Residual ``(M, 1)`` of a batch: robots ``(M, 3)``, beacons ``(M, 2)``, measurements ``(M, 1)``."""
    offset = robot[:, :2] - beacon
    return np.sum(offset**2, axis=1)[:, None] - measured


graph = clew.FactorGraph()
robot = graph.add_pose(clew.SE2(0.5, 0.5, 0.0))
beacons = graph.add_point(np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 4.0]]))
for beacon in beacons:
    graph.set_constant(beacon)
graph.add(clew.Prior(robot, clew.SE2(0.5, 0.5, 0.0), sigmas=(100.0, 100.0, 0.1)))
graph.add(
    clew.CustomFactor(
        np.stack([np.full(3, robot), beacons], axis=1),
        squared_distance,
        kinds=(clew.SE2, clew.Point2),
        measurement=np.array([[5.0], [13.0], [5.0]]),
        sigmas=0.05,
    )
)
solution = clew.optimize(graph, init="file")
print(solution)
print("robot at", solution.value(robot).array[:2].round(4))
assert np.allclose(solution.value(robot).array[:2], [1.0, 2.0], atol=1e-3)
