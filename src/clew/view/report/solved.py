"""The report of a graph that was solved, and of a fleet that was merged."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from clew.geometry import SE2, SE3, se2
from clew.noise import Kernel
from clew.solve import Solution
from clew.view.report.content import Note, Path, Report
from clew.view.report.graph import GraphView, view_graph
from clew.view.report.graph_notes import CHI2_95
from clew.view.report.words import counted, duration, listed, metres, number

if TYPE_CHECKING:  # a solve alone shall not load the pipelines
    from clew.fleet import MergedFleet
    from clew.slam.landmarks import FeatureMap, LandmarkMap

Array = NDArray[np.float64]


def report_of_solution(solution: Solution, title: str, *, robust: Kernel | None = None,
                       notes: tuple[str, ...] = ()) -> Report:
    """What an optimisation found.

    Args:
        solution: with poses of one kind.
        title: name of the graph.
        robust: kernel that the solve was given.
        notes: what reading the file found worth saying.
    """
    graph = view_graph(solution, robust=robust)
    lead = [
        f"{_what(graph)} hold together at a cost χ² of {number(solution.chi2)}, down from "
        f"{number(solution.chi2_initial)} in {counted(solution.iterations, 'iteration')} from the guess "
        f"“{solution.init}”. {solution.status.value}",
        *([graph.sure] if graph.sure else []),
    ]
    trouble = [] if solution.status.ok else [Note(solution.status.value)]
    about = [Note(f"File: {text}.", "know") for text in notes]
    return Report(title, "optimize", lead, [*trouble, *about, *graph.notes], graph.scene, [graph.section])


def report_of_merge(merged: MergedFleet) -> Report:
    """What became of a merge of several robots."""
    solution = merged.solution
    kind = next(kind for kind in solution.kinds if kind in (SE2, SE3))
    keys = np.sort(solution.keys(kind))
    robot = np.zeros(len(keys), np.int64)
    for number_, (_, new) in enumerate(merged.keys):
        robot[np.isin(keys, new)] = number_
    graph = view_graph(solution, robot=robot, robots=merged.names, landmark_names=dict(merged.identities))
    links = [
        f"{merged.names[a]} and {merged.names[b]} by " + (
            f"{link.support} common landmarks" if link.edges is None
            else f"{len(link.edges.edges)} of {link.edges.count} relative poses")
        for (a, b), link in merged.links.items()
    ]
    lead = [
        f"{counted(len(merged.names), 'robot')} in one frame, that of {merged.names[0]}: {_what(graph)}, cost χ² "
        f"{number(solution.chi2)}.",
        f"They are tied together: {listed(links)}.",
        *([graph.sure] if graph.sure else []),
    ]
    left = [Note(f"{merged.names[a]} and {merged.names[b]}: {link.edges.count - len(link.edges.edges)} of "
                 f"{link.edges.count} relative poses between them disagree with the rest and were left out.", "know")
            for (a, b), link in merged.links.items() if link.edges is not None
            and link.edges.count > len(link.edges.edges)]
    return Report("Merge of robots " + listed(merged.names), "merge", lead, [*left, *graph.notes], graph.scene,
                  [graph.section])


def report_of_landmarks(found: LandmarkMap, solution: Solution, title: str, skipped: dict[str, int]) -> Report:
    """What robots that recognise landmarks mapped.

    Args:
        found: the robots and landmarks.
        solution: of ``found.graph``.
        title: name of the log.
        skipped: records left out, by reason.
    """
    graph_keys = np.concatenate([robot.keys for robot in found.robots])
    order = np.argsort(graph_keys)
    robot = np.repeat(np.arange(len(found.robots)), [len(r.keys) for r in found.robots])[order]
    times = np.concatenate([r.timestamps for r in found.robots])[order]
    covariances = np.concatenate([r.covariances for r in found.robots])[order]
    names = tuple(f"robot {r.robot}" for r in found.robots)
    graph = view_graph(solution, times=times, robot=robot, robots=names, covariances=covariances)
    place = {int(key): row for row, key in enumerate(found.identity)}
    landmarks = graph.scene.landmarks
    rows = [place[int(name)] for name in landmarks.names]
    scene = replace(
        graph.scene,
        landmarks=replace(landmarks, covariances=found.covariance[rows], sightings=found.sightings[rows]),
        paths=[Path(f"odometry of {name}", "odometry", n, r.timestamps, _onto(r.T_odom_robot, r.T_world_robot[0]))
               for n, (name, r) in enumerate(zip(names, found.robots, strict=True))],
    )
    way = sum(float(np.hypot(*np.diff(r.T_world_robot[:, :2], axis=0).T).sum()) for r in found.robots)
    lasted = max(float(np.ptp(r.timestamps)) for r in found.robots)
    radius = np.sqrt(np.maximum(np.linalg.eigvalsh(found.covariance)[:, -1], 0.0) * CHI2_95[2])
    lead = [
        f"{counted(len(names), 'robot')} drove {metres(way)} in {duration(lasted)} and saw "
        f"{counted(len(found.identity), 'landmark')} {int(found.sightings.sum()):,} times.",
        f"The landmarks are known to ±{metres(float(np.median(radius)))} (95 %, median), the worst, "
        f"{found.identity[np.argmax(radius)]}, to ±{metres(float(radius.max()))}.",
        *([graph.sure] if graph.sure else []),
    ]
    left = [Note("Left out: " + listed([f"{n:,} × {reason}" for reason, n in skipped.items()]) + ".", "know")]
    return Report(title, "run", lead, [*graph.notes, *(left if skipped else [])], scene, [graph.section])


def report_of_features(found: FeatureMap, title: str, skipped: dict[str, int]) -> Report:
    """What a robot mapped that saw features, their identities given or found."""
    times = found.keys.astype(np.float64)
    graph = view_graph(found.solution, times=times, unit_variance=found.unit_variance)
    odometry = _onto(found.T_odom_robot, found.T_world_robot[0])
    scene = replace(graph.scene, paths=[Path("odometry", "odometry", 0, times, odometry)])
    way = float(np.hypot(*np.diff(found.T_world_robot[:, :2], axis=0).T).sum())
    radius = np.sqrt(np.maximum(np.linalg.eigvalsh(found.covariance)[:, -1], 0.0) * CHI2_95[2])
    how = "given by the log" if found.components is None else "found on the way"
    lead = [
        f"The robot drove {metres(way)} and saw {counted(len(found.identity), 'landmark')} "
        f"{int(found.sightings.sum()):,} times; which landmark is which was {how}.",
        f"The landmarks are known to ±{metres(float(np.median(radius)))} (95 %, median).",
    ]
    none = int(np.sum(found.landmark < 0))
    left = [f"{n:,} × {reason}" for reason, n in skipped.items()] + [f"{none:,} × sighting of no landmark"] * (none > 0)
    notes = [Note("Left out: " + listed(left) + ".", "know")] if left else []
    return Report(title, "run", lead, [*graph.notes, *notes], scene, [graph.section])


def _onto(poses: Array, first: Array) -> Array:
    """A path moved so that it begins at a pose."""
    return se2.compose(first, se2.between(poses[0], poses))


def _what(graph: GraphView) -> str:
    scene = graph.scene
    parts = [counted(len(scene.names), "pose")]
    if len(scene.landmarks.names):
        parts.append(counted(len(scene.landmarks.names), "landmark"))
    return listed([*parts, counted(len(scene.edges.ends), "measurement") + " between them"])
