"""Simulated worlds, robots and sensors with known truth."""

from clew.sim.carmen import write_carmen
from clew.sim.demo import KINDS, simulate_demo, simulate_kind
from clew.sim.drive import Drive, DriveModel, drive
from clew.sim.laser import LaserModel, cast_rays
from clew.sim.layouts import hall, long_corridor, loop
from clew.sim.log import SimulatedLog, SimulationReport, simulate
from clew.sim.odometry import OdometryModel
from clew.sim.office import office_building
from clew.sim.route import tour
from clew.sim.world import World

__all__ = [
    "KINDS",
    "Drive",
    "DriveModel",
    "LaserModel",
    "OdometryModel",
    "SimulatedLog",
    "SimulationReport",
    "World",
    "cast_rays",
    "drive",
    "hall",
    "long_corridor",
    "loop",
    "office_building",
    "simulate",
    "simulate_demo",
    "simulate_kind",
    "tour",
    "write_carmen",
]
