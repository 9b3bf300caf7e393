"""Where the robot and the landmarks are between two solves of the graph: a Gaussian that is carried along.

The graph's own marginals (the newest pose jointly with the landmarks) start it; each motion and sighting changes it as
an extended Kalman filter would (Smith, Self, Cheeseman 1990), for less than a solve. The next solve replaces it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from clew.geometry import se2, so2

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class LandmarkFilter:
    """Pose and landmarks with their joint covariance; tangents as everywhere (the pose's is in its own frame).

    Attributes:
        pose: ``(3,)``.
        keys: keys of the landmarks, by row.
        points: ``(L, 2)``.
        covariance: ``(3 + 2 L, 3 + 2 L)``.
    """

    def __init__(self, pose: Array, keys: list[int], points: Array, covariance: Array) -> None:
        self.pose, self.keys, self.points, self.covariance = pose, keys, points, covariance

    def move(self, motion: Array, noise: Array) -> None:
        """Go on by a motion ``(3,)`` with its covariance ``(3, 3)``."""
        by_pose = se2.adjoint(se2.inverse(motion))
        self.pose = se2.compose(self.pose, motion)
        rows = by_pose @ self.covariance[:3]
        self.covariance[:3] = rows
        self.covariance[:, :3] = rows.T
        self.covariance[:3, :3] = rows[:, :3] @ by_pose.T + noise

    def predict(self, chosen: Indices | None = None) -> tuple[Array, Array]:
        """Where landmarks should be seen ``(L, 2)``, and the joint covariance of that ``(L, 2, L, 2)``.

        By default all, otherwise those of the given rows.
        """
        rows = np.arange(len(self.points)) if chosen is None else chosen
        predicted, by_pose, turn = self._view(rows)
        scalars = (3 + 2 * rows[:, None] + np.arange(2)).reshape(-1)
        count = len(rows)
        points = (turn @ self.covariance[np.ix_(scalars, scalars)].reshape(count, 2, 2 * count))
        jacobian = by_pose.reshape(2 * count, 3)
        mixed = jacobian @ (self.covariance[:3, scalars].reshape(3, count, 2) @ turn.T).reshape(3, 2 * count)
        own = jacobian @ self.covariance[:3, :3] @ jacobian.T
        joint = own + mixed + mixed.T + (points.reshape(2 * count, count, 2) @ turn.T).reshape(2 * count, 2 * count)
        return predicted, joint.reshape(count, 2, count, 2)

    def predict_each(self) -> tuple[Array, Array]:
        """As `predict` for all landmarks, with the covariance ``(L, 2, 2)`` of each by itself."""
        count = len(self.points)
        predicted, by_pose, turn = self._view(np.arange(count))
        cross = self.covariance[:3, 3:].reshape(3, count, 2)
        every = np.arange(count)
        points = self.covariance[3:, 3:].reshape(count, 2, count, 2)[every, :, every]
        mixed = by_pose @ np.moveaxis(cross, 1, 0) @ turn.T
        own = by_pose @ self.covariance[:3, :3] @ np.swapaxes(by_pose, 1, 2)
        return predicted, own + mixed + np.swapaxes(mixed, 1, 2) + turn @ points @ turn.T

    def _view(self, rows: Indices) -> tuple[Array, Array, Array]:
        predicted = se2.act(se2.inverse(self.pose), self.points[rows])
        by_pose = np.zeros((len(rows), 2, 3))
        by_pose[:, 0, 0] = by_pose[:, 1, 1] = -1.0
        by_pose[:, 0, 2], by_pose[:, 1, 2] = predicted[:, 1], -predicted[:, 0]
        return predicted, by_pose, so2.matrix(-self.pose[2:])

    def see(self, rows: Indices, z: Array, noise: Array) -> None:
        """Take in sightings ``(M, 2)`` of different known landmarks with noise ``(M, 2, 2)``, all at one moment.

        One update for all of them: the covariance is large, and going through it once is what takes time.
        """
        count = len(rows)
        predicted, by_pose, turn = self._view(rows)
        jacobian, mine = by_pose.reshape(2 * count, 3), (3 + 2 * rows[:, None] + np.arange(2)).reshape(-1)
        points = self.covariance[:, mine].reshape(-1, count, 2) @ turn.T
        spread = self.covariance[:, :3] @ jacobian.T + points.reshape(-1, 2 * count)
        total = jacobian @ spread[:3] + (turn @ spread[mine].reshape(count, 2, -1)).reshape(2 * count, -1)
        total += block_diag(*noise)
        difference = (z - predicted).reshape(-1)
        half = np.linalg.solve(np.linalg.cholesky(total), np.column_stack([spread.T, difference]))
        delta = half[:, :-1].T @ half[:, -1]
        self.covariance -= half[:, :-1].T @ half[:, :-1]
        self.pose = se2.retract(self.pose, delta[:3])
        self.points = self.points + delta[3:].reshape(-1, 2)

    def add(self, key: int, z: Array, noise: Array) -> None:
        """Take in a sighting of a landmark that was not known."""
        turn = so2.matrix(self.pose[2:])
        by_pose = np.hstack([turn, turn @ np.array([[-z[1]], [z[0]]])])
        cross = by_pose @ self.covariance[:3]
        own = by_pose @ self.covariance[:3, :3] @ by_pose.T + turn @ noise @ turn.T
        self.covariance = np.block([[self.covariance, cross.T], [cross, own]])
        self.points = np.vstack([self.points, se2.act(self.pose, z)])
        self.keys.append(key)
