"""Loop closures as evidence: what was measured, and why it is believed or not."""

from __future__ import annotations

from dataclasses import dataclass
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
    DISAGREES = "disagrees with the graph beyond its uncertainty"
    REDUNDANT = "says the same as a better one of this keyframe"
    ALONE = "no other closure agrees"
    WITHDRAWN = "contradicted by the optimised graph"


@dataclass(frozen=True)
class Closure:
    """A candidate closure from keyframe `source` to an older keyframe `target`, with its evidence.

    Attributes:
        source, target: indices of keyframes.
        similarity: cosine of the two descriptors.
        verdict: what the evidence says so far.
        T_target_source: ``(3,)`` measured pose of the source seen from the target.
        information: ``(3, 3)`` of that pose, in its tangent.
        likelihood: mean likelihood of the source's points at the best pose of the search.
        overlap: share of the source's points with a partner in the target.
        rms: residual along the normals, metres.
        contradiction: share of the source's points that lie in the target's free space.
        innovation: metres and radians between measured and predicted pose.
        T_predicted: ``(3,)`` pose of the source seen from the target that was expected before the match; None where
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
    T_predicted: Array | None = None
