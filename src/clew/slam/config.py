"""The one configuration that serves every log."""

from __future__ import annotations

from dataclasses import dataclass, field

from clew.motion import GyroNoise, OdometryNoise
from clew.place import ConsistencyOptions, VerificationOptions
from clew.scan import AlignmentOptions, CleaningOptions


@dataclass(frozen=True)
class TrackingOptions:
    """How each scan is matched against the local map.

    Attributes:
        still_distance, still_angle: a robot that moved less since the last matched scan is not matched again,
            metres and radians.
        keyframe_distance, keyframe_angle, keyframe_seconds: a scan becomes a keyframe when the robot has driven,
            turned or waited this much since the last one (waited: and moved at all).
        map_keyframes: how many recent keyframes make the local map.
        resolution, sigma: cell and blur of the correlative search, metres.
        window_sigmas: half of the search window in deviations of the prediction,
        window_floor: and its least half size, metres, metres, radians,
        window_ceiling: and its largest: the time of a search grows with its window.
        fastest: odometry that claims a greater speed, metres a second, has jumped, as when it is reset; motion is
            predicted without it,
        carry_on: by the last velocity, for so many seconds at most.
        prior_weight: weight of the prediction against the mean likelihood in the search,
        prior_floor: where its deviations are taken as these at least, metres, metres, radians: odometry that halts for
            a moment is sure of itself and wrong.
        voxel: side of a surfel of the local map, metres.
        overlap: a match that explains less of the scan is not believed; odometry carries on.
        velocity_sigmas: deviation of a prediction by constant velocity, where there is no odometry,
            metres and radians a second.
    """

    still_distance: float = 0.03
    still_angle: float = 0.01
    keyframe_distance: float = 0.4
    keyframe_angle: float = 0.35
    keyframe_seconds: float = 10.0
    map_keyframes: int = 20
    resolution: float = 0.05
    sigma: float = 0.06
    window_sigmas: float = 5.0
    window_floor: tuple[float, float, float] = (0.3, 0.3, 0.2)
    window_ceiling: tuple[float, float, float] = (5.5, 5.5, 3.2)
    fastest: float = 5.0
    carry_on: float = 1.0
    prior_weight: float = 0.04
    prior_floor: tuple[float, float, float] = (0.05, 0.05, 0.05)
    voxel: float = 0.05
    overlap: float = 0.3
    velocity_sigmas: tuple[float, float] = (0.6, 0.8)


@dataclass(frozen=True)
class ClosingOptions:
    """Where closures are looked for, and which are believed.

    Attributes:
        path: metres driven since the older keyframe before it can be closed with.
        every: metres driven between two attempts,
        every_known: and where the place is covered by enough keyframes (`PruningOptions.cover`).
        anchor_every: one keyframe in so many carries a submap.
        submap_keyframes: keyframes on each side of the anchor in its submap.
        query_keyframes: recent keyframes that make the query.
        reach: a submap is a candidate when it may lie this close, metres.
        candidates: submaps that are matched at most in one attempt,
        lost_candidates: and while the robot may be further than `reach` from where it is believed.
        similarity: least likeness of the descriptors; what looks less alike shares too little.
        caution: factor on the covariance of the prediction: drift is not quite the sum of independent errors.
        sigmas: half of the search window in deviations of the prediction,
        window_floor: its least half size, metres and radians.
        gate: largest squared Mahalanobis distance between measured and predicted pose.
        tracked: a closure that moves a robot whose place is certain by less than this, metres and radians, needs no
            other to agree;
        supporters: any other needs so many that do,
        support_apart: which share no scan with it nor with each other, at least this many metres of path apart,
        support_path: from sources within this many metres of path.
        settled: a closure that moves the robot by less than this, metres and radians, changes nothing at once;
        batch: so many of them are optimised together.
        open_sources: keyframes that could not be closed yet and are kept in mind at most: once the robot knows where it
            is they are tried again.
        cached_submaps: submaps kept in memory.
        information_scale: share of the query's returns that tell something new: the errors of submap and query are
            those of the ways along which they were seen.
        kernel_scale: scale of the robust kernel on closures (Huber: convex, so that a right closure pulls from any
            distance), in whitened residuals.
        residual: a closure with a larger squared residual after optimisation is withdrawn.
    """

    path: float = 12.0
    every: float = 0.8
    every_known: float = 2.4
    anchor_every: int = 4
    submap_keyframes: int = 8
    query_keyframes: int = 8
    reach: float = 5.0
    candidates: int = 3
    lost_candidates: int = 8
    similarity: float = 0.2
    caution: float = 3.0
    sigmas: float = 3.0
    window_floor: tuple[float, float] = (0.3, 0.06)
    gate: float = 16.3
    tracked: tuple[float, float] = (0.3, 0.06)
    supporters: int = 2
    support_apart: float = 3.0
    support_path: float = 20.0
    settled: tuple[float, float] = (0.05, 0.01)
    batch: int = 5
    open_sources: int = 300
    cached_submaps: int = 64
    information_scale: float = 0.035
    kernel_scale: float = 3.0
    residual: float = 40.0


