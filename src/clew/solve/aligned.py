"""How sure a trajectory is of its shape: covariances about the best alignment of the whole."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from clew.errors import InputError
from clew.geometry import SE2, SE3
from clew.solve.solution import Solution

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class AlignedCovariances:
    """What a solution knows of a trajectory once it is aligned, and of the alignment.

    Attributes:
        poses: ``(N, dim, dim)`` covariance of each aligned pose, in its own tangent.
        alignment: ``(dim, dim)`` covariance of the motion that aligns, a twist about the middle of the positions; with
            a scale a row and a column more, a share.
    """

    poses: Array
    alignment: Array


def aligned_covariances(solution: Solution, keys: ArrayLike, *, scale: bool = False) -> AlignedCovariances:
    """Covariances of poses about the best alignment of their positions.

    Errors against a true trajectory are looked at after the best rigid alignment of the positions; what the pose that
    was held, or a prior, makes of the covariances has no part in them then. Baarda's S-transformation (1973) onto the
    motions of the whole, by one solve a motion, not by the dense covariance.

    Args:
        solution: of a graph.
        keys: ``(N,)`` of the poses that are aligned, all in the plane or all in space, at least two.
        scale: the alignment is a similarity: the size of the whole is aligned, too.

    Raises:
        InputError: keys of something else, positions that do not determine an alignment, or measurements that leave
            variables free.
    """
    wanted = np.asarray(keys, np.int64).reshape(-1)
    kind, rows = _poses(solution, wanted)
    covariances = solution.covariances(kind)[rows]  # also says so where there is no covariance
    posterior = solution.posterior
    table = solution.kinds.index(kind)
    columns = posterior.problem.columns[table][rows]
    free = columns >= 0
    motions = _motions(kind, posterior.values[table][rows], scale)
    seen = motions.copy()
    seen[:, kind.space :] = 0.0  # the alignment looks at positions only
    normal = np.einsum("nij,nik->jk", seen, seen)
    if np.linalg.cond(normal) > 1e12:
        raise InputError(f"{len(wanted)} poses whose positions determine no alignment; give poses that moved")
    fit = seen @ np.linalg.inv(normal)
    starts = np.cumsum(np.append(0, posterior.problem.pattern.sizes)).astype(np.int64)
    scalars = starts[columns[free]][:, None] + np.arange(kind.dim)
    right = np.zeros((int(starts[-1]), motions.shape[2]))
    right[scalars] = fit[free]
    with_fit = np.zeros_like(motions)
    with_fit[free] = posterior.factor.solve(right)[scalars]
    alignment = np.einsum("nij,nik->jk", fit, with_fit)
    moved = motions @ np.swapaxes(with_fit, 1, 2)
    shape = covariances - moved - np.swapaxes(moved, 1, 2) + motions @ alignment @ np.swapaxes(motions, 1, 2)
    return AlignedCovariances(shape, alignment)


def _motions(kind: type[Any], poses: Array, scale: bool) -> Array:
    """What a motion of the whole about its middle, and its growth, do to each pose: ``(N, dim, dim)`` or one more."""
    functions: Any = kind.functions
    centred = poses.copy()
    centred[:, : kind.space] -= poses[:, : kind.space].mean(axis=0)
    back = functions.inverse(centred)
    motions: Array = functions.adjoint(back)
    if not scale:
        return motions
    growth = np.zeros((len(poses), kind.dim, 1))
    growth[:, : kind.space, 0] = -back[:, : kind.space]
    return np.concatenate([motions, growth], axis=2)


def _poses(solution: Solution, keys: NDArray[np.int64]) -> tuple[type[Any], NDArray[np.int64]]:
    for kind in (SE2, SE3):
        if kind in solution.kinds and len(solution.keys(kind)):
            known = solution.keys(kind)
            order = np.argsort(known)
            place = np.minimum(np.searchsorted(known, keys, sorter=order), len(known) - 1)
            if len(keys) and (known[order[place]] == keys).all():
                return kind, order[place]
    raise InputError("aligned_covariances: give keys of poses of the solution, all in the plane or all in space")
