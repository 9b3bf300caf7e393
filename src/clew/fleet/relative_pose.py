"""Where two robots' world frames stand to each other, or why that cannot be told."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from clew.errors import InputError
from clew.fleet.constellation import Agreement, PointMap, find_agreement, match_unique, share_in_common_area
from clew.fleet.robot import Encounters, RobotGraph
from clew.geometry import SE2, se2

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class MergeOptions:
    """When two maps count as overlapping.

    Attributes:
        minimum: least number of common landmarks; three points are the least that can contradict.
        confidence: of the gate within which two landmarks are the same.
        slack: standard deviation of what a map's own covariance leaves out, metres a landmark.
        identity_slack: the same for landmarks that carry identities: these need not prove to be the same by their
            places, and only a gross contradiction counts as a disagreement.
        log10_false_alarms: a constellation without identities is believed when fewer poses than this are
            expected to fit as well by chance.
        runner_up: greatest share of the common landmarks (those beyond two, which always fit) that another pose
            may bring together as well; above it, the constellation is ambiguous.
        common_share: least share of common landmarks among those that stand in the area of the common ones.
        minimum_sightings: landmarks seen less often are left out of constellations (false sightings).
        heading: greatest standard deviation of the relative heading, radians.
        minimum_edges: least number of relative poses between two robots' graphs that must agree.
        edge_slack: standard deviations of what the robots' own graphs are wrong by at such a relative pose,
            metres and radians.
        seed: of choices where there are more proposals than can be tried.
    """

    minimum: int = 3
    confidence: float = 0.997
    slack: float = 0.05
    identity_slack: float = 0.2
    log10_false_alarms: float = -8.0
    runner_up: float = 0.5
    common_share: float = 0.5
    minimum_sightings: int = 2
    heading: float = np.radians(10.0)
    minimum_edges: int = 2
    edge_slack: tuple[float, float] = (0.3, 0.1)
    seed: int = 0

    @property
    def gate(self) -> float:
        """Squared Mahalanobis distance of two positions of one landmark."""
        return float(chi2.ppf(self.confidence, 2))


class Verdict(str, Enum):
    """How the search for a relative pose ended; the values are sentences."""

    FOUND = "the maps overlap"
    TOO_FEW = "there are fewer common landmarks than it takes"
    AMBIGUOUS = "another relative pose explains nearly as many landmarks"
    BY_CHANCE = "as many landmarks may agree by chance"
    CONTRADICTED = "where both robots have been, they saw different landmarks"
    UNCERTAIN = "the common landmarks leave the heading open"


@dataclass(frozen=True, eq=False)
class RelativePose:
    """Result of `relative_pose`.

    Attributes:
        verdict: whether there is one, or why not.
        T_a_b: ``(3,)`` world frame of robot b in that of robot a; zero unless found.
        covariance: ``(3, 3)`` in its tangent; zero unless found.
        common: ``(n, 2)`` indices of landmarks of a and of b that are the same, empty unless found.
        support: number of points (landmarks and encounters) that agree on the best pose.
        runner_up: number that agree on the next best one.
        log10_false_alarms: see `find_agreement`; nan where it was not asked.
    """

    verdict: Verdict
    T_a_b: Array
    covariance: Array
    common: Index
    support: int = 0
    runner_up: int = 0
    log10_false_alarms: float = float("nan")


def relative_pose(a: RobotGraph, b: RobotGraph, options: MergeOptions | None = None) -> RelativePose:
    """Where robot b's world stands in robot a's, from common landmarks and from encounters; no initial guess.

    Landmarks of the same identity are the same. Where the robots share fewer than three of them, encounters
    included, the landmarks without identity are compared by their constellation.

    Raises:
        InputError: the robots disagree about identities (they are named).
    """
    options = options or MergeOptions()
    known = _known_pairs(a, b, options)
    if len(known[0]) >= options.minimum:
        return _by_identity(a, b, known, options)
    return _by_constellation(a, b, options)


def _by_identity(a: RobotGraph, b: RobotGraph, known: tuple[PointMap, PointMap, list[str]],
                 options: MergeOptions) -> RelativePose:
    """From points that both robots know to be the same."""
    points_a, points_b, names = known
    same = np.eye(len(names), dtype=bool)
    found = find_agreement(points_a, points_b, same, gate=options.gate, seed=options.seed)
    support = 0 if found is None else len(found.pairs)
    identified = [row for row, name in enumerate(names) if name]
    agreed = set() if found is None else set(found.pairs[:, 0].tolist())
    strangers = [names[row] for row in identified if row not in agreed]
    if found is None or support < options.minimum or 2 * len(strangers) > len(identified):
        if len(identified) >= options.minimum:
            raise InputError(
                f"robots {a.name} and {b.name} disagree about identities: no relative pose brings three of their "
                f"common landmarks together ({', '.join(names[row] for row in identified)}); correct the identities")
        return _refused(Verdict.TOO_FEW, found)
    if strangers:
        raise InputError(
            f"robots {a.name} and {b.name} disagree about identities: {', '.join(strangers)} "
            f"stand elsewhere in the one map than in the other (the other {support} common points agree); "
            "correct or remove these identities")
    if _ambiguous(found, options):
        return _refused(Verdict.AMBIGUOUS, found)
    return _accepted(a, b, found, options)


def _by_constellation(a: RobotGraph, b: RobotGraph, options: MergeOptions) -> RelativePose:
    """From the distances between landmarks."""
    rows_a, rows_b = _often_seen(a, options), _often_seen(b, options)
    if min(len(rows_a), len(rows_b)) < options.minimum:
        return _refused(Verdict.TOO_FEW, None)
    map_a, map_b = _points(a, rows_a, options.slack), _points(b, rows_b, options.slack)
    compatible = _compatible(a, b)[np.ix_(rows_a, rows_b)]
    found = find_agreement(map_a, map_b, compatible, gate=options.gate, seed=options.seed)
    if found is None or len(found.pairs) < options.minimum:
        return _refused(Verdict.TOO_FEW, found)
    if found.log10_false_alarms > options.log10_false_alarms:
        return _refused(Verdict.BY_CHANCE, found)
    if _ambiguous(found, options):
        return _refused(Verdict.AMBIGUOUS, found)
    if share_in_common_area(map_a, map_b, found.fit.T_a_b, found.pairs) < options.common_share:
        return _refused(Verdict.CONTRADICTED, found)
    return _accepted(a, b, found, options)


def _accepted(a: RobotGraph, b: RobotGraph, found: Agreement, options: MergeOptions) -> RelativePose:
    """The pose, with all landmarks that it brings together beyond doubt."""
    if found.fit.covariance[2, 2] > options.heading**2:
        return _refused(Verdict.UNCERTAIN, found)
    map_a, map_b = (_points(robot, np.arange(len(robot.landmarks)), options.slack) for robot in (a, b))
    everything = match_unique(map_a, map_b, found.fit, _compatible(a, b), options.gate)
    return RelativePose(Verdict.FOUND, found.fit.T_a_b, found.fit.covariance, everything, len(found.pairs),
                        found.runner_up, found.log10_false_alarms)


def _refused(verdict: Verdict, found: Agreement | None) -> RelativePose:
    numbers = (0, 0, float("nan")) if found is None else (
        len(found.pairs), found.runner_up, found.log10_false_alarms)
    return RelativePose(verdict, np.zeros(3), np.zeros((3, 3)), np.empty((0, 2), np.int64), *numbers)


def _ambiguous(found: Agreement, options: MergeOptions) -> bool:
    return found.runner_up - 2 > options.runner_up * (len(found.pairs) - 2)


def _often_seen(robot: RobotGraph, options: MergeOptions) -> Index:
    return np.flatnonzero(robot.landmarks.sightings >= options.minimum_sightings)


def _points(robot: RobotGraph, rows: Index, slack: float) -> PointMap:
    marks = robot.landmarks
    return PointMap(marks.positions[rows], marks.covariances[rows] + slack**2 * np.eye(2))


def _compatible(a: RobotGraph, b: RobotGraph) -> NDArray[np.bool_]:
    """Which landmarks may be the same: of one identity, or one of them without; an identity that both know
    stands for itself only."""
    names_a, names_b = a.landmarks.identities, b.landmarks.identities
    shared = np.intersect1d(names_a[names_a != ""], names_b[names_b != ""])
    free_a, free_b = ~np.isin(names_a, shared), ~np.isin(names_b, shared)
    either = ((names_a == "")[:, None] | (names_b == "")[None]) & free_a[:, None] & free_b[None]
    return np.asarray(either | ((names_a[:, None] == names_b[None]) & (names_a != "")[:, None]))


def _known_pairs(a: RobotGraph, b: RobotGraph, options: MergeOptions) -> tuple[PointMap, PointMap, list[str]]:
    """Points known to be the same: landmarks by identity, and robots that were seen (without a name)."""
    names_a, names_b = a.landmarks.identities, b.landmarks.identities
    shared = np.intersect1d(names_a[names_a != ""], names_b[names_b != ""])
    rows = [np.array([np.flatnonzero(names == s)[0] for s in shared], dtype=np.int64) for names in (names_a, names_b)]
    map_a, map_b = (_points(robot, at, options.identity_slack) for robot, at in zip((a, b), rows, strict=True))
    seen_a, at_b = _met(a, b, options)
    seen_b, at_a = _met(b, a, options)
    names = [str(s) for s in shared] + [""] * (len(seen_a) + len(seen_b))
    return _join(map_a, seen_a, at_a), _join(map_b, at_b, seen_b), names


def _met(observer: RobotGraph, seen: RobotGraph, options: MergeOptions) -> tuple[PointMap, PointMap]:
    """Where `observer` saw `seen`, in the observer's world, and where `seen` was, in its own."""
    met = observer.encounters
    rows = np.empty(0, np.int64) if met is None else np.flatnonzero(met.others == seen.name)
    if met is None or not len(rows):
        nothing = PointMap(np.empty((0, 2)), np.empty((0, 2, 2)))
        return nothing, nothing
    poses, covariances = _poses(observer, met.poses[rows])
    local, spread = _polar(met, rows)
    by_pose, by_point = se2.act_jacobians(poses, local)
    there = (by_pose @ covariances @ np.swapaxes(by_pose, 1, 2) + by_point @ spread @ np.swapaxes(by_point, 1, 2))
    own, own_covariances = _poses(seen, met.other_poses[rows])
    turn = se2.act_jacobians(own, np.zeros((len(own), 2)))[0]
    floor = (options.slack**2 + met.mounting**2) * np.eye(2)
    return (PointMap(se2.act(poses, local), there + floor),
            PointMap(own[:, :2], turn @ own_covariances @ np.swapaxes(turn, 1, 2) + floor))


def _polar(met: Encounters, rows: Index) -> tuple[Array, Array]:
    """Points ``(n, 2)`` of ranges and bearings and their covariances, in the observer's frame."""
    r, c, s = met.ranges[rows], np.cos(met.bearings[rows]), np.sin(met.bearings[rows])
    jacobian = np.stack([np.stack([c, -r * s], axis=1), np.stack([s, r * c], axis=1)], axis=1)
    return np.stack([r * c, r * s], axis=1), jacobian @ met.covariance @ np.swapaxes(jacobian, 1, 2)


def _poses(robot: RobotGraph, keys: Index) -> tuple[Array, Array]:
    """Values ``(n, 3)`` and covariances ``(n, 3, 3)`` of poses."""
    places = robot.graph.positions(keys)
    return robot.solution.values(SE2).array[places], robot.solution.covariances(SE2)[places]


def _join(*maps: PointMap) -> PointMap:
    return PointMap(np.concatenate([m.points for m in maps]), np.concatenate([m.covariances for m in maps]))
