"""The pipeline as a library: measurements in, one at a time; trajectory, graph and map out.

Expected: the path is found within 10 cm of the truth although odometry alone is metres off.
"""

from clew.evaluate import absolute_trajectory_error
from clew.sim import simulate_demo
from clew.slam import Slam

log = simulate_demo(seed=1, duration=120.0)
slam = Slam()
for measurement in log.measurements():
    slam.add(measurement)
slam.refine()

for name, estimate in (("odometry", slam.odometry), ("clew", slam.trajectory)):
    error = absolute_trajectory_error(
        log.timestamps, log.T_world_robot, estimate.timestamps, estimate.T_world_robot
    ).translation.rmse
    print(f"{name}: {error:.3f} m (ATE, RMSE)")
print(slam.graph)
print(f"map of {slam.map().shape} cells, {len(slam.closures)} loop closures")
assert error < 0.10
