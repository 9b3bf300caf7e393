"""The part of ``clew evaluate --self`` that looks at scans: pairwise alignment, and returns in the world."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError
from clew.evaluate import PairErrors, WallSpread, associate, pair_errors, revisiting_pairs, wall_spread
from clew.geometry import se2, se3
from clew.io import Log
from clew.motion import body_velocities
from clew.scan import (
    AlignmentOptions,
    BeamTimes,
    CleaningOptions,
    IndexedClouds,
    LaserScan,
    ScanPoints,
    align,
    deskew,
    extract_points,
    index_cloud,
    join,
)
from clew.slam.timing import beam_times_of

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

SAME_MOMENT = 1e-3  # seconds between a pose and its scan at most
LEAST_OVERLAP = 0.6
#: A pair is well conditioned when its returns hold it this well in their worst direction, metres and radians,
WORST_DEVIATION = (0.005, np.radians(0.1))
LEAST_INFORMATION = 1.0  # in any direction; less is a singular matrix, 1 / m^2 and 1 / rad^2
#: and when either scan as the one that moves gives the same pose within these.
AGREEMENT = (0.02, np.radians(0.3))
#: Tight: partners no further away than the noise of the trajectory and of the returns.
ALIGNMENT = AlignmentOptions(radius_start=0.3, radius_end=0.08, iterations=40)
PAIRS_AT_ONCE = 250
SPREAD_STEP = 0.2  # metres of way between scans whose returns make the walls


@dataclass(frozen=True)
class SelfEvaluation:
    """A trajectory against its own scans.

    Attributes:
        pairs: relative poses against the alignment of the two scans.
        disagreement: mean distance between the results of the two directions of alignment, metres and radians: what
            the measurement itself is uncertain by.
        spread: of returns about their walls.
        beam_times: when the beams of a scan were measured, as found where the log does not tell.
    """

    pairs: PairErrors
    disagreement: tuple[float, float]
    spread: WallSpread
    beam_times: BeamTimes

    def to_dict(self) -> dict[str, object]:
        """Plain numbers; metres and degrees."""
        metres, radians = (None if np.isnan(value) else value for value in self.disagreement)
        return {"pairs": self.pairs.to_dict(), "spread": self.spread.to_dict(),
                "alignment_disagreement_m": metres,
                "alignment_disagreement_deg": None if radians is None else float(np.degrees(radians)),
                "sweep_found_s": self.beam_times.sweep, "interlace_found_s": self.beam_times.interlace}


def in_plane(poses: Array) -> Array:
    """``(N, 3)`` poses as seen from above; in SE3 storage ``(N, 7)`` the robot's x axis gives the heading."""
    if poses.shape[1] == 3:
        return poses
    forward = se3.act(poses, np.array([1.0, 0.0, 0.0])) - poses[:, :3]
    return np.column_stack([poses[:, :2], np.arctan2(forward[:, 1], forward[:, 0])])


def evaluate_self(
    timestamps: Array, poses: Array, log: Log, progress: Callable[[int, int], None] | None = None
) -> SelfEvaluation:
    """Judge a trajectory by the scans of its log.

    Args:
        timestamps: ``(N,)`` seconds.
        poses: ``(N, 3)`` poses of the robot.
        log: where the scans come from.
        progress: called with the pairs of scans aligned and of all.

    Raises:
        InputError: trajectory and log have fewer than two moments in common.
    """
    scans = sorted((m for m in log.measurements() if isinstance(m, LaserScan)), key=lambda scan: scan.timestamp)
    stamps = np.array([scan.timestamp for scan in scans])
    timestamps, first = np.unique(timestamps, return_index=True)
    poses = poses[first]
    in_log, in_trajectory = associate(stamps, timestamps, SAME_MOMENT)
    if len(in_log) < 2:
        raise InputError(f"{log.path}: {len(in_log)} of its {len(scans)} scans are at a time of the trajectory: "
                         "give the log that the trajectory was made from")
    timestamps, poses = timestamps[in_trajectory], poses[in_trajectory]
    scans = [scans[i] for i in in_log]
    times = BeamTimes()
    if not any(scan.is_sweep for scan in scans):
        chosen = _along_the_way(poses)
        period = float(np.median(np.diff(np.unique(stamps))))
        times = beam_times_of(
            timestamps, poses, chosen, [scans[i] for i in chosen], CleaningOptions(), period=period
        )
        scans = [times.of(scan) for scan in scans]
    scans = without_motion(scans, timestamps, poses)
    pairs, disagreement = _judge_pairs(timestamps, poses, scans, progress)
    return SelfEvaluation(pairs, disagreement, _judge_spread(poses, scans), times)


