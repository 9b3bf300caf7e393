"""Candidate pairs given those that are chosen: what both association and joining condition on, one pair after another.

With ``C`` the joint covariance of the differences ``e`` of all candidates, a pair ``p`` that is chosen leaves
``e - C_p C_pp^-1 e_p`` and ``C - C_p C_pp^-1 C_p^T``. Only the diagonal blocks of that are kept, with the rows that
each choice adds to a Cholesky factor: a step costs the number of candidates times that of the pairs chosen before.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]


class Conditioned:
    """Differences of ``P`` candidates with their covariances, given the pairs chosen; a stack.

    Attributes:
        rows: ``(P,)`` number of each candidate.
        difference: ``(P, 2)``.
        own: ``(P, 2, 2)``.
    """

    def __init__(self, difference: Array, own: Array, cross: Callable[[int, Indices], Array]) -> None:
        """`cross` gives the covariance ``(2, 2 S)`` of one candidate's difference with those of some, given none."""
        self.difference, self.own, self._cross = difference, own, cross
        self.rows = np.arange(len(difference))
        self._before: list[tuple[Array, Array]] = []
        self._factor = np.empty((16, 2 * len(difference)))

    def choose(self, pair: int) -> None:
        """Take the difference of the candidate in row `pair` of the arrays for zero."""
        depth = 2 * len(self._before)
        if depth == len(self._factor):
            self._factor = np.concatenate([self._factor, np.empty_like(self._factor)])
        before, mine = self._factor[:depth], slice(2 * pair, 2 * pair + 2)
        cross = self._cross(int(self.rows[pair]), self.rows) - before[:, mine].T @ before
        (a, b), (_, c) = self.own[pair]
        root = np.sqrt(a)
        low = b / root
        corner = np.sqrt(c - low * low)
        rows = self._factor[depth : depth + 2]
        rows[0] = cross[0] / root
        rows[1] = (cross[1] - low * rows[0]) / corner
        e = self.difference[pair]
        first = e[0] / root
        white = np.array([first, (e[1] - low * first) / corner])
        block = rows.reshape(2, len(self.difference), 2)
        self._before.append((self.difference, self.own))
        self.difference = self.difference - (white @ rows).reshape(-1, 2)
        self.own = self.own - np.einsum("kpa,kpb->pab", block, block)

    def undo(self) -> None:
        """Forget the last choice."""
        self.difference, self.own = self._before.pop()

    def drop_all_but(self, kept: Flags) -> None:
        """Go on with some of the candidates only; there is no way back behind this."""
        self.rows, self.difference, self.own = self.rows[kept], self.difference[kept], self.own[kept]
        self._factor = np.ascontiguousarray(self._factor[:, np.repeat(kept, 2)])
