"""What state a log is in: rates, gaps, clocks, what the laser is, and what a user should know about it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew.geometry import wrap
from clew.io.log import Records
from clew.io.recorded import RecordedLog, ScanTable

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: A sensor is silent when nothing comes for so many of its usual intervals, and for so many seconds.
GAP_INTERVALS, GAP_SECONDS = 10.0, 2.0
#: Odometry that claims to move faster than a robot can has jumped, metres and radians a second.
FASTEST, FASTEST_TURN = 5.0, 20.0
JITTER = 1.0  # seconds; a speed over less is one of the clock
STUCK = 0.9  # share of a gyro's readings that repeat the one before when it is stuck
#: A gyro has met the end of its scale when its extreme rate comes so often, and so many times as often as any of the
#: next few rates that it told. With few different rates in all, that is the step of a coarse one.
SATURATED, SATURATED_FACTOR, NEXT_RATES, FEW_RATES = 5, 3, 5, 50
SLOWEST_GYRO = 10.0  # Hz; between rarer readings a robot turns unseen
#: The order of the clock is doubtful when it makes the way longer than the order of the file, by this factor.
ZIGZAG = 1.02


@dataclass(frozen=True, eq=False)
class StreamHealth:
    """The records of one sensor over time.

    Attributes:
        name: the sensor.
        count: records.
        first, last: times of the earliest and the latest, seconds.
        interval: usual time between two records (median of those that are not zero), seconds; 0 with fewer than two.
        gaps: ``(G, 2)`` when nothing came for long: beginning and length, seconds.
        steps_back: ``(S, 2)`` where the clock stepped back from one record of the file to the next: the time before the
            step, and by how much, seconds.
    """

    name: str
    count: int
    first: float
    last: float
    interval: float
    gaps: Array
    steps_back: Array

    @property
    def rate(self) -> float:
        """Records a second, gaps left out; 0 with fewer than two."""
        busy = self.last - self.first - float(np.sum(self.gaps[:, 1]))
        return (self.count - 1 - len(self.gaps)) / busy if busy > 0 else 0.0

    def to_dict(self) -> dict[str, object]:
        """Plain numbers, for JSON."""
        return {"name": self.name, "count": self.count, "rate_hz": self.rate, "first": self.first, "last": self.last,
                "gaps": self.gaps.tolist(), "steps_back": len(self.steps_back),
                "largest_step_back_s": float(np.max(self.steps_back[:, 1], initial=0.0))}


@dataclass(frozen=True, eq=False)
class LaserHealth:
    """What the laser is and does.

    Attributes:
        beams: scans by number of beams.
        beam_changes: how often the number of beams changes from one scan to the next.
        field_of_view: from the first to the last beam of the usual scan, radians.
        resolution: angle between neighbouring beams of the usual scan, radians.
        range_min, range_max: shortest and longest range that count as returns, metres; the largest over the log.
        no_return: share of beams that met nothing within reach.
        invalid: share of beams that are no distance.
        longest, median: longest and median return, metres; 0 where there is none.
        T_robot_sensor: ``(3,)`` pose of the laser on the robot.
    """

    beams: Mapping[int, int]
    beam_changes: int
    field_of_view: float
    resolution: float
    range_min: float
    range_max: float
    no_return: float
    invalid: float
    longest: float
    median: float
    T_robot_sensor: Array

    def to_dict(self) -> dict[str, object]:
        """Plain numbers, for JSON; angles in degrees."""
        return {"beams": {str(number): scans for number, scans in self.beams.items()},
                "beam_changes": self.beam_changes, "field_of_view_deg": float(np.degrees(self.field_of_view)),
                "resolution_deg": float(np.degrees(self.resolution)), "range_min_m": self.range_min,
                "range_max_m": self.range_max if np.isfinite(self.range_max) else None,
                "no_return": self.no_return, "invalid": self.invalid, "longest_m": self.longest,
                "median_m": self.median, "T_robot_sensor": self.T_robot_sensor.tolist()}


@dataclass(frozen=True, eq=False)
class GyroHealth:
    """What the gyro does.

    Attributes:
        stream: its records over time.
        quiet: radians a second; median of its rates in the quietest tenth of the log's seconds: nearly its bias, if the
            robot stood then.
        fastest: largest rate, radians a second.
        constant: share of readings that repeat the one before to the last bit.
        saturated: readings at the ends of its scale.
    """

    stream: StreamHealth
    quiet: float
    fastest: float
    constant: float
    saturated: int

    @property
    def usable(self) -> bool:
        """Whether it may tell a robot's turns: it changes, and often enough."""
        return self.constant < 1.0 and self.stream.rate >= SLOWEST_GYRO

    def to_dict(self) -> dict[str, object]:
        """Plain numbers, for JSON; angles in degrees."""
        return {**self.stream.to_dict(), "quiet_deg_per_s": float(np.degrees(self.quiet)),
                "fastest_deg_per_s": float(np.degrees(self.fastest)), "constant": self.constant,
                "saturated": self.saturated}


