"""Loop closures as evidence: what was measured, and why it is believed or not."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Verdict(str, Enum):
    """What became of a candidate; the value is the sentence for reports."""

    CONFIRMED = "confirmed"
    WAITING = "waits for others that agree"
    NO_MATCH = "no pose in the window explains the scans"
    AMBIGUOUS = "another pose explains the scans as well"
    LITTLE_OVERLAP = "too little of the scans overlaps"
    ROUGH = "surfaces do not lie on each other"
    CONTRADICTED = "returns lie where the other scans saw free space"
    SEEN_THROUGH = "rays pass through surfaces of the other scans"
    DISAGREES = "disagrees with the graph beyond its uncertainty"
    REDUNDANT = "says the same as a better one of this keyframe"
    ALONE = "no other closure agrees"
    WITHDRAWN = "contradicted by the optimised graph"


@dataclass(frozen=True)
class Closure:
    """A candidate closure from keyframe `source` to an older keyframe `target`, with its evidence.

    Attributes:
        source, target: indices of keyframes.
        similarity: likeness of the two descriptors, in [0, 1].
        verdict: what the evidence says so far.
        T_target_source: ``(3,)`` measured pose of the source seen from the target.
        information: ``(3, 3)`` of that pose, in its tangent; of a confirmed closure the one that the graph uses.
        likelihood: mean likelihood of the source's points at the best pose of the search.
        overlap: share of the source's points with a partner in the target.
        rms: residual along the normals, metres.
        contradiction: share of the source's points that lie in the target's free space.
        innovation: metres and radians between measured and predicted pose.
        seen_through: share of the target's surfaces within the source's view that lie in the source's free space.
        rival: likelihood of the best pose elsewhere in the window as a share of the best one's; 0 where there is none
            that comes near.
        telling: returns that fit here and not elsewhere along a corridor, less those that do the contrary, where one
            pose in the window seemed to be the only one; 0 where none does, or none was asked.
        in_row: matches in a row that told together where along a corridor this one is; 0 where it tells by itself.
        within: and how far along it it may be off, two deviations by them, metres; 0 where it tells by itself.
        distance: squared Mahalanobis distance between measured and predicted pose.
        is_certain: whether the robot was known so well that a match within the window could not be another place.
        is_partial: whether it tells nothing along one direction, in which the scans fit at several poses.
        supporters: closures from other places that agree.
        T_predicted: ``(3,)`` pose of the source seen from the target that was expected before the match; nan where
            nothing was.
    """

    source: int
    target: int
    similarity: float
    verdict: Verdict
    T_target_source: Array
    information: Array
    likelihood: float = 0.0
    overlap: float = 0.0
    rms: float = 0.0
    contradiction: float = 0.0
    innovation: tuple[float, float] = (0.0, 0.0)
    seen_through: float = 0.0
    rival: float = 0.0
    telling: int = 0
    in_row: int = 0
    within: float = 0.0
    distance: float = 0.0
    is_certain: bool = False
    is_partial: bool = False
    supporters: int = 0
    T_predicted: Array = field(default_factory=lambda: np.full(3, np.nan))
