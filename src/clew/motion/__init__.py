"""Motion models: predicted pose with its covariance."""

from clew.motion.odometry import Odometry

__all__ = ["Odometry"]
