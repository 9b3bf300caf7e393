"""Does a query fit a submap, and only there?"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2
from clew.place.closure import Closure, Verdict
from clew.place.submap import Submap
from clew.scan import AlignmentOptions, ScanPoints, SourceClouds, align, correlate, merge_surfels

Array = NDArray[np.float64]


@dataclass(frozen=True)
class VerificationOptions:
    """What a closure must show before it is considered at all.

    Attributes:
        likelihood: least mean likelihood of the query's points at the best pose.
        rival_distance, rival_angle: poses further than this from the best are rivals, metres and radians.
        rival_ratio: a rival with this share of the best likelihood makes the match ambiguous.
        overlap: least share of the query's points with a partner.
        rms: largest residual along the normals, metres.
        contradiction: largest share of returns in free space.
        radius_start, radius_end: partners are sought within these in the alignment, metres.
        voxel: for the search the query is thinned to one point per square of this side,
        fine_voxel: and for the alignment of this one, metres.
    """

    likelihood: float = 0.5
    rival_distance: float = 0.8
    rival_angle: float = 0.35
    rival_ratio: float = 0.9
    overlap: float = 0.55
    rms: float = 0.035
    contradiction: float = 0.15
    radius_start: float = 0.35
    radius_end: float = 0.15
    voxel: float = 0.2
    fine_voxel: float = 0.1


def verify(
    submap: Submap,
    query: ScanPoints,
    source: int,
    T_predicted: Array,
    half_window: Array,
    prior_information: Array,
    similarity: float,
    options: VerificationOptions,
    alignment: AlignmentOptions,
) -> Closure:
    """Match a query against a submap within a window, and weigh the evidence of the two alone.

    Args:
        submap: the older place.
        query: points about keyframe `source`, in its frame.
        T_predicted: ``(3,)`` expected pose of the source in the submap's frame.
        half_window: ``(3,)`` half size of the search window, metres, metres, radians.
        prior_information: ``(3, 3)`` of `T_predicted`, in units of the returns' information. It decides only where
            the returns do not, as along a bare corridor.
        similarity: cosine of the descriptors, kept as evidence.
        options: see `VerificationOptions`.
        alignment: how returns are weighted in the alignment.
    """
    thinned = merge_surfels(query, options.voxel)
    closure = Closure(
        source, submap.keyframe, similarity, Verdict.NO_MATCH, T_predicted, np.zeros((3, 3)), T_predicted=T_predicted
    )
    best = correlate(
        submap.pyramid, thinned.points, T_predicted, half_window, minimum_score=options.likelihood
    )
    if best is None:
        return closure
    closure = replace(closure, likelihood=best.likelihood)
    rival = correlate(
        submap.pyramid, thinned.points, T_predicted, half_window,
        minimum_score=options.rival_ratio * best.likelihood,
        exclude=(best.T_target_source, options.rival_distance, options.rival_angle),
    )  # fmt: skip
    if rival is not None:
        return replace(closure, verdict=Verdict.AMBIGUOUS, T_target_source=best.T_target_source)
    fine = align(
        submap.index, SourceClouds.single(merge_surfels(query, options.fine_voxel)), np.zeros((1, 2), dtype=np.int32),
        best.T_target_source[None],
        T_prior=T_predicted[None], prior_information=prior_information[None],
        options=replace(alignment, radius_start=options.radius_start, radius_end=options.radius_end),
    )  # fmt: skip
    T = fine.T_target_source[0]
    error = se2.between(T_predicted, T)
    closure = replace(
        closure,
        T_target_source=T,
        information=fine.information[0],
        overlap=float(fine.overlap[0]),
        rms=float(fine.rms[0]),
        contradiction=submap.contradicted_share(thinned.transformed(T).points),
        innovation=(float(np.hypot(error[0], error[1])), float(abs(error[2]))),
        verdict=Verdict.WAITING,
    )
    if closure.overlap < options.overlap:
        return replace(closure, verdict=Verdict.LITTLE_OVERLAP)
    if closure.rms > options.rms:
        return replace(closure, verdict=Verdict.ROUGH)
    if closure.contradiction > options.contradiction:
        return replace(closure, verdict=Verdict.CONTRADICTED)
    return closure