@dataclass(frozen=True, eq=False)
class LogHealth:
    """The state of a log of laser scans, odometry and turn rates.

    Attributes:
        duration: seconds from the first to the last scan.
        scans: the laser's records.
        odometry: the odometry's own records; those that came with the scans where it has none; None without odometry.
        laser: what the laser is and does.
        distance: way of the robot by its odometry, jumps left out, metres, in the order of recording or of time,
            whichever is shorter; 0 without odometry.
        distance_by_time: the same in the order of time.
        turned: sum of all turns by odometry, radians.
        jumps: ``(J, 2)`` where odometry claims to move faster than a robot can: time, and distance in metres.
        skipped: records left out, by reason.
        gyro: what the gyro does; None without one.
    """

    duration: float
    scans: StreamHealth
    odometry: StreamHealth | None
    laser: LaserHealth
    distance: float
    distance_by_time: float
    turned: float
    jumps: Array
    skipped: Mapping[str, int]
    gyro: GyroHealth | None = None

    @property
    def problems(self) -> tuple[str, ...]:
        """What a user should know, a sentence each; none for a log without fault."""
        return tuple(_problems(self))

    def to_dict(self) -> dict[str, object]:
        """Plain numbers, for JSON."""
        return {"duration_s": self.duration, "scans": self.scans.to_dict(),
                "odometry": None if self.odometry is None else self.odometry.to_dict(), "laser": self.laser.to_dict(),
                "gyro": None if self.gyro is None else self.gyro.to_dict(),
                "distance_m": self.distance, "distance_by_time_m": self.distance_by_time,
                "turned_deg": float(np.degrees(self.turned)), "jumps": self.jumps.tolist(),
                "skipped": dict(self.skipped), "problems": list(self.problems)}


def log_health(log: Records) -> LogHealth:
    """Examine a log. Nothing is estimated: this is what the records themselves say."""
    recorded = RecordedLog.of(log)
    table = recorded.scans
    own = np.column_stack([table.times, table.T_odom_robot, table.position])[~np.isnan(table.T_odom_robot[:, 0])]
    readings = np.concatenate([own, recorded.odometry])
    by_time, by_position = (np.lexsort((readings[:, 4], key)) for key in (readings[:, 0], readings[:, 4]))
    timed, jumps = _way(readings[by_time])
    written, jumps_written = _way(readings[by_position])
    if written[0] < timed[0]:
        jumps = jumps_written
    return LogHealth(
        duration=recorded.duration,
        scans=stream_health("laser", table.times, table.position),
        odometry=_odometry(own, recorded.odometry),
        laser=_laser(table),
        distance=min(written[0], timed[0]),
        distance_by_time=timed[0],
        turned=min(written[1], timed[1]),
        jumps=jumps,
        skipped=dict(sorted(Counter(recorded.report.skipped).items())),
        gyro=_gyro(recorded.gyro) if recorded.has_gyro else None,
    )


