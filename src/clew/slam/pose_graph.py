"""The graph of keyframes, and what is asked of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.factors import Between
from clew.geometry import SE2, se2
from clew.graph import FactorGraph, Role
from clew.graph.growing import Growing
from clew.noise import Huber
from clew.place import Closure
from clew.reduce import fuse_parallel, marginalise
from clew.slam.attachments import Attachments
from clew.slam.grid_index import GridIndex
from clew.slam.keyframes import Keyframe
from clew.solve import Solution, optimize

Array = NDArray[np.float64]
Index = NDArray[np.int64]

LEAST_INFORMATION = np.diag([1e-3, 1e-3, 1e-3])  # of any edge, so that none leaves a direction open
FACTORISE_AFTER = 10  # keyframes; until then uncertainty is carried on along the odometry edges
REUSE = 1.5  # nats; so much more may be lost for each edge that pruning need not add
CELL = 4.0  # metres; of the index of keyframes
TO_THE_END = 1e-10  # relative change of the cost that ends a solve,
ON_THE_WAY = 1e-5  # and while more is to come


def chi2(graph: FactorGraph) -> float:
    """Cost ``sum e^T Omega e`` of a graph at its values, without robust kernels."""
    total = 0.0
    for block in graph.blocks():
        values = [graph.values(keys).array for keys in block.keys.T]
        e = block.residual(*values, measurement=block.measurement)
        total += float(np.einsum("mi,mij,mj->", e, block.information, e))
    return total


class PoseGraph:
    """Keyframes tied by odometry and closures; keys are the numbers of the keyframes.

    The first keyframe holds still: the map hangs on it. A keyframe that was pruned is seen from some that are left.

    Attributes:
        graph: variables, odometry and closures.
        near: which keyframes of the graph stand near a place.
    """

    def __init__(self, kernel_scale: float) -> None:
        self.graph = FactorGraph()
        self._kernel = Huber(kernel_scale)
        self._solution: Solution | None = None
        self._solved = 0  # keyframes that the last solution knows
        self._edges: dict[int, tuple[Array, Array]] = {}  # those after: step and (3, 3) from the one before
        self._poses: Growing[np.float64] = Growing((3,), np.float64)
        self.near = GridIndex(CELL)
        self._attachments = Attachments()

    def __len__(self) -> int:
        return len(self._poses)

    @property
    def poses(self) -> Array:
        """``(K, 3)`` of the keyframes in the world; those of pruned ones as `follow` last left them."""
        return self._poses.rows

    def follow(self) -> Array:
        """``(K, 3)`` of all keyframes, the pruned ones moved to where those see them that they hang on."""
        self._poses.detach()
        self._attachments.place(self._poses.rows)
        return self.poses

    def add_keyframe(self, keyframe: Keyframe) -> None:
        """Append a keyframe, tied to the one before."""
        k = len(self)
        if k == 0:
            pose = SE2.identity()
            self.graph.add_pose(pose, key=0, constant=True)
        else:
            step = SE2.from_array(keyframe.T_previous_this)
            pose = SE2.from_array(self.poses[k - 1]) @ step
            self.graph.add_pose(pose, key=k)
            self.graph.add(Between(k - 1, k, step, information=keyframe.information, role=Role.ODOMETRY))
            covariance = np.asarray(np.linalg.inv(keyframe.information), dtype=np.float64)
            self._edges[k] = keyframe.T_previous_this, covariance
        self._poses.append(pose.array[None])
        self.near.put(np.array([k]), pose.array[None, :2])

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

    def prune(self, key: int, on: Index, T_on_this: Array, information: Array, most_loss: float) -> float | None:
        """Take a keyframe out, keep what its edges said of the others, and hang it on some of these.

        Args:
            key: which.
            on, T_on_this, information: what it hangs on from now on, see `Attachments.add`.
            most_loss: information that may be lost at most, nats.

        Returns:
            What was lost, nats, or None: it would have been more, and the keyframe stays.
        """
        found = marginalise(self.graph, key, most_loss=most_loss, reuse=REUSE, update=True)
        if len(found.kept):
            return None
        self._attachments.add(key, on, T_on_this, information)
        self.near.remove(np.array([key]))
        return found.information_loss

    def degrees(self) -> Index:
        """``(K,)`` edges that each keyframe has."""
        keys = [block.keys.ravel() for block in self.graph.blocks()]
        return np.bincount(np.concatenate([*keys, np.empty(0, np.int64)]), minlength=len(self))

    def tidy(self) -> None:
        """Put parallel edges that pruning left together."""
        fuse_parallel(self.graph)

    def optimise(self, *, to_the_end: bool = False) -> None:
        """Move the keyframes to where all edges agree best.

        Args:
            to_the_end: until nothing moves; otherwise until it hardly does.
        """
        if len(self.graph) < 2:
            return
        tolerance = TO_THE_END if to_the_end else ON_THE_WAY
        self._solution = optimize(self.graph, init="file", cost_tolerance=tolerance)
        self._solved = len(self)
        self._edges.clear()
        self.set_poses(self._solution.values(SE2).array)

    def set_poses(self, poses: Array) -> None:
        """Put the keyframes of the graph to poses found elsewhere, in the order of its keys."""
        keys = self.graph.keys(SE2)
        self.graph.set_values(keys, SE2.from_array(poses))
        self._poses.detach()
        self._poses.rows[keys] = self.graph.values(SE2).array
        self.near.put(keys, self._poses.rows[keys, :2])

    def relative_covariances(self, source: int, targets: Index) -> Array:
        """Covariance ``(T, 3, 3)`` of the source's pose seen from each target, in the source's tangent."""
        fresh = source - self._solved < FACTORISE_AFTER and int(np.max(targets, initial=0)) < self._solved
        if self._solution is None or not fresh:
            self.optimise()
        assert self._solution is not None
        poses = self.poses
        known = min(source, self._solved - 1)
        ahead = np.zeros((3, 3))
        for k in range(known + 1, source + 1):  # at most FACTORISE_AFTER keyframes
            step, covariance = self._edges[k]
            transport = se2.adjoint(se2.inverse(step))
            ahead = transport @ ahead @ transport.T + covariance
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

    def _joint(self, keys: Index) -> Array:
        """Joint covariance ``(3 n, 3 n)`` of different keyframes; the first keyframe of the graph is certain."""
        assert self._solution is not None
        joint = np.zeros((3 * len(keys), 3 * len(keys)))
        free = np.flatnonzero(keys != 0)
        if len(free):
            rows = (3 * free[:, None] + np.arange(3)).ravel()
            joint[np.ix_(rows, rows)] = self._solution.joint_covariance(keys[free])
        return joint
