"""Does a query fit a submap, and only there?"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2
from clew.place.closure import Closure, Verdict
from clew.place.submap import SEARCH_RESOLUTION, Submap
from clew.scan import (
    Alignment,
    AlignmentOptions,
    ScanPoints,
    SourceClouds,
    align,
    correlate,
    merge_surfels,
    with_new_partners,
)

Array = NDArray[np.float64]

FITS, MISSES = 0.6, 0.2  # likelihoods of a return on a surface, and of one beside it
STEP = 0.2  # metres; between offsets along a corridor
ALONG = 0.97  # cosine of 14 degrees: how well the poses of a search tell the direction of a corridor


@dataclass(frozen=True)
class VerificationOptions:
    """What a closure must show before it is considered at all.

    Attributes:
        likelihood: least mean likelihood of the query's points at the best pose.
        rival_distance, rival_angle: poses further than this from the best are rivals, metres and radians.
        rival_ratio: a rival with this share of the best likelihood makes the match ambiguous,
        rival_search: and one with this share in the search may turn out to have it once it is aligned.
        slide_angle: rivals turned by less, radians, lie along a line with the best,
        slide_share: if the returns measure that direction by no more than this share of the other.
        telling: returns that fit at the best pose and nowhere else along such a line, less those that fit elsewhere
            alone, by which it is told from each other place there,
        telling_ratio: and how many times as many the former must be.
        overlap: least share of the query's points with a partner.
        rms: largest residual along the normals, metres.
        contradiction: largest share of returns in free space,
        seen_through: and of surfaces of the target, within the query's view, in the query's free space.
        radius_start, radius_end: partners are sought within these in the alignment, metres.
        voxel: for the search the query is thinned to one point per square of this side,
        fine_voxel: and for the alignment of this one, metres.
    """

    likelihood: float = 0.5
    rival_distance: float = 0.8
    rival_angle: float = 0.35
    rival_ratio: float = 0.9
    rival_search: float = 0.8
    slide_angle: float = 0.05
    slide_share: float = 0.3
    telling: int = 6
    telling_ratio: float = 4.0
    overlap: float = 0.55
    rms: float = 0.035
    contradiction: float = 0.15
    seen_through: float = 0.15
    radius_start: float = 0.35
    radius_end: float = 0.15
    voxel: float = 0.2
    fine_voxel: float = 0.1


def verify(
    submap: Submap,
    query: ScanPoints,
    source: int,
    T_predicted: Array,
    centre: Array,
    half_window: Array,
    prior_information: Array,
    similarity: float,
    options: VerificationOptions,
    alignment: AlignmentOptions,
    *,
    may_slide: bool = False,
) -> Closure:
    """Match a query against a submap within a window, and weigh the evidence of the two alone.

    Where the query fits at several poses along one line, as along a bare corridor or one with a door every few metres,
    the closure is partial: it holds across that line and tells nothing along it.

    Args:
        submap: the older place.
        query: points about keyframe `source`, in its frame.
        T_predicted: ``(3,)`` expected pose of the source in the submap's frame.
        centre: ``(3,)`` pose in the middle of the search window,
        half_window: ``(3,)`` its half size, metres, metres, radians.
        prior_information: ``(3, 3)`` of `T_predicted`, in units of the returns' information. It decides only where
            the returns do not, as along a bare corridor.
        similarity: likeness of the descriptors, kept as evidence.
        options: see `VerificationOptions`.
        alignment: how returns are weighted in the alignment.
        may_slide: whether a partial closure is of use; it is not while the robot may be in another corridor. Otherwise
            all that is not unique is ambiguous.
    """
    thinned = merge_surfels(query, options.voxel)
    closure = Closure(
        source, submap.keyframe, similarity, Verdict.NO_MATCH, T_predicted, np.zeros((3, 3)), T_predicted=T_predicted
    )
    best = correlate(
        submap.pyramid, thinned.points, centre, half_window, minimum_score=options.likelihood
    )
    if best is None:
        return closure
    closure = replace(closure, likelihood=best.likelihood)
    T_rival = None
    apart = (best.T_target_source, options.rival_distance, options.rival_angle)
    rival = correlate(
        submap.pyramid, thinned.points, centre, half_window,
        minimum_score=options.rival_search * best.likelihood, exclude=apart,
    )  # fmt: skip
    if rival is not None:
        T_rival, ratio = rival.T_target_source, rival.likelihood / best.likelihood
        if ratio < options.rival_ratio:
            pair = np.stack([best.T_target_source, T_rival])
            settled, likelihoods = _settled(submap, query, thinned, pair, options, alignment)
            T_rival, ratio = settled[1], likelihoods[1] / max(likelihoods[0], best.likelihood)
            if np.hypot(*se2.between(best.T_target_source, T_rival)[:2]) < options.rival_distance:
                ratio = 0.0  # it has slid to the best
        closure = replace(closure, rival=ratio)
        T_rival = T_rival if ratio >= options.rival_ratio else None
    ambiguous = replace(closure, verdict=Verdict.AMBIGUOUS, T_target_source=best.T_target_source)
    turned = T_rival is not None and abs(se2.between(best.T_target_source, T_rival)[2]) > options.slide_angle
    if T_rival is not None and (turned or not may_slide):
        return ambiguous
    thin = merge_surfels(query, options.fine_voxel)
    cloud = SourceClouds.single(thin)
    alignment = replace(alignment, radius_start=options.radius_start, radius_end=options.radius_end)
    both = np.zeros((1, 2), dtype=np.int32)

    def aligned(start: Array) -> tuple[Alignment, Array]:
        fine = align(
            submap.index, cloud, both, start[None],
            T_prior=T_predicted[None], prior_information=prior_information[None], options=alignment,
        )  # fmt: skip
        T = fine.T_target_source
        return fine, with_new_partners(submap.index, cloud, both, T, fine.information, alignment)[0]

    fine, information = aligned(best.T_target_source)
    weakest = _weakest(information, options.slide_share)
    is_partial = T_rival is not None
    if T_rival is not None and (weakest is None or not _is_along(weakest, best.T_target_source, T_rival)):
        return ambiguous
    if weakest is not None and may_slide and not is_partial:
        telling = _telling(submap, thin.points, fine.T_target_source[0], weakest, centre, half_window, options)
        closure = replace(closure, telling=telling)
        is_partial = telling < options.telling
    if is_partial and weakest is not None:
        fine, information = aligned(_slid(fine.T_target_source[0], weakest, T_predicted))
        unknown = _weakest(information, options.slide_share)
        if unknown is None:
            return replace(ambiguous, telling=closure.telling)
        information = _without(information, unknown)
    T = fine.T_target_source[0]
    error = se2.between(T_predicted, T)
    closure = replace(
        closure,
        T_target_source=T,
        information=information,
        is_partial=is_partial,
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


def look_back(closure: Closure, submap: Submap, view: Submap, options: VerificationOptions) -> Closure:
    """Weigh what the query saw of the target's surfaces: a ray that passes through them contradicts the match.

    Args:
        closure: of the query and the submap; left as it is unless it waits.
        submap: the older place.
        view: submap of the query, in the frame of its source.
        options: see `VerificationOptions`.
    """
    if closure.verdict is not Verdict.WAITING:
        return closure
    surfaces = se2.act(se2.inverse(closure.T_target_source), submap.surfels.points)
    share = view.contradicted_share(surfaces[view.observes(surfaces)])
    verdict = Verdict.SEEN_THROUGH if share > options.seen_through else Verdict.WAITING
    return replace(closure, seen_through=share, verdict=verdict)


def _settled(
    submap: Submap, query: ScanPoints, thinned: ScanPoints, poses: Array, options: VerificationOptions,
    alignment: AlignmentOptions,
) -> tuple[Array, Array]:
    """Poses ``(n, 3)`` where alignment settles from those of a search, and their likelihoods ``(n,)``.

    Half a cell of the search beside the peak costs a tenth of the likelihood, more than tells a rival from none.
    """
    aligned = align(
        submap.index, SourceClouds.single(merge_surfels(query, options.fine_voxel)),
        np.zeros((len(poses), 2), dtype=np.int32), poses,
        options=replace(alignment, radius_start=options.radius_start, radius_end=options.radius_end),
    ).T_target_source  # fmt: skip
    cell = np.array([SEARCH_RESOLUTION, SEARCH_RESOLUTION, 0.0])
    found = [correlate(submap.pyramid, thinned.points, pose, cell) for pose in aligned]
    return aligned, np.array([0.0 if match is None else match.likelihood for match in found])


def _slid(T: Array, direction: Array, T_predicted: Array) -> Array:
    """The pose on a line through a match that is nearest to the predicted one; the line is in the source's axes."""
    line = _turned(T, direction)
    slid: Array = T.copy()
    slid[:2] += line * (line @ (T_predicted[:2] - T[:2]))
    return slid


