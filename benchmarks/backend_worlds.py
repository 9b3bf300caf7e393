"""Manhattan worlds of any size, and how time and memory grow with it."""

from __future__ import annotations

import multiprocessing
import resource
import time

import numpy as np


def manhattan(poses: int, seed: int = 0, noise: tuple[float, float, float] = (0.05, 0.05, 0.01)):  # type: ignore[no-untyped-def]
    """A robot that walks a grid of streets, a metre a step, and sees again where it has been.

    Args:
        poses: length of the walk.
        seed: of the random numbers.
        noise: standard deviations of the measurements.

    Returns:
        A `FactorGraph` with its true values. Where the robot was before, a closure to the last visit is added
        with probability one half.
    """
    import clew
    from clew import SE2

    generator = np.random.default_rng(seed)
    side = max(4, int(np.sqrt(poses) / 2))
    turn = np.where(generator.random(poses) < 0.25, generator.choice([-1, 1], poses), 0)
    heading, x, y = 0, 0, 0
    steps = np.array([(1, 0), (0, 1), (-1, 0), (0, -1)])
    truth = np.empty((poses, 3))
    last: dict[tuple[int, int], int] = {}
    closures = []
    chance = generator.random(poses)
    for n in range(poses):
        truth[n] = x, y, heading * np.pi / 2
        seen = last.get((x, y))
        if seen is not None and n - seen > 10 and chance[n] < 0.5:
            closures.append((seen, n))
        last[x, y] = n
        heading = (heading + turn[n]) % 4
        while not (0 <= x + steps[heading][0] < side and 0 <= y + steps[heading][1] < side):
            heading = (heading + 1) % 4
        x, y = x + int(steps[heading][0]), y + int(steps[heading][1])
    exact = SE2.from_array(truth)
    graph = clew.FactorGraph()
    a = np.arange(poses - 1)
    odometry = exact[a].between(exact[a + 1]).retract(noise * generator.standard_normal((poses - 1, 3)))
    keys = graph.add_pose(exact)
    graph.add(clew.Between(keys[:-1], keys[1:], odometry, sigmas=noise))
    if closures:
        i, j = np.array(closures).T
        seen = exact[i].between(exact[j]).retract(noise * generator.standard_normal((len(i), 3)))
        graph.add(clew.Between(i, j, seen, sigmas=noise, role="loop"))
    return graph


def _measure(poses: int, queue: multiprocessing.Queue[tuple[float, ...]]) -> None:
    import clew

    graph = manhattan(poses)
    start = time.process_time()
    solution = clew.optimize(graph)
    spent = time.process_time() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    queue.put((graph.factor_count, spent, solution.iterations, spent / max(1, solution.iterations),
               peak / 1024, float(solution.status.ok), solution.chi2))


def scaling(sizes: list[int]) -> None:
    """Print a Markdown table: one size a row, each measured in a process of its own (whose peak memory it is).

    Times are those of the processor, so that other work on the machine disturbs them less.
    """
    print("| poses | edges | default solve, s of one core | iterations | s / iteration | peak memory, MB "
          "| chi2 / edge |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    context = multiprocessing.get_context("spawn")
    for poses in sizes:
        queue: multiprocessing.Queue[tuple[float, ...]] = context.Queue()
        process = context.Process(target=_measure, args=(poses, queue))
        process.start()
        edges, spent, iterations, each, memory, ok, chi2 = queue.get(timeout=1800)
        process.join()
        note = "" if ok else " (not converged)"
        print(f"| {poses:,} | {int(edges):,} | {spent:.2f}{note} | {int(iterations)} | {each:.3f} | "
              f"{memory:,.0f} | {chi2 / edges:.3f} |", flush=True)