def stream_health(name: str, times: Array, positions: Indices | Array | None = None) -> StreamHealth:
    """Rate, gaps and steps of the clock of one sensor.

    Args:
        name: of the sensor.
        times: ``(N,)`` seconds.
        positions: ``(N,)`` place of each record in the file; None for the order given.
    """
    recorded = times if positions is None else times[np.argsort(positions, kind="stable")]
    ordered = np.sort(times)
    intervals = np.diff(ordered)
    interval = float(np.median(intervals[intervals > 0])) if np.any(intervals > 0) else 0.0
    silent = np.flatnonzero(intervals > max(GAP_INTERVALS * interval, GAP_SECONDS))
    steps = np.diff(recorded)
    back = np.flatnonzero(steps < 0)
    return StreamHealth(
        name, len(times), float(ordered[0]) if len(times) else 0.0, float(ordered[-1]) if len(times) else 0.0, interval,
        np.column_stack([ordered[silent], intervals[silent]]), np.column_stack([recorded[back], -steps[back]]))


def _odometry(own: Array, apart: Array) -> StreamHealth | None:
    """Of readings ``(M, 5)`` that came with scans, and apart from them."""
    readings = apart if len(apart) else own
    return stream_health("odometry", readings[:, 0], readings[:, 4]) if len(readings) else None


