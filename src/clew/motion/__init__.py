"""Motion models: odometry and how far it can be trusted."""

from clew.motion.buffer import OdometryBuffer
from clew.motion.noise import OdometryNoise
from clew.motion.odometry import Odometry

__all__ = ["Odometry", "OdometryBuffer", "OdometryNoise"]
