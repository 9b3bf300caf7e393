"""Simulated worlds, robots and sensors with known truth."""

from clew.sim.campus import campus
from clew.sim.carmen import write_carmen
from clew.sim.demo import KINDS, simulate_demo, simulate_kind
from clew.sim.disturbance import Slips, disturbed
from clew.sim.drive import Drive, DriveModel, drive
from clew.sim.gyro import GyroModel
from clew.sim.landmarks import (
    ANONYMOUS,
    NO_LANDMARK,
    LandmarkWorld,
    SightingModel,
    Sightings,
    landmark_field,
    see_landmarks,
)
from clew.sim.landmarks_fleet import FleetModel, MeetingModel, Meetings, RobotRun, simulate_fleet, step_covariances
from clew.sim.laser import LaserModel, cast_rays
from clew.sim.layouts import hall, identical_doors, long_corridor, loop
from clew.sim.log import SimulatedLog, SimulationReport, simulate
from clew.sim.odometry import OdometryModel
from clew.sim.office import office_building
from clew.sim.route import tour
from clew.sim.world import World

__all__ = [
    "ANONYMOUS",
    "KINDS",
    "NO_LANDMARK",
    "Drive",
    "DriveModel",
    "FleetModel",
    "GyroModel",
    "LandmarkWorld",
    "LaserModel",
    "MeetingModel",
    "Meetings",
    "OdometryModel",
    "RobotRun",
    "SightingModel",
    "Sightings",
    "SimulatedLog",
    "SimulationReport",
    "Slips",
    "World",
    "campus",
    "cast_rays",
    "disturbed",
    "drive",
    "hall",
    "identical_doors",
    "landmark_field",
    "long_corridor",
    "loop",
    "office_building",
    "see_landmarks",
    "simulate",
    "simulate_demo",
    "simulate_fleet",
    "simulate_kind",
    "step_covariances",
    "tour",
    "write_carmen",
]