def _gyro(readings: Array) -> GyroHealth:
    """Of turn rates ``(G, 3)`` in the order of time."""
    times, rates = readings[:, 0], readings[:, 1]
    first = np.flatnonzero(np.diff(np.floor(times), prepend=-np.inf) > 0)
    number = np.diff(first, append=len(rates))
    mean = np.add.reduceat(rates, first) / number
    spread = np.sqrt(np.maximum(np.add.reduceat(rates**2, first) / number - mean**2, 0.0))
    calm = np.argsort(spread, kind="stable")[: max(len(first) // 10, 1)]
    fastest = float(np.abs(rates).max())
    return GyroHealth(
        stream=stream_health("gyro", times, readings[:, 2]),
        quiet=float(np.median(mean[calm])),
        fastest=fastest,
        constant=float(np.mean(np.diff(rates) == 0.0)) if len(rates) > 1 else 0.0,
        saturated=_at_limit(rates) + _at_limit(-rates),
    )


def _at_limit(rates: Array) -> int:
    """How many rates are at the upper end of the scale; 0 where they do not reach it."""
    levels, counts = np.unique(rates, return_counts=True)
    if len(levels) < FEW_RATES or levels[-1] <= 0.0 or counts[-1] < SATURATED:
        return 0
    return int(counts[-1]) if counts[-1] > SATURATED_FACTOR * counts[-1 - NEXT_RATES : -1].max() else 0


def _way(readings: Array) -> tuple[tuple[float, float], Array]:
    """Distance and turn along readings ``(M, 5)`` in the order given, and the jumps ``(J, 2)`` that do not count."""
    steps = np.diff(readings[:, :4], axis=0)
    seconds = np.maximum(np.abs(steps[:, 0]), JITTER)
    length, turn = np.hypot(steps[:, 1], steps[:, 2]), np.abs(wrap(steps[:, 3]))
    far = (length > FASTEST * seconds) | (turn > FASTEST_TURN * seconds)
    return (float(length[~far].sum()), float(turn[~far].sum())), np.column_stack([readings[1:, 0], length])[far]


def _laser(table: ScanTable) -> LaserHealth:
    ranges = table.ranges
    beams, scans = np.unique(table.count, return_counts=True)
    order = np.argsort(table.position, kind="stable")
    usual = np.flatnonzero(table.count == beams[np.argmax(scans)])
    increment = float(np.median(np.abs(table.angle_increment[usual])))
    # Scans that were left out stand in the flat array too.
    edges = np.zeros(len(ranges) + 1, dtype=np.int64)
    np.add.at(edges, table.first, 1)
    np.add.at(edges, table.first + table.count, -1)
    kept = ranges[np.cumsum(edges[:-1]) > 0]
    returns = kept[np.isfinite(kept)]
    total = max(len(kept), 1)
    return LaserHealth(
        beams=dict(zip(beams.tolist(), scans.tolist(), strict=True)),
        beam_changes=int(np.count_nonzero(np.diff(table.count[order]))),
        field_of_view=increment * float(max(beams[np.argmax(scans)] - 1, 0)),
        resolution=increment,
        range_min=float(np.max(table.range_min)),
        range_max=float(np.max(table.range_max)),
        no_return=float(np.count_nonzero(np.isposinf(kept)) / total),
        invalid=float(np.count_nonzero(np.isnan(kept)) / total),
        longest=float(np.max(returns, initial=0.0)),
        median=float(np.median(returns)) if len(returns) else 0.0,
        T_robot_sensor=table.T_robot_sensor,
    )


def _problems(health: LogHealth) -> list[str]:
    found = []
    if health.odometry is None:
        found.append("no odometry: the map is made from scans and gyro" if health.gyro and health.gyro.usable else
                     "no odometry: map with --no-odometry, from the scans alone")
    gyro = health.gyro
    for stream in (health.scans, health.odometry, None if gyro is None else gyro.stream):
        if stream is None:
            continue
        if len(stream.gaps):
            start, longest = stream.gaps[np.argmax(stream.gaps[:, 1])]
            found.append(f"{stream.name}: {_times(len(stream.gaps))} silent for long, at most {longest:.1f} s "
                         f"({start - health.scans.first:.1f} s after the first scan)")
        if len(stream.steps_back):
            found.append(f"{stream.name}: the clock steps back {_times(len(stream.steps_back))} in the file, "
                         f"by at most {np.max(stream.steps_back[:, 1]):.3g} s")
    if health.distance_by_time > ZIGZAG * health.distance:
        found.append(f"sorted by time the odometry zigzags over {health.distance_by_time:.0f} m, in the order of the "
                     f"file it drives {health.distance:.0f} m: records were stamped late")
    if len(health.jumps):
        found.append(f"odometry jumps {_times(len(health.jumps))}, by at most {np.max(health.jumps[:, 1]):.1f} m: "
                     "it was reset or is damaged")
    if gyro is not None:
        found += _gyro_problems(gyro)
    laser = health.laser
    if len(laser.beams) > 1:
        counts = ", ".join(f"{scans:,} of {beams}" for beams, scans in laser.beams.items())
        found.append(f"the number of beams changes {_times(laser.beam_changes)}: {counts}")
    if laser.no_return > 0.5:
        found.append(f"{100 * laser.no_return:.0f} % of the beams met nothing: an open place, or a short reach")
    if laser.invalid > 0.1:
        found.append(f"{100 * laser.invalid:.0f} % of the beams are no distance")
    found += [f"left out: {count:,} x {reason}" for reason, count in health.skipped.items()]
    return found


def _gyro_problems(gyro: GyroHealth) -> list[str]:
    found = []
    if gyro.constant >= STUCK:
        found.append(f"gyro: {100 * gyro.constant:.0f} % of the readings repeat the one before: it is stuck")
    elif gyro.saturated:
        found.append(f"gyro: {gyro.saturated:,} readings at {np.degrees(gyro.fastest):.0f} degrees a second, the end "
                     "of its scale: faster turns are not told")
    if gyro.stream.count == 1:
        found.append("gyro: only one reading")
    elif gyro.stream.rate < SLOWEST_GYRO:
        found.append(f"gyro: only {gyro.stream.rate:.2g} readings a second")
    return found


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count:,} times"
