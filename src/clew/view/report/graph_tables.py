"""The health of a graph in numbers: facts, tables and a chart."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.evaluate import ROLES, FactorResiduals, PathCuts
from clew.solve import Solution
from clew.view.report.content import Chart, Focus, Scene, Table
from clew.view.report.graph_notes import NOUNS, edge_focus, freedom, moment, radii
from clew.view.report.words import key_name, metres, number

Index = NDArray[np.int64]

_ROWS = 10  # of a table


def graph_facts(solution: Solution, residuals: FactorResiduals, scene: Scene) -> list[tuple[str, str]]:
    facts = [("Poses", f"{len(scene.names):,}")]
    if len(scene.landmarks.names):
        facts.append(("Landmarks", f"{len(scene.landmarks.names):,}"))
    for role in ROLES:
        count = int(residuals.of_role(role).sum())
        if count:
            facts.append((NOUNS[role].capitalize() + "s", f"{count:,}"))
    redundant = freedom(residuals, scene)
    facts.append(("Cost χ²", number(solution.chi2)))
    if redundant > 0:
        facts.append(("χ² for one redundant measurement",
                      number(float((residuals.weight * residuals.squared).sum()) / redundant)))
    held = [part for part in solution.free_parts if part.held]
    if held:
        facts.append(("Held in place", ", ".join(f"pose {key_name(part.anchor)}" for part in held[:3])))
    free = [sentence for sentence in solution.diagnosis if sentence not in {str(part) for part in solution.free_parts
                                                                            if part.held}]
    facts.append(("Directions that nothing measures", "some, see above" if free else "none"))
    return facts


def largest_residuals(residuals: FactorResiduals, place: Index, scene: Scene) -> Table:
    rows = [int(row) for row in residuals.largest(_ROWS) if residuals.squared[row] > 0]
    def name(row: int) -> str:
        return " to ".join(key_name(int(key)) for key in residuals.keys[row] if key >= 0)
    return Table(
        "Largest residuals", ("edge", "kind", "sigmas", "weight"),
        [(name(row), ROLES[residuals.role[row]].value,
          f"{np.sqrt(residuals.squared[row] / max(int(residuals.dim[row]), 1)):.2f}", f"{residuals.weight[row]:.2f}")
         for row in rows],
        [edge_focus(place, row) for row in rows], "Every measurement is met exactly.",
        "How far the estimate is from each measurement, in standard deviations of one coordinate as the graph states "
        "them, and what the robust kernel leaves of its weight (1 without a kernel).",
    )  # fmt: skip


def weakest_links(cuts: list[PathCuts], scene: Scene) -> Table:
    """The steps of the paths over which the least reaches, one a stretch."""
    found: list[tuple[float, int, int]] = []
    for r, cut in enumerate(cuts):
        rows = np.flatnonzero(scene.robot == r)
        near = max(5, len(rows) // 50)  # of steps beside each other one is enough
        left = np.ones(len(cut.edges), dtype=np.bool_)
        for k in np.argsort(cut.information, kind="stable").tolist():
            if left[k]:
                found.append((float(cut.information[k]), int(cut.edges[k]), int(rows[k])))
                left[max(0, k - near) : k + near] = False
    found.sort()
    return Table(
        "Weakest links along the path", ("step", "ties over it", "together within"),
        [(f"{moment(scene, row)} (pose {scene.names[row]})" if scene.timed else moment(scene, row), f"{edges:,}",
          f"±{metres(1.96 / np.sqrt(information))}" if information > 0 else "not tied") for information, edges, row in
         found[:_ROWS]],
        [Focus("span", row, row + 1) for _, _, row in found[:_ROWS]], "A path of one pose has no links.",
        "Where the least ties what the robot drove before to what it drove after: edges, and landmarks seen on both "
        "sides. The last column adds up the information of all ties over the step as if they were measured there "
        "(95 %): it compares steps, and says nothing of the error of the map.",
    )  # fmt: skip


def uncertainty_chart(scene: Scene) -> list[Chart]:
    if scene.covariances is None or len(scene.robots) > 1 or len(scene.names) < 3:
        return []
    order = np.argsort(scene.times, kind="stable")
    return [Chart("Uncertainty of the position", "m", scene.times[order], [("95 %, longest half axis",
                  radii(scene)[order])],
                  "How far off each pose may be, as the graph states its noise. It grows where nothing is recognised, "
                  "and falls where a loop closes.")]  # fmt: skip
