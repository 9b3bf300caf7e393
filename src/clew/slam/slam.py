"""Simultaneous localisation and mapping, one measurement at a time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.geometry import SE2, se2
from clew.graph import FactorGraph
from clew.mapping import OccupancyGrid, build_occupancy_grid, moving_returns
from clew.motion import GyroBuffer, Odometry, OdometryBuffer, TurnRates, body_velocities
from clew.place import Closure
from clew.scan import LaserScan
from clew.slam.config import SlamConfig
from clew.slam.keyframes import KeyframeStore
from clew.slam.loop_closing import LoopCloser
from clew.slam.pose_graph import PoseGraph, chi2
from clew.slam.pruning import Pruned, Pruner
from clew.slam.refine import refine
from clew.slam.scans import ScanStore
from clew.slam.sensor import SensorModel
from clew.slam.timing import SHARE_OF_A_LOOK, beam_times_of, look_now
from clew.slam.tracking import Tracker
from clew.slam.trajectory import Trajectory
from clew.slam.viewer import GuardedViewer, NullViewer, Viewer
from clew.solve import Solution, optimize

Array = NDArray[np.float64]


class Slam:
    """Takes odometry, turn rates and scans as they come, and tells pose, trajectory, graph and map at any moment.

    The world's frame is where the robot stood at the first scan. ::

        slam = clew.Slam()
        for measurement in log.measurements():
            slam.add(measurement)
        slam.refine()
        slam.trajectory.T_world_robot, slam.graph, slam.map()

    Args:
        config: all options; the defaults serve every log.
        use_odometry: whether to expect odometry; without it motion is predicted from the scans alone.
        viewer: shows the run while it works (`clew.slam.Viewer`); one that fails is dropped and the run goes on.
    """

    def __init__(
        self, config: SlamConfig | None = None, *, use_odometry: bool = True, viewer: Viewer | None = None
    ) -> None:
        self.config = config or SlamConfig()
        self._use_odometry = use_odometry
        self._odometry = OdometryBuffer()
        self._gyro = GyroBuffer()
        self._keyframes = KeyframeStore()
        self._sensor = SensorModel(self.config)
        self._tracker = Tracker(self._keyframes, self.config, self._sensor)
        self._pose_graph = PoseGraph(self.config.closing.kernel_scale)
        self._closer = LoopCloser(self._keyframes, self._pose_graph, self.config, self._sensor)
        self._pruner = Pruner(self._keyframes, self._pose_graph, self.config)
        self._scans = ScanStore(self.config.pruning.scans)
        self._last_scan: LaserScan | None = None
        self._refined: FactorGraph | None = None
        self._viewer: Viewer = NullViewer() if viewer is None else GuardedViewer(viewer)

    # --- measurements in --------------------------------------------------------------------------------------------

    def add(self, measurement: LaserScan | Odometry | TurnRates) -> None:
        """Take a measurement of any kind."""
        if isinstance(measurement, Odometry):
            self.add_odometry(measurement)
        elif isinstance(measurement, TurnRates):
            self.add_turn_rates(measurement)
        else:
            self.add_scan(measurement)

    def add_odometry(self, odometry: Odometry) -> None:
        """Take an odometry reading; readings come in the order of time.

        Raises:
            InputError: the reading is no pose of finite numbers.
        """
        pose = odometry.T_odom_robot
        if np.shape(pose) != (3,) or not np.isfinite([*pose, odometry.timestamp]).all():
            raise InputError(
                f"odometry at {odometry.timestamp:.6f} s: {pose} is no pose (x, y, theta) of "
                "finite numbers: leave it out"
            )
        self._odometry.add(odometry)

    def add_turn_rates(self, readings: TurnRates) -> None:
        """Take readings of a gyro; they come in the order of time.

        Raises:
            InputError: timestamps and rates are no finite numbers ``(n,)``.
        """
        times, rates = np.asarray(readings.timestamps), np.asarray(readings.rates)
        if times.ndim != 1 or times.shape != rates.shape or not np.isfinite([times, rates]).all():
            raise InputError(
                f"turn rates: timestamps {times.shape} and rates {rates.shape} are no finite numbers (n,): "
                "leave them out"
            )
        self._gyro.add(readings)

    def add_scan(self, scan: LaserScan) -> SE2:
        """Take a scan; returns the pose of the robot at it, ``T_world_robot``.

        Raises:
            InputError: the scan is not later than the last one, its geometry is not finite, or no odometry has come
                though it is expected.
        """
        _check(scan)
        if len(self._scans) and scan.timestamp <= self._scans.timestamps[-1]:
            raise InputError(
                f"the scan at {scan.timestamp:.6f} s is not later than the last one, at "
                f"{self._scans.timestamps[-1]:.6f} s: sort scans by time"
            )
        T_odom_robot = self._odometry.at(scan.timestamp) if self._use_odometry else None
        if T_odom_robot is None and self._use_odometry:
            raise InputError(
                f"no odometry before the scan at {scan.timestamp:.6f} s: add odometry first, or use scans alone "
                "(Slam(use_odometry=False), clew run --no-odometry)"
            )
        self._sensor.see(scan)
        scan = self._sensor.timed(scan)
        heading = self._gyro.at(scan.timestamp)
        velocity, rate = self._velocity(scan, T_odom_robot), self._turn_rate(scan)
        tracked = self._tracker.track(scan, T_odom_robot, velocity, heading, rate)
        self._scans.add(scan, tracked.keyframe, tracked.T_keyframe_robot, T_odom_robot, tracked.velocity)
        self._last_scan = tracked.scan
        self._refined = None
        if tracked.is_keyframe:
            self._pose_graph.add_keyframe(self._keyframes[tracked.keyframe])
            self._closer.attempt(self._pruner.crowded(tracked.keyframe))
            self._prune()
            if look_now(len(self._keyframes)) and not (self._sensor.tells_beam_times or self._sensor.beam_times):
                self._look_for_beam_times()
        self._viewer.update(self)
        return self.pose

    def _look_for_beam_times(self) -> None:
        """Find the moments of the beams, for the scans to come."""
        numbers = self._keyframes.alive
        kept = self._scans.of_keyframes(numbers)
        local = se2.compose(self._keyframes.T_local_robot[self._scans.keyframes], self._scans.T_keyframe_robot)
        self._sensor.beam_times = beam_times_of(
            self._scans.timestamps, local, np.array([k.number for k in kept]), [k.scan for k in kept],
            self.config.cleaning, SHARE_OF_A_LOOK,
        )  # fmt: skip

    def _prune(self) -> None:
        """Take out keyframes that say nothing new."""
        gone = self._pruner.prune(self._closer.needed)
        self._closer.forget(gone)
        for keyframe in gone:
            self._scans.forget(keyframe)

    def _velocity(self, scan: LaserScan, T_odom_robot: Array | None) -> Array | None:
        """``(3,)`` body velocity during the sweep of a scan, where odometry tells it.

        During one so short that its time had to be found from scans the match knows it better.
        """
        sweep = scan.time_increment * len(scan.ranges)
        if sweep <= 0.0 or T_odom_robot is None or not self._tracker.trusts_odometry:
            return None
        end = self._odometry.at(scan.timestamp + sweep)
        assert end is not None
        return np.asarray(se2.log(se2.between(T_odom_robot, end)) / sweep, dtype=np.float64)

    def _turn_rate(self, scan: LaserScan) -> float | None:
        """Radians a second during the sweep of a scan as the gyro tells it, bias and all."""
        first, last = scan.span
        end = self._gyro.at(scan.timestamp + last) if last > first else None
        told = None if end is None else end.since(self._gyro.at(scan.timestamp + first))
        return None if told is None else float(told[1] / told[0])

    def optimise(
        self, progress: Callable[[int, int], None] | None = None, stop: Callable[[], bool] | None = None
    ) -> None:
        """Move all keyframes to where odometry and closures agree best, with those closures that only now are sure.

        What `refine` found before is given up; it begins with this anyway.

        Args:
            progress: called with the keyframes for which closures have been looked for again, beginning with 0, and the
                most there can be; not at all where there are none.
            stop: asked before each of these whether to leave it at that.
        """
        self._refined = None
        self._closer.finish(progress, stop)
        self._pose_graph.optimise(to_the_end=True)
        self._viewer.moved(self)

    def refine(
        self,
        progress: Callable[[int, int], None] | None = None,
        stop: Callable[[], bool] | None = None,
        closing: Callable[[int, int], None] | None = None,
    ) -> None:
        """Optimise, and refine all keyframes jointly against all scans that they overlap with.

        Args:
            progress: called with the rounds done, beginning with 0, and the most there can be.
            stop: asked after each round, and while closures are looked for again, whether to leave it at that.
            closing: the progress of `optimise`.
        """
        if len(self._keyframes) < 2:
            return
        self.optimise(closing, stop)
        if stop is not None and stop():
            return
        if progress is not None:
            progress(0, self.config.refinement.rounds)
        numbers = self._keyframes.alive
        retimed = self._retime(numbers)
        known = None if retimed else self._keyframes.clouds(numbers)
        clouds = self._scans.still_returns(numbers, known, self._pose_graph.poses[numbers], self.config.cleaning)
        if retimed:
            self._keyframes.replace_clouds(numbers, clouds)
            self._closer.look_again()
        self._refined = refine(clouds, numbers, self._pose_graph.graph, self.config, self._sensor, progress, stop)
        self._pose_graph.set_poses(np.asarray(self._refined.values(SE2).array))
        self._viewer.moved(self)

    def _retime(self, numbers: NDArray[np.int64]) -> bool:
        """Find the moments of the beams again, with the whole trajectory and scans of some keyframes; whether motion
        within scans is now taken out otherwise than it was."""
        if self._sensor.tells_beam_times:
            return False
        kept = self._scans.of_keyframes(numbers)
        stamps, poses = self._scans.timestamps, self.trajectory.T_world_robot
        before, rows = self._sensor.beam_times, np.array([k.number for k in kept])
        found = beam_times_of(stamps, poses, rows, [k.scan for k in kept], self.config.cleaning, start=before)
        if not before and not found:
            return False
        self._sensor.beam_times = found
        self._scans.retime(found, body_velocities(stamps, poses).velocity)
        return True

    # --- answers out ------------------------------------------------------------------------------------------------

    @property
    def has_odometry(self) -> bool:
        """Whether a scan can be placed: odometry has come, or is not expected."""
        return not self._use_odometry or len(self._odometry) > 0

    @property
    def time_span(self) -> tuple[float, float]:
        """Timestamps of the first and the last scan; zeros before any."""
        stamps = self._scans.timestamps
        return (float(stamps[0]), float(stamps[-1])) if len(stamps) else (0.0, 0.0)

    @property
    def scan_count(self) -> int:
        """Scans taken so far."""
        return len(self._scans)

    @property
    def pose(self) -> SE2:
        """``T_world_robot`` at the last scan."""
        if not len(self._scans):
            return SE2.identity()
        keyframe = self._scans.keyframes[-1]
        return SE2.from_array(se2.compose(self._pose_graph.poses[keyframe], self._scans.T_keyframe_robot[-1]))

    @property
    def trajectory(self) -> Trajectory:
        """One pose for every scan."""
        keyframes = self._pose_graph.follow()[self._scans.keyframes]
        return Trajectory(self._scans.timestamps.copy(), se2.compose(keyframes, self._scans.T_keyframe_robot))

    @property
    def odometry(self) -> Trajectory:
        """What odometry alone says, from the world's origin; empty without odometry."""
        poses = self._scans.T_odom_robot
        if not len(poses):
            return Trajectory(np.zeros(0), np.zeros((0, 3)))
        return Trajectory(self._scans.timestamps.copy(), se2.between(poses[0], poses))

    @property
    def keyframes(self) -> Trajectory:
        """Poses of the keyframes that the graph holds; the rows are its keys, in their order."""
        kept = self._keyframes.alive
        return Trajectory(self._keyframes.timestamps[kept], self._pose_graph.poses[kept])

    @property
    def every_keyframe(self) -> Trajectory:
        """Poses of all keyframes that were taken, with those that have been pruned since: closures name these rows."""
        return Trajectory(self._keyframes.timestamps.copy(), self._pose_graph.follow().copy())

    @property
    def pruned(self) -> Pruned:
        """How many keyframes were taken out because others say the same, and the information that was lost."""
        return self._pruner.pruned

    @property
    def last_scan(self) -> LaserScan | None:
        """The scan that was taken last, or None before any."""
        return self._last_scan

    @property
    def keyframe_points(self) -> list[Array]:
        """Returns ``(n, 2)`` of each of `keyframes` in the robot's frame, metres, in the order of the beams."""
        return [cloud.points for cloud in self._keyframes.clouds(self._keyframes.alive)]

    @property
    def keyframe_numbers(self) -> NDArray[np.int64]:
        """Row ``(K,)`` of each of `keyframes` in `every_keyframe`; closures name these."""
        return self._keyframes.alive

    @property
    def graph(self) -> FactorGraph:
        """The graph of keyframes: odometry and loop edges at the present poses."""
        return self._pose_graph.graph if self._refined is None else self._refined

    def solution(self) -> Solution:
        """`graph` with the Gaussian around the present poses: covariances, and what the measurements leave open."""
        return optimize(self.graph, init="file", max_iterations=0)

    def covariances(self) -> Array:
        """Covariances ``(K, 3, 3)`` of `keyframes` seen from the first one, each in the tangent of its pose.

        Of a pose seen from any other: `Solution.joint_covariance` of `solution`, by `keyframe_numbers`.
        """
        if len(self.graph) < 2:
            return np.zeros((len(self.graph), 3, 3))
        return np.asarray(self.solution().covariances(SE2), dtype=np.float64)

    @property
    def chi2(self) -> float:
        """Cost ``sum e^T Omega e`` of `graph` at the present poses, without robust kernels."""
        return chi2(self.graph)

    @property
    def closures(self) -> list[Closure]:
        """Loop closures that are believed, by rows of `every_keyframe`."""
        return self._closer.accepted

    @property
    def closure_count(self) -> int:
        """How many loop closures are believed; quicker than asking for them."""
        return self._closer.accepted_count

    @property
    def rejected_closures(self) -> list[Closure]:
        """Candidates that are not believed, each with the reason: those turned down, and those that are redundant."""
        return self._closer.rejected

    @property
    def turned_down_count(self) -> int:
        """How many candidates were turned down; quicker than asking for them. Redundant ones were not."""
        return self._closer.turned_down_count

    @property
    def redundant_count(self) -> int:
        """How many candidates say the same as a closure of their keyframe that is believed."""
        return self._closer.redundant_count

    @property
    def sensor(self) -> dict[str, object]:
        """What the log has told about laser and odometry, in plain numbers."""
        return self._sensor.report() if len(self._scans) else {}

    def map(self, resolution: float | None = None, progress: Callable[[int, int], None] | None = None) -> OccupancyGrid:
        """Occupancy grid of the scans at the present trajectory, without what did not stay (`moving_returns`).

        Scans of keyframes that were pruned are not among them: others saw the same.

        Raises:
            InputError: there is no scan yet.
        """
        if not len(self._scans):
            raise InputError("no scan yet: a map needs at least one")
        numbers, scans = self._scans.kept()
        poses = self.trajectory.T_world_robot[numbers]
        return build_occupancy_grid(
            scans,
            poses,
            exclude=moving_returns(scans, poses),
            resolution=resolution or self.config.map_resolution,
            progress=progress,
        )


def _check(scan: LaserScan) -> None:
    """Ranges may be anything, but where they were measured must be known."""
    numbers = [scan.timestamp, scan.angle_min, scan.angle_increment, *scan.T_robot_sensor]
    if scan.ranges.ndim != 1 or len(scan.T_robot_sensor) != 3 or not np.isfinite(numbers).all():
        raise InputError(
            f"the scan at {scan.timestamp:.6f} s: give ranges (n,), finite angles and a finite T_robot_sensor "
            "(x, y, theta)"
        )