def _turned(T: Array, direction: Array) -> Array:
    """Direction ``(2,)`` in the target's frame of one ``(3,)`` in the source's."""
    return np.asarray(se2.matrix(T)[:2, :2] @ direction[:2])


def _is_along(direction: Array, best: Array, rival: Array) -> bool:
    """Whether a rival lies along a direction ``(3,)`` in the source's axes.

    The poses of a search lie on a grid, so that the line through two of them is askew by some degrees.
    """
    line = rival[:2] - best[:2]
    return bool(abs(_turned(best, direction) @ line) > ALONG * np.hypot(line[0], line[1]))


def _telling(
    submap: Submap, points: Array, T: Array, direction: Array, centre: Array, half_window: Array,
    options: VerificationOptions,
) -> int:
    """How many returns tell a match from the one that rivals it most along a line, within the window.

    The likelihood of all returns is the same all along a bare corridor, but for a few in a hundred; and it is less
    where less of the query lies in what the submap has seen, be the match right or wrong. So only returns count that
    the submap has seen the place of in both poses, and that fit in one of them alone. Few do not prove a match right:
    where beams have hit a far wall sparsely, a return beside them fits nowhere.
    """
    line = _turned(T, direction)
    middle, half = float(line @ (centre[:2] - T[:2])), float(np.abs(line) @ half_window[:2])
    far = np.arange(options.rival_distance, abs(middle) + half, STEP)
    offsets = np.concatenate([-far[::-1], far])
    offsets = offsets[np.abs(offsets - middle) <= half]
    here = se2.act(T, points)
    here = here[submap.observes(here)]
    there = (here + offsets[:, None, None] * line).reshape(-1, 2)
    shape = (len(offsets), len(here))
    both, elsewhere = submap.observes(there).reshape(shape), submap.likelihoods(there).reshape(shape)
    at_best = submap.likelihoods(here)
    for_it = np.count_nonzero(both & (at_best > FITS) & (elsewhere < MISSES), axis=1)
    against = np.count_nonzero(both & (at_best < MISSES) & (elsewhere > FITS), axis=1)
    telling = np.where(for_it >= options.telling_ratio * against, for_it - against, 0)
    return int(telling.min(initial=len(here)))


def _weakest(information: Array, share: float) -> Array | None:
    """Direction ``(3,)`` of translation that returns measure least, if much less than others."""
    values, axes = np.linalg.eigh(information[:2, :2])
    return np.append(axes[:, 0], 0.0) if values[0] <= share * values[1] else None


def _without(information: Array, direction: Array) -> Array:
    """Information ``(3, 3)`` of all but one direction ``(3,)`` (the Schur complement)."""
    column = information @ direction
    return np.asarray(information - np.outer(column, column) / max(float(direction @ column), 1e-12))
