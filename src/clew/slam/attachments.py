"""Where keyframes are that have been pruned: seen from some that stay."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2
from clew.graph.growing import Growing

Array = NDArray[np.float64]
Index = NDArray[np.int64]

PARTNERS = 3  # that a pruned keyframe is seen from, at most
UPPER = np.triu_indices(3)


class Attachments:
    """Poses of pruned keyframes as measured from others, so that they follow when these are moved.

    Each is seen from several, and is where these agree best: as it would be if it had stayed in the graph with no other
    edges. A keyframe may hang on one that was pruned later, and with it on those that this one hangs on.
    """

    def __init__(self) -> None:
        self._keys: Growing[np.int64] = Growing((), np.int64)
        self._on: Growing[np.int32] = Growing((PARTNERS,), np.int32)
        # Single precision: a tenth of a micrometre.
        self._T_on_this: Growing[np.float32] = Growing((PARTNERS, 3), np.float32)
        self._information: Growing[np.float32] = Growing((PARTNERS, 6), np.float32)

    def add(self, key: int, on: Index, T_on_this: Array, information: Array) -> None:
        """Hang a keyframe on others.

        Args:
            key: its number.
            on: ``(p,)`` numbers of the others, ``1 <= p <= PARTNERS``.
            T_on_this: ``(p, 3)`` its pose seen from each.
            information: ``(p, 3, 3)`` positive definite, in the tangents of these poses.
        """
        filled = np.zeros(PARTNERS, dtype=np.int64)
        filled[: len(on)] = np.arange(len(on))
        weight = (np.arange(PARTNERS) < len(on))[:, None]  # what is there twice counts once
        self._keys.extend(1)[:] = key
        self._on.append(on[filled][None])
        self._T_on_this.append(T_on_this[filled][None])
        self._information.append((weight * information[filled][:, UPPER[0], UPPER[1]])[None])

    def place(self, poses: Array) -> None:
        """Move the pruned keyframes among ``(K, 3)`` poses to where they are seen from the others, in place."""
        waits = np.zeros(len(poses), dtype=np.bool_)
        waits[self._keys.rows] = True
        rows = np.arange(len(self._keys))
        while len(rows):  # as many rounds as there are links in the longest chain
            ready = ~waits[self._on.rows[rows]].any(axis=1)
            now, rows = rows[ready], rows[~ready]
            poses[self._keys.rows[now]] = self._seen(poses, now)
            waits[self._keys.rows[now]] = False

    def _seen(self, poses: Array, rows: Index) -> Array:
        """Weighted mean of the poses as the partners see them; one Gauss-Newton step, for they agree closely."""
        seen = se2.compose(poses[self._on.rows[rows]], self._T_on_this.rows[rows].astype(np.float64))
        information = np.zeros((len(rows), PARTNERS, 3, 3))
        information[:, :, UPPER[0], UPPER[1]] = self._information.rows[rows]
        information[:, :, UPPER[1], UPPER[0]] = self._information.rows[rows]
        first = seen[:, 0]
        off = se2.local(first[:, None], seen)
        pull = np.einsum("npij,npj->ni", information, off)
        step = np.linalg.solve(information.sum(axis=1), pull[..., None])[..., 0]
        return np.asarray(se2.retract(first, step))
