"""The graph of keyframes, and what is asked of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.factors import Between
from clew.geometry import SE2, se2
from clew.graph import FactorGraph, Role
from clew.noise import Huber
from clew.place import Closure
from clew.slam.keyframes import Keyframe
from clew.solve import Solution, optimize

Array = NDArray[np.float64]

LEAST_INFORMATION = np.diag([1e-3, 1e-3, 1e-3])  # of any edge, so that none leaves a direction open
FACTORISE_AFTER = 10  # keyframes; until then uncertainty is carried on along the odometry edges


def chi2(graph: FactorGraph) -> float:
    """Cost ``sum e^T Omega e`` of a graph at its values, without robust kernels."""
    total = 0.0
    for block in graph.blocks():
        values = [graph.values(keys).array for keys in block.keys.T]
        e = block.residual(*values, measurement=block.measurement)
        total += float(np.einsum("mi,mij,mj->", e, block.information, e))
    return total


class PoseGraph:
    """Keyframes tied by odometry and closures; keys are the indices of the keyframes.

    The first keyframe holds still: the map hangs on it.
    """

    def __init__(self, kernel_scale: float) -> None:
        self.graph = FactorGraph()
        self._kernel = Huber(kernel_scale)
        self._solution: Solution | None = None
        self._solved = 0  # keyframes that the last solution knows
        self._edge_covariances: list[Array] = []  # (3, 3) of each keyframe seen from the one before
        self._steps: list[Array] = []
        self._poses: Array | None = None  # as the graph holds them, until it changes

    def __len__(self) -> int:
        return len(self._steps)

    @property
    def poses(self) -> Array:
        """``(K, 3)`` of the keyframes in the world."""
        if self._poses is None:
            self._poses = np.asarray(self.graph.values(SE2).array, dtype=np.float64)
        return self._poses

    def add_keyframe(self, keyframe: Keyframe) -> None:
        """Append a keyframe, tied to the one before."""
        k = len(self)
        if k == 0:
            self.graph.add_pose(SE2.identity(), key=0, constant=True)
            self._edge_covariances.append(np.zeros((3, 3)))
        else:
            step = SE2.from_array(keyframe.T_previous_this)
            self.graph.add_pose(self.graph.value(k - 1) @ step, key=k)
            self.graph.add(Between(k - 1, k, step, information=keyframe.information, role=Role.ODOMETRY))
            self._edge_covariances.append(np.asarray(np.linalg.inv(keyframe.information), dtype=np.float64))
        self._steps.append(keyframe.T_previous_this)
        self._poses = None

    def add_closure(self, closure: Closure, information: Array) -> int:
        """Tie two keyframes by a closure; returns what `remove` takes."""
        factor = Between(
            closure.target, closure.source, SE2.from_array(closure.T_target_source),
            information=information, role=Role.LOOP, kernel=self._kernel,
        )  # fmt: skip
        return int(np.asarray(self.graph.add(factor)).reshape(-1)[0])

    def remove(self, factor: int) -> None:
        """Take a closure out again."""
        self.graph.remove(factor)

    def optimise(self) -> None:
        """Move the keyframes to where all edges agree best."""
        if len(self) < 2:
            return
        self._solution = optimize(self.graph, init="file")
        self._solved = len(self)
        self.set_poses(self._solution.values(SE2).array)

    def set_poses(self, poses: Array) -> None:
        """Put the keyframes to poses ``(K, 3)`` found elsewhere."""
        self.graph.set_values(np.arange(len(self)), SE2.from_array(poses))
        self._poses = None

    def relative_covariances(self, source: int, targets: NDArray[np.int64]) -> Array:
        """Covariance ``(T, 3, 3)`` of the source's pose seen from each target, in the source's tangent."""
        fresh = source - self._solved < FACTORISE_AFTER and int(np.max(targets, initial=0)) < self._solved
        if self._solution is None or not fresh:
            self.optimise()
        assert self._solution is not None
        poses = self.poses
        known = min(source, self._solved - 1)
        ahead = np.zeros((3, 3))
        for k in range(known + 1, source + 1):  # at most FACTORISE_AFTER keyframes
            transport = se2.adjoint(se2.inverse(self._steps[k]))
            ahead = transport @ ahead @ transport.T + self._edge_covariances[k]
        to_source = se2.adjoint(se2.between(poses[source], poses[known]))
        joint = self._joint(np.append(targets, known))
        by_target, by_known = se2.local_jacobians(poses[targets], poses[known])
        count = len(targets)
        rows = np.arange(count)
        blocks = joint.reshape(count + 1, 3, count + 1, 3).transpose(0, 2, 1, 3)
        cross = by_target @ blocks[rows, count] @ by_known.transpose(0, 2, 1)
        relative = (
            by_target @ blocks[rows, rows] @ by_target.transpose(0, 2, 1)
            + by_known @ blocks[count, count] @ by_known.transpose(0, 2, 1)
            + cross
            + cross.transpose(0, 2, 1)
        )
        # `local` measures in the target's axes; turned into the known keyframe's, then carried on to the source.
        turn = to_source @ by_known.transpose(0, 2, 1)
        return np.asarray(turn @ relative @ turn.transpose(0, 2, 1) + ahead, dtype=np.float64)

    def _joint(self, keys: NDArray[np.int64]) -> Array:
        """Joint covariance ``(3 n, 3 n)`` of different keyframes; the first keyframe of the graph is certain."""
        assert self._solution is not None
        joint = np.zeros((3 * len(keys), 3 * len(keys)))
        free = np.flatnonzero(keys != 0)
        if len(free):
            rows = (3 * free[:, None] + np.arange(3)).ravel()
            joint[np.ix_(rows, rows)] = self._solution.joint_covariance(keys[free])
        return joint