def without_motion(scans: Sequence[LaserScan], timestamps: Array, poses: Array) -> list[LaserScan]:
    """Scans as they would have been measured all at once, each at its timestamp.

    The trajectory tells how fast the robot moved during a sweep, and nothing else of it: where the trajectory has the
    scans does not enter, so a trajectory is not judged by itself. A scan that is no sweep comes back as it is, and so
    does one too far from its neighbours in time.

    Args:
        scans: one for each pose, with the moments of their beams where these are known.
        timestamps: ``(N,)`` seconds, ascending.
        poses: ``(N, 3)``, two at least.
    """
    middle = float(np.mean([0.5 * sum(scan.span) for scan in scans]))
    velocities = body_velocities(timestamps, poses, middle).velocity
    return [deskew(scan, velocity) for scan, velocity in zip(scans, velocities, strict=True)]


def _judge_pairs(
    times: Array, poses: Array, scans: Sequence[LaserScan], progress: Callable[[int, int], None] | None
) -> tuple[PairErrors, tuple[float, float]]:
    pairs = revisiting_pairs(times, poses)
    T_first_second = np.zeros((len(pairs), 3))
    known = np.zeros(len(pairs), dtype=np.bool_)
    gaps = np.zeros((len(pairs), 2))
    for begin in range(0, len(pairs), PAIRS_AT_ONCE):
        part = slice(begin, begin + PAIRS_AT_ONCE)
        rows, local = np.unique(pairs[part], return_inverse=True)
        clouds = join([index_cloud(extract_points(scans[row])) for row in rows])
        local_pairs = np.asarray(local.reshape(-1, 2), dtype=np.int32)
        T_first_second[part], known[part], gaps[part] = measure_pairs(clouds, local_pairs, poses[rows])
        if progress is not None:
            progress(min(begin + PAIRS_AT_ONCE, len(pairs)), len(pairs))
    agreement = (float(gaps[known, 0].mean()), float(gaps[known, 1].mean())) if known.any() else (np.nan, np.nan)
    return pair_errors(poses, pairs, T_first_second, known), agreement


def measure_pairs(
    clouds: IndexedClouds, pairs: NDArray[np.int32], poses: Array
) -> tuple[Array, NDArray[np.bool_], Array]:
    """Relative poses of pairs of clouds by alignment in both directions.

    Args:
        clouds: ``C`` clouds in the frame of the robot.
        pairs: ``(P, 2)``.
        poses: ``(C, 3)`` where to begin.

    Returns:
        ``(P, 3)`` pose of the second seen from the first, halfway between the two directions; ``(P,)`` where it is well
        conditioned; ``(P, 2)`` distance and angle between the directions.
    """
    T_start = se2.between(poses[pairs[:, 0]], poses[pairs[:, 1]])
    sources = clouds.as_sources()
    forth = align(clouds, sources, pairs, T_start, options=ALIGNMENT)
    back = align(clouds, sources, np.ascontiguousarray(pairs[:, ::-1]), se2.inverse(T_start), options=ALIGNMENT)
    there = forth.T_target_source
    gap = se2.log(se2.between(there, se2.inverse(back.T_target_source)))
    gaps = np.stack([np.hypot(gap[:, 0], gap[:, 1]), np.abs(gap[:, 2])], axis=1)
    enough = np.minimum(forth.overlap, back.overlap) >= LEAST_OVERLAP
    known = enough & _well_conditioned(forth.information) & _well_conditioned(back.information)
    return se2.compose(there, se2.exp(0.5 * gap)), known & (gaps <= AGREEMENT).all(axis=1), gaps


def _well_conditioned(information: Array) -> NDArray[np.bool_]:
    """Whether the returns hold a pose in every direction; information ``(P, 3, 3)``."""
    full = np.linalg.eigvalsh(information)[:, 0] > LEAST_INFORMATION
    covariance = np.linalg.inv(np.where(full[:, None, None], information, np.eye(3)))
    worst = np.sqrt(np.linalg.eigvalsh(covariance[:, :2, :2])[:, 1])
    return np.asarray(full & (worst <= WORST_DEVIATION[0]) & (np.sqrt(covariance[:, 2, 2]) <= WORST_DEVIATION[1]))


def _along_the_way(poses: Array) -> Indices:
    """Rows of poses a step of the way apart."""
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))])
    return np.unique(np.floor(way / SPREAD_STEP), return_index=True)[1]


def _judge_spread(poses: Array, scans: Sequence[LaserScan]) -> WallSpread:
    clouds: list[ScanPoints] = [extract_points(scans[i]).transformed(poses[i]) for i in _along_the_way(poses)]
    scan = np.repeat(np.arange(len(clouds)), [len(cloud) for cloud in clouds])
    return wall_spread(np.concatenate([c.points for c in clouds]), np.concatenate([c.normals for c in clouds]), scan)
