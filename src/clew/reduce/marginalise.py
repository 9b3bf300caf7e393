"""Taking variables out of a graph while keeping what they knew."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import block_diag

from clew.errors import InputError
from clew.graph import Factor, FactorGraph, Role
from clew.graph.index import as_keys
from clew.reduce.blanket import Blanket, eliminate
from clew.reduce.joint import JointMeasurement
from clew.reduce.relation import WORLD, is_pose, relations
from clew.reduce.tree import Gaussian, fix_frame, nearest_tree

Array = NDArray[np.float64]
Index = NDArray[np.int64]

METHODS = ("tree", "dense")


@dataclass(frozen=True)
class Marginalised:
    """What became of a graph.

    Attributes:
        graph: the graph without the variables that were removed.
        removed: ``(R,)`` keys that were taken out, in the order in which they were.
        losses: ``(R,)`` information lost with each, nats: the Kullback-Leibler divergence of what replaces its factors
            from what they said of its neighbours. Zero where nothing was approximated.
        kept: keys that would have lost more than allowed, and stay.
    """

    graph: FactorGraph
    removed: Index
    losses: Array
    kept: Index

    @property
    def information_loss(self) -> float:
        """Sum of `losses`, nats."""
        return float(self.losses.sum())


def marginalise(
    graph: FactorGraph,
    keys: ArrayLike,
    *,
    method: str = "tree",
    most_loss: float = np.inf,
    conservative: bool = False,
    reuse: float = 0.0,
    update: bool = False,
) -> Marginalised:
    """Take variables out of a graph, one after the other, and replace their factors by what these said of the others.

    The factors are linearised at the graph's values: optimise first. The exact replacement is one dense factor on all
    neighbours (the Schur complement on the Markov blanket); by default it is replaced in turn by the nearest tree of
    relative poses, so that the graph stays sparse. A variable with two neighbours loses nothing by that.

        smaller = clew.marginalise(graph, [3, 4, 5])
        smaller.graph, smaller.information_loss

    Args:
        graph: poses and landmarks in the plane or in space.
        keys: what to take out, a key or ``(N,)`` of them.
        method: ``"tree"``, or ``"dense"`` for the exact marginal (which fills up and cannot be written to files).
        most_loss: a variable that would lose more stays, nats.
        conservative: see to it that the trees claim nothing that was not known (they lose more then).
        reuse: information that may be lost more for each edge of a tree that falls on an older one, nats: put together
            by `fuse_parallel`, edges stay few however many variables are taken out.
        update: change the graph itself instead of a copy.

    Raises:
        InputError: a key that is unknown, named twice or held constant, a method that does not exist, or a variable
            whose neighbours are landmarks alone.
    """
    wanted = as_keys(keys).reshape(-1)
    if method not in METHODS:
        raise InputError(f"method is {method!r}; choose {' or '.join(METHODS)}")
    if len(np.unique(wanted)) != len(wanted):
        raise InputError("marginalise: a key is named twice")
    for key in wanted.tolist():
        if graph.is_constant(key):  # raises where it is unknown
            raise InputError(f"marginalise: variable {key} is held constant; let it go first (set_constant)")
    if not update:
        graph = graph.copy()
    removed, losses, kept = [], [], []
    for key in wanted.tolist():
        factors, loss = _replacement(graph, key, method, conservative, reuse)
        if loss > most_loss:
            kept.append(key)
            continue
        graph.remove_variable(key)
        for factor in factors:
            graph.add(factor)
        removed.append(key)
        losses.append(loss)
    return Marginalised(graph, np.array(removed, np.int64), np.array(losses), np.array(kept, np.int64))


def _replacement(
    graph: FactorGraph, key: int, method: str, conservative: bool, reuse: float
) -> tuple[list[Factor], float]:
    """Factors on the neighbours of a variable that stand for its own, and the loss of information."""
    blanket = eliminate(graph, key)
    if len(blanket.keys) + blanket.absolute < 2:  # nothing is tied to anything
        return [], 0.0
    if not blanket.absolute and not any(is_pose(kind) for kind in blanket.kinds):
        raise InputError(
            f"marginalise: all neighbours of variable {key} are landmarks, which nothing is seen from; "
            "take out the landmarks first"
        )
    gaussian = fix_frame(blanket)
    if method == "tree":
        spared = reuse * _linked(graph, blanket.keys).astype(np.float64) if reuse else None
        return nearest_tree(blanket, gaussian, conservative, spared)
    return [_joint(blanket, gaussian)], 0.0


def _linked(graph: FactorGraph, keys: list[int]) -> NDArray[np.bool_]:
    """``(k, k)`` which of the variables share an edge of an older tree."""
    order = np.argsort(keys)
    ranked = np.asarray(keys)[order]
    linked = np.zeros((len(keys), len(keys)), dtype=np.bool_)
    for factor in graph.touching(keys):
        if factor.role is Role.MARGINAL and len(factor.kinds) == 2:
            rows = np.minimum(np.searchsorted(ranked, factor.keys), len(keys) - 1)
            a, b = order[rows[(ranked[rows] == factor.keys).all(axis=1)]].T
            linked[a, b] = linked[b, a] = True
    return linked


def _joint(blanket: Blanket, gaussian: Gaussian) -> JointMeasurement:
    """The exact marginal as one factor, the root first."""
    from_world = gaussian.root == WORLD
    seen = [i for i in range(len(blanket.keys)) if i != gaussian.root]
    order = seen if from_world else [gaussian.root, *seen]
    root = np.array([gaussian.root])
    each = [relations(blanket, root, np.array([i])) for i in seen]
    measured = [relation.measured(gaussian.step) for relation in each]
    free = np.concatenate([np.arange(blanket.starts[i], blanket.starts[i + 1]) for i in seen])
    design = np.concatenate([relation.jacobian[0] for relation in each])[:, free]
    # tangents of the free variables from the residuals; the determinant is one
    back = np.linalg.inv(design) @ block_diag(*(turn[0] for _, turn in measured))
    information = back.T @ blanket.information[np.ix_(free, free)] @ back
    return JointMeasurement(
        [blanket.keys[i] for i in order], tuple(blanket.kinds[i] for i in order),
        np.concatenate([z[0] for z, _ in measured]), 0.5 * (information + information.T), from_world=from_world,
    )  # fmt: skip
