"""Every kind of picture, from real data and from a simulated world, light and dark.

    python benchmarks/figures.py -o figures [--data ../shared/data] [--only demo,sphere2500]

Figures from files that are not there are left out. Look at the folder; nothing in it belongs into the repository.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import clew
from clew.evaluate import factor_residuals
from clew.fleet import merge, read_robots
from clew.geometry import se2
from clew.io import open_log, read_graph
from clew.sim import simulate_demo
from clew.view import (
    DARK,
    LIGHT,
    Theme,
    before_after_figure,
    cost_figure,
    error_figure,
    graph_figure,
    graph_scene,
    residuals_figure,
    save_figure,
    save_landmarks_png,
    save_map_png,
    save_overview_png,
    solution_scene,
    sparsity_figure,
)

Draw = Callable[[Theme], Figure]
Drawings = Iterator[tuple[str, Draw]]


def of_graph(path: Path) -> Drawings:
    """Pictures of one optimised pose graph."""
    graph = read_graph(path).graph
    histories = {
        method: clew.optimize(graph, method=method).chi2_history
        for method in ("levenberg-marquardt", "gauss-newton", "dogleg")
    }
    solution = clew.optimize(graph)
    residuals = factor_residuals(solution.graph, None)
    counts = ", ".join(f"{count:,} {name}" for name, count in graph.counts.items())
    scene = solution_scene(solution)
    yield "graph", lambda theme: graph_figure(scene, path.name, subtitle=counts, theme=theme)
    yield "cost", lambda theme: cost_figure(histories, path.name, theme=theme)
    yield "residuals", lambda theme: residuals_figure(residuals, path.name, theme=theme)
    yield "sparsity", lambda theme: sparsity_figure(solution.posterior.problem.symbolic, path.name, theme=theme)
    rough = solution.graph.copy()
    clew.optimize(graph, init="tree", max_iterations=0).apply(rough)
    before = graph_scene(rough)
    yield "before-after", lambda theme: before_after_figure(
        before, graph_scene(solution.graph), ("spanning tree", "optimised"),
        subtitles=("", f"chi2 {solution.chi2:.6g}"), theme=theme)


def of_outliers(path: Path) -> Drawings:
    """Closures that a robust kernel does not believe."""
    graph = read_graph(path).graph
    solution = clew.optimize(graph, robust=clew.DCS())
    residuals = factor_residuals(solution.graph, clew.DCS())
    scene = solution_scene(solution, covariances=False, residuals=residuals)
    yield "graph", lambda theme: graph_figure(scene, path.name, subtitle="dynamic covariance scaling", theme=theme)
    yield "residuals", lambda theme: residuals_figure(
        residuals, path.name, heading_of="weights of dynamic covariance scaling", theme=theme)


def of_robots(folder: Path) -> Drawings:
    """Several robots merged."""
    merged = merge(read_robots(sorted(folder.glob("*.g2o"))))
    robots = {name: keys[1] for name, keys in zip(merged.names, merged.keys, strict=True)}
    scene = solution_scene(merged.solution, robots=robots)
    yield "robots", lambda theme: graph_figure(scene, f"{len(merged.names)} robots", theme=theme)


def of_log(slam: clew.Slam, folder: Path, name: str) -> None:
    """Pictures of a run of the pipeline, which are written pixel by pixel."""
    grid, keyframes = slam.map(), slam.keyframes
    solution = clew.optimize(slam.graph, init="file")
    covariances = solution.covariances()[:, :2, :2]
    pairs, rejected = (
        np.array([(c.source, c.target) for c in closures], dtype=np.int64).reshape(-1, 2)
        for closures in (slam.closures, slam.rejected_closures)
    )
    for theme, suffix in ((LIGHT, "light"), (DARK, "dark")):
        save_map_png(folder / f"{name}-map-{suffix}.png", grid, theme)
        save_overview_png(
            folder / f"{name}-overview-{suffix}.png", grid=grid, odometry_xy=slam.odometry.T_world_robot[:, :2],
            trajectory_xy=slam.trajectory.T_world_robot[:, :2], keyframes=keyframes.T_world_robot,
            closures_accepted=pairs, closures_rejected=rejected, covariances=covariances, title=name,
            subtitle=f"{len(slam.trajectory):,} scans, {len(keyframes):,} keyframes, {len(pairs):,} closures",
            theme=theme,
        )  # fmt: skip


def of_demo(slam: clew.Slam, times: np.ndarray, truth: np.ndarray) -> Drawings:
    """Errors of the simulated run against the truth, with the band of the estimate."""
    solution = clew.optimize(slam.graph, init="file")
    poses, stamps = solution.values().array, slam.keyframes.timestamps
    true = truth[np.searchsorted(times, stamps)]
    true = se2.compose(se2.compose(poses[0], se2.inverse(true[0])), true)  # the estimate's gauge: its first pose
    errors = se2.local(poses, true)
    yield "error", lambda theme: error_figure(
        stamps - stamps[0], errors, solution.covariances(), title="demo", theme=theme)
    scene = solution_scene(solution)
    yield "graph", lambda theme: graph_figure(scene, "demo", theme=theme)


def of_landmarks(path: Path, folder: Path) -> Drawings:
    """Trees of a park, with how sure their places are."""
    solution = clew.optimize(read_graph(path).graph)
    xy, points = solution.values().array[:, :2], solution.values(clew.Point2).array
    for theme, suffix in ((LIGHT, "light"), (DARK, "dark")):
        save_landmarks_png(folder / f"victoria-landmarks-{suffix}.png", [("robot", xy)], points,
                           solution.covariances(clew.Point2), title="Victoria Park",
                           subtitle=f"{len(xy):,} poses, {len(points)} trees", theme=theme)
    scene = solution_scene(solution)
    yield "graph", lambda theme: graph_figure(scene, "Victoria Park", theme=theme)
    residuals = factor_residuals(solution.graph, None)
    yield "residuals", lambda theme: residuals_figure(residuals, "Victoria Park", theme=theme)


def main() -> None:
    """Draw everything that there is data for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=Path, required=True, help="folder for the pictures")
    parser.add_argument("--data", type=Path, default=Path(__file__).parents[2] / "shared" / "data")
    parser.add_argument("--only", default="", help="names of data sets, with commas between them")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    data, out = options.data, options.out
    wanted = set(filter(None, options.only.split(",")))

    def save(name: str, drawings: Drawings) -> None:
        for kind, draw in drawings:
            for theme, suffix in ((LIGHT, "light"), (DARK, "dark")):
                begun = time.process_time()
                save_figure(draw(theme), out / f"{name}-{kind}-{suffix}.png")
                print(f"{name}-{kind}-{suffix}.png  {time.process_time() - begun:.2f} s")

    def asked(name: str, path: Path | None = None) -> bool:
        if wanted and name not in wanted:
            return False
        if path is not None and not path.exists():
            print(f"{name}: left out, {path} is not there")
            return False
        return True

    if asked("demo"):
        log = simulate_demo(seed=1, duration=400.0)
        slam = run(log)
        of_log(slam, out, "demo")
        save("demo", of_demo(slam, log.timestamps, log.T_world_robot))
    if asked("intel-log", path := data / "lidar" / "intel.clf.bz2"):
        of_log(run(open_log(path)), out, "intel-log")
    for name, path in (
        ("intel", data / "graphs2d" / "intel.g2o"),
        ("city10000", data / "graphs2d" / "city10000.g2o"),
        ("sphere2500", data / "graphs3d" / "sphere2500.g2o"),
    ):
        if asked(name, path):
            save(name, of_graph(path))
    if asked("bovisa", path := data / "false_closures" / "Bovisa04_odometry_bow_tr.g2o"):
        save("bovisa", of_outliers(path))
    if asked("victoria", path := data / "landmarks" / "victoriaPark-full.g2o.gz"):
        save("victoria", of_landmarks(path, out))
    if asked("robots", path := data / "multirobot" / "example_4robots"):
        save("robots", of_robots(path))


def run(log: object) -> clew.Slam:
    """The pipeline on a recorded or simulated log, with the defaults."""
    slam = clew.Slam()
    for measurement in log.measurements():  # type: ignore[attr-defined]
        if slam.has_odometry or not hasattr(measurement, "ranges"):
            slam.add(measurement)
    slam.refine()
    return slam


if __name__ == "__main__":
    main()
