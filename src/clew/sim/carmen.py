"""Simulated logs as CARMEN log files, for programs that read those."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from clew.errors import InputError
from clew.geometry import se2
from clew.sim.log import SimulatedLog

#: What a SICK laser writes for a beam without a return, metres.
NO_RETURN = 81.91
#: Beams in the half circle of a FLASER record, whose header has no angles: a reader takes these for granted.
FIELD_OF_VIEW = np.pi


def write_carmen(log: SimulatedLog, path: Path | str) -> None:
    """Write scans and odometry as `FLASER` records; timestamps to the microsecond, ranges to the millimetre.

    `FLASER n ranges... x y theta odom_x odom_y odom_theta ipc_timestamp host logger_timestamp`: the first
    pose is that of the laser, the second that of the robot, both by odometry. The file is written whole or
    not at all.

    Raises:
        InputError: a laser that the format cannot describe (it takes half a circle about the x axis
            for granted), or a folder that does not exist.
    """
    path = Path(path)
    if abs(log.laser.field_of_view - FIELD_OF_VIEW) > 1e-6 or log.laser.beams % 2 == 0:
        degrees = np.degrees(log.laser.field_of_view)
        raise InputError(f"{path}: {log.laser.beams} beams over {degrees:g} degrees: FLASER records "
                         "hold an odd number of beams over 180 degrees")
    if not path.parent.is_dir():
        raise InputError(f"{path}: the folder {path.parent} does not exist; make it first")
    T_odom_sensor = se2.compose(log.T_odom_robot, np.array(log.laser.T_robot_sensor))
    start = log.timestamps[0]
    aside = path.with_name(path.name + ".partial")
    with aside.open("w", encoding="ascii") as file:
        file.write(f"# simulated: {log.world.name}\n")
        for index in range(log.scan_count):
            ranges = np.where(np.isfinite(log.ranges[index]), log.ranges[index], NO_RETURN)
            values = " ".join(f"{r:.3f}" for r in ranges.tolist())
            poses = " ".join(f"{v:.6f}" for v in (*T_odom_sensor[index], *log.T_odom_robot[index]))
            time = log.timestamps[index]
            file.write(f"FLASER {log.laser.beams} {values} {poses} {time:.6f} clew {time - start:.6f}\n")
    os.replace(aside, path)