@dataclass(frozen=True)
class RefinementOptions:
    """The joint refinement of all keyframes against each other.

    Attributes:
        radius: pairs of keyframes within this distance, metres,
        neighbours: at most so many a keyframe.
        overlap: pairs that share less are left out.
        rounds: how often correspondences are sought again at most.
        movement: it has converged when no keyframe moves more, metres.
        information_scale: share of the returns of a pair that tell something new, before the pairs themselves tell
            (`clew.slam.pair_noise`).
    """

    radius: float = 4.0
    neighbours: int = 12
    overlap: float = 0.4
    rounds: int = 4
    movement: float = 0.002
    information_scale: float = 0.45


@dataclass(frozen=True)
class PruningOptions:
    """Which keyframes are redundant (`clew.slam.pruning`).

    Attributes:
        enabled: whether any are taken out.
        radius, angle: keyframes that stand closer together and face the same way look at one place, metres and radians.
        cover: so many of them cover it.
        path: metres driven since a keyframe before it is looked at,
        recent: and so many keyframes taken since.
        batch: so many are looked at together.
        candidates: how many are tried for each that comes of age.
        overlap: share of its returns that a redundant keyframe shares with its neighbours,
        movement: and how far it may lie from where its returns put it, metres.
        most_loss: information that may be lost with one keyframe, nats.
        scans: scans that are kept of one keyframe for the map.
    """

    enabled: bool = True
    radius: float = 1.0
    angle: float = 0.8
    cover: int = 8
    path: float = 20.0
    recent: int = 40
    batch: int = 8
    candidates: int = 3
    overlap: float = 0.6
    movement: float = 0.1
    most_loss: float = 10.0
    scans: int = 64


@dataclass(frozen=True)
class SlamConfig:
    """All that can be set; the defaults are meant for every log.

    Attributes:
        cleaning, odometry, gyro, tracking, closing, verification, consistency, pruning, refinement: the parts of the
            pipeline.
        alignment: how returns are weighted wherever scans are aligned; closing and refining seek partners within
            radii of their own.
        map_resolution: side of a cell of the map, metres.
        threads: threads of the refinement; the result does not depend on them.
    """

    cleaning: CleaningOptions = field(default_factory=CleaningOptions)
    odometry: OdometryNoise = field(default_factory=OdometryNoise)
    gyro: GyroNoise = field(default_factory=GyroNoise)
    tracking: TrackingOptions = field(default_factory=TrackingOptions)
    alignment: AlignmentOptions = field(default_factory=AlignmentOptions)
    closing: ClosingOptions = field(default_factory=ClosingOptions)
    verification: VerificationOptions = field(default_factory=VerificationOptions)
    consistency: ConsistencyOptions = field(default_factory=ConsistencyOptions)
    pruning: PruningOptions = field(default_factory=PruningOptions)
    refinement: RefinementOptions = field(default_factory=RefinementOptions)
    map_resolution: float = 0.05
    threads: int = 2
