"""What is to be said and checked about a graph, in sentences."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.evaluate import FactorResiduals, bridges, stretches
from clew.graph import Role
from clew.solve import Solution
from clew.view.report.content import Focus, Note, Scene
from clew.view.report.words import counted, metres

Array = NDArray[np.float64]
Index = NDArray[np.int64]

CHI2_95 = {2: 5.991464547107979, 3: 7.814727903251179}  # squared distance that holds 95 %, by coordinates
_NEAR = 20.0  # a squared residual of less is never unlikely: 1e-5 with one degree of freedom, more with several
_UNLIKELY = 1e-6  # chance of so large a residual anywhere in the graph, below which it is worth a look
_DOUBTED = 0.5  # robust weight below which a measurement is hardly believed
_MANY = 0.02  # share of measurements of one kind that are doubted, above which it is worth a look
_LEAST_STRETCH = 8  # poses held by odometry alone that are worth a sentence
_STRETCHES = 3  # such sentences


def moment(scene: Scene, row: int) -> str:
    """When or where along the path a pose is, in words."""
    if scene.timed:
        return f"t = {scene.times[row] - scene.times.min():.1f} s"
    return f"pose {scene.names[row]}"


def sure_sentence(scene: Scene) -> str | None:
    if scene.covariances is None or len(scene.covariances) < 2:
        return None
    radius = radii(scene)
    worst = int(np.argmax(radius))
    return (
        f"If the noise is as the graph states, the robot's position is known to ±{metres(float(np.median(radius)))} "
        f"(95 %, median) and at worst to ±{metres(float(radius[worst]))}, at {moment(scene, worst)}, seen from the "
        "pose that the map hangs on."
    )


def radii(scene: Scene) -> Array:
    """Longest half axis of each 95 % ellipse or ellipsoid, metres."""
    assert scene.covariances is not None
    if scene.dim == 2:
        largest = CHI2_95[2] * np.linalg.eigvalsh(scene.covariances[:, :2, :2])[:, -1]
    else:
        largest = CHI2_95[3] * np.linalg.eigvalsh(scene.covariances)[:, -1]
    return np.asarray(np.sqrt(np.maximum(largest, 0.0)), dtype=np.float64)


def open_directions(solution: Solution) -> list[Note]:
    held = [str(part) for part in solution.free_parts if part.held]
    usual = len(held) == 1  # a graph of relative measurements hangs on one pose, as it should
    level = "know" if usual else "check"
    return [Note(sentence, level if sentence in held else "check") for sentence in solution.diagnosis
            if not (usual and sentence in held)]


def misfits(residuals: FactorResiduals, place: Index, scene: Scene) -> list[Note]:
    """Measurements that the robust kernel hardly believes, and believed ones that noise as stated cannot explain."""
    notes = []
    share = residuals.squared / np.maximum(residuals.dim, 1)
    doubted = residuals.weight < _DOUBTED
    unlikely = ~doubted & (residuals.squared > _NEAR)
    if unlikely.any():  # most graphs are spared the import that chances need
        unlikely &= residuals.chance < _UNLIKELY / max(len(residuals), 1)
    for role in (Role.LOOP, Role.OBSERVATION, Role.ODOMETRY):
        mine = np.flatnonzero(doubted & residuals.of_role(role))
        if len(mine):
            part = len(mine) / int(residuals.of_role(role).sum())
            verb, them, their = ("contradicts", "it", "its") if len(mine) == 1 else ("contradict", "them", "their")
            notes.append(Note(
                f"{counted(len(mine), NOUNS[role])} ({100 * part:.1f} %) {verb} the others so much that the robust "
                f"kernel gives {them} less than half of {their} weight.", "check" if part > _MANY else "know",
                edge_focus(place, int(mine[np.argmin(residuals.weight[mine])]))))
        mine = np.flatnonzero(unlikely & residuals.of_role(role))
        if len(mine):
            worst = int(mine[np.argmax(share[mine])])
            notes.append(Note(
                f"{counted(len(mine), NOUNS[role])} {'misses' if len(mine) == 1 else 'miss'} by more than their "
                f"stated noise can explain, the worst by {np.sqrt(share[worst]):.1f} standard deviations.", "check",
                edge_focus(place, worst)))
    return notes


NOUNS = {Role.LOOP: "loop edge", Role.OBSERVATION: "sighting", Role.ODOMETRY: "odometry edge", Role.PRIOR: "prior",
         Role.MARGINAL: "summarised edge"}


def edge_focus(place: Index, row: int) -> Focus | None:
    return Focus("edge", int(place[row])) if place[row] >= 0 else None


def threads(scene: Scene) -> list[Note]:
    """Stretches of path that only one chain of edges holds."""
    count = len(scene.names)
    alone = bridges(count + len(scene.landmarks.names), scene.edges.ends)
    steps = np.zeros(count, dtype=np.bool_)
    ends = np.sort(scene.edges.ends[alone], axis=1)
    chain = (ends[:, 1] - ends[:, 0] == 1) & (ends[:, 1] < count)
    steps[ends[chain, 0]] = True
    runs = [run for run in stretches(steps).tolist() if run[1] - run[0] + 1 >= _LEAST_STRETCH]
    if not runs:
        return []
    if len(runs) == 1 and runs[0][1] - runs[0][0] >= count - 2:
        return [Note("No measurement closes a loop: the whole path is odometry, and its error grows with the way.",
                     "check", Focus("span", 0, count - 1))]
    length = {tuple(run): float(np.linalg.norm(np.diff(scene.positions[run[0] : run[1] + 2], axis=0), axis=1).sum())
              for run in runs}
    runs.sort(key=lambda run: -length[tuple(run)])
    notes = []
    for first, last in runs[:_STRETCHES]:
        where = f"Between {moment(scene, first)} and {moment(scene, last + 1)}"
        end = " and its far end hangs free" if first == 0 or last >= count - 2 else ""
        notes.append(Note(f"{where} the path ({metres(length[first, last])}, {counted(last - first + 2, 'pose')}) is "
                          f"held by odometry alone{end}: nothing confirms it.", "check",
                          Focus("span", first, last + 1)))
    if len(runs) > _STRETCHES:
        notes.append(Note(f"{counted(len(runs) - _STRETCHES, 'shorter stretch', 'shorter stretches')} of path "
                          "likewise.", "know"))
    return notes


def freedom(residuals: FactorResiduals, scene: Scene) -> int:
    """Redundant measurements: numbers measured, less those estimated."""
    each = 3 if scene.dim == 2 else 6
    return int(residuals.dim.sum()) - each * (len(scene.names) - 1) - scene.dim * len(scene.landmarks.names)


def noise_note(residuals: FactorResiduals, scene: Scene, unit_variance: float = 1.0) -> list[Note]:
    if unit_variance != 1.0:
        return [Note(f"The measurements were found to have {100 * np.sqrt(unit_variance):.0f} % of the noise that the "
                     "log states; what is said here of uncertainty counts with what was found.", "know")]
    redundant = freedom(residuals, scene)
    if redundant < 50:
        return []
    ratio = float((residuals.weight * residuals.squared).sum()) / redundant
    if 0.5 <= ratio <= 2.0:
        return []
    factor = np.sqrt(ratio)
    if ratio > 2.0:
        return [Note(f"The residuals are {factor:.1f} times as large as the stated noise: all ellipses are about that "
                     "much too small, or some measurements are wrong.", "check")]
    return [Note(f"The residuals are only {100 * factor:.0f} % of the stated noise: the measurements are better than "
                 "they say, and all ellipses rather too large.", "know")]
