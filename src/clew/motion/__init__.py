"""Motion models: where a robot's readings take it, and how far they can be trusted."""

from clew.motion.ackermann import Ackermann
from clew.motion.body_velocity import BodyVelocities, are_regular, body_velocities
from clew.motion.buffer import OdometryBuffer
from clew.motion.calibration import OdometryCalibration, OdometryQuality, bounded
from clew.motion.gyro import Gyro, GyroMotion
from clew.motion.gyro_calibration import GyroCalibration, GyroNoise, GyroQuality
from clew.motion.increment import increment_motion
from clew.motion.integrate import Pieces, Preintegrated, cut, preintegrate
from clew.motion.noise import OdometryNoise
from clew.motion.odometry import Odometry
from clew.motion.step import MotionStep
from clew.motion.turn_rates import GyroBuffer, GyroHeading, TurnRates
from clew.motion.velocity import VelocityNoise, velocity_motion
from clew.motion.wheels import WheelEncoders

__all__ = [
    "Ackermann",
    "BodyVelocities",
    "Gyro",
    "GyroBuffer",
    "GyroCalibration",
    "GyroHeading",
    "GyroMotion",
    "GyroNoise",
    "GyroQuality",
    "MotionStep",
    "Odometry",
    "OdometryBuffer",
    "OdometryCalibration",
    "OdometryNoise",
    "OdometryQuality",
    "Pieces",
    "Preintegrated",
    "TurnRates",
    "VelocityNoise",
    "WheelEncoders",
    "are_regular",
    "body_velocities",
    "bounded",
    "cut",
    "increment_motion",
    "preintegrate",
    "velocity_motion",
]
