"""The report of a run on laser scans."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from clew.evaluate import OdometrySlip, odometry_slip
from clew.io import LogHealth, StreamHealth
from clew.mapping import OccupancyGrid
from clew.place import Closure, Verdict
from clew.slam import Slam, Trajectory
from clew.view.report.content import Chart, Focus, Note, Path, Report, Scene, Section, Summarised, Table
from clew.view.report.graph import GraphView, view_graph
from clew.view.report.words import capital, counted, degrees, duration, listed, metres

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_SLIPS = 10  # rows of the table
_GAPS = 3  # rows of the table for each kind of event
_CHART = 4000  # points of a curve


def report_of_run(
    slam: Slam, grid: OccupancyGrid, title: str, *, health: LogHealth | None = None,
    skipped: Mapping[str, int] | None = None, complete: bool = True, refined: bool = True,
    truth: Trajectory | None = None,
) -> Report:  # fmt: skip
    """What a run found, how sure it is, and what to check.

    Args:
        slam: after its last measurement.
        grid: its map.
        title: name of the log.
        health: state of the log, or None.
        skipped: scans and readings left out, by reason.
        complete: whether the log was read to its end.
        refined: whether a refinement that was begun came to its end.
        truth: true poses at the times of the trajectory, in its frame, where they are known.
    """
    keyframes, trajectory, odometry = slam.keyframes, slam.trajectory, slam.odometry
    graph = view_graph(slam.solution(), times=keyframes.timestamps, robots=("robot",))
    paths = [Path("trajectory", "trajectory", 0, trajectory.timestamps, trajectory.T_world_robot)]
    if len(odometry):
        paths.append(Path("odometry alone", "odometry", 0, odometry.timestamps, odometry.T_world_robot))
    if truth is not None:
        paths.append(Path("truth", "truth", 0, truth.timestamps, truth.T_world_robot))
    closures = _between_rows([*slam.closures, *slam.rejected_closures], slam.keyframe_numbers, len(slam.every_keyframe))
    scene = replace(graph.scene, paths=paths, closures=closures, scans=slam.keyframe_points, grid=grid,
                    summarised=_summarised(slam))
    slip = None
    if len(odometry):
        slip = odometry_slip(odometry.timestamps, odometry.T_world_robot, trajectory.T_world_robot)
    skipped = dict(skipped or {})
    notes = [*_unfinished(complete, refined), *_closure_notes(closures, scene), *graph.notes, *_slip_notes(slip, scene),
             *_pruned(slam), *_doubts(slam), *_log_notes(health), *_left_out(skipped)]
    rank = {"check": 0, "know": 1, "good": 2}
    notes.sort(key=lambda note: rank[note.level])
    return Report(title, "run", _lead(slam, grid, graph, truth), notes, scene,
                  [_log_section(health, skipped, slip, scene, _gyro(slam)), replace(graph.section, tables=[
                      _verdicts(closures), *graph.section.tables])])


def _between_rows(closures: list[Closure], numbers: Index, count: int) -> list[Closure]:
    """Closures by rows of the scene, in the order in which keyframes were taken: those that stayed, then the others."""
    row = np.empty(count, np.int64)
    row[np.concatenate([numbers, _gone(numbers, count)])] = np.arange(count)
    return [replace(c, source=int(row[c.source]), target=int(row[c.target]))
            for c in sorted(closures, key=lambda c: (c.source, c.target, c.verdict.name))]


def _gone(numbers: Index, count: int) -> Index:
    """Numbers of the keyframes that were summarised."""
    return np.setdiff1d(np.arange(count), numbers)


def _summarised(slam: Slam) -> Summarised:
    every = slam.every_keyframe
    gone = _gone(slam.keyframe_numbers, len(every))
    return Summarised([str(number) for number in gone], every.timestamps[gone], every.T_world_robot[gone])


def _when(scene: Scene, row: int) -> str:
    times = np.concatenate([scene.times, scene.summarised.times])
    return f"t = {times[row] - scene.times.min():.1f} s"


def _lead(slam: Slam, grid: OccupancyGrid, graph: GraphView, truth: Trajectory | None) -> list[str]:
    trajectory = slam.trajectory
    # From keyframe to keyframe: the noise of single scans would add up to a way of its own.
    way = float(np.hypot(*np.diff(slam.every_keyframe.T_world_robot[:, :2], axis=0).T).sum())
    lasted = float(np.ptp(trajectory.timestamps)) if len(trajectory) else 0.0
    height, width = (side * grid.resolution for side in grid.shape)
    lines = [f"The robot drove {metres(way)} in {duration(lasted)}; {counted(len(trajectory), 'scan')} became "
             f"{counted(len(slam.keyframes), 'keyframe')} and a map of {width:.0f} m by {height:.0f} m."]
    believed, others, same = slam.closure_count, slam.turned_down_count, slam.redundant_count
    turned_down = f"{counted(others, 'candidate')} {'was' if others == 1 else 'were'} turned down."
    besides = f", {counted(same, 'candidate')} {'says' if same == 1 else 'say'} the same" if same else ""
    if believed:
        lines.append("It recognised places it had been to: "
                     f"{counted(believed, 'loop closure')} {'is' if believed == 1 else 'are'} believed{besides}, "
                     f"{turned_down}")
    elif others:
        lines.append(f"No loop closure is believed; {turned_down}")
    else:
        lines.append("It never came back to a place that it had seen: there is no loop closure.")
    if graph.sure:
        lines.append(graph.sure)
    if len(slam.odometry):
        apart = float(np.hypot(*(slam.odometry.T_world_robot[-1] - trajectory.T_world_robot[-1])[:2]))
        lines.append(f"Odometry alone would have ended {metres(apart)} from there.")
    if truth is not None:
        error = np.hypot(*(truth.T_world_robot - trajectory.T_world_robot)[:, :2].T)
        lines.append(f"Here the truth is known: the trajectory is {metres(float(np.sqrt(np.mean(error**2))))} off "
                     f"(RMS, first poses laid on each other), at most {metres(float(error.max()))}.")
    return lines


def _unfinished(complete: bool, refined: bool) -> list[Note]:
    if not complete:
        return [Note("The run was interrupted: this is what was mapped so far, not refined.")]
    return [] if refined else [Note("The refinement was interrupted: another run may be a little sharper.")]


def _log_notes(health: LogHealth | None) -> list[Note]:
    if health is None:
        return []
    return [Note("Log: " + problem + ".", "know") for problem in health.problems
            if not problem.startswith("left out")]


def _closure_notes(closures: list[Closure], scene: Scene) -> list[Note]:
    notes = []
    for verdict, level, text in (
        (Verdict.WITHDRAWN, "check", "believed first and taken out again, because the optimised graph contradicted "
                                     "{them}: look whether places that look alike were taken for one"),
        (Verdict.WAITING, "know", "still waiting for others that agree when the log ended"),
        (Verdict.DISAGREES, "check", "matched well but lay outside of what the graph thought possible: either places "
                                     "look alike, or the graph is surer than it should be"),
    ):
        mine = [k for k, c in enumerate(closures) if c.verdict is verdict]
        if mine:
            one = len(mine) == 1
            notes.append(Note(f"{counted(len(mine), 'closure')} {'was' if one else 'were'} "
                              f"{text.format(them='it' if one else 'them')}.", level, Focus("closure", mine[0])))
    believed = [k for k, c in enumerate(closures) if c.verdict is Verdict.CONFIRMED]
    far = max(believed, key=lambda k: closures[k].innovation[0], default=None)
    if far is not None and closures[far].innovation[0] > 1.0:
        c = closures[far]
        notes.append(Note(f"The closure that moved the map most shifted the robot by {metres(c.innovation[0])} and "
                          f"{degrees(c.innovation[1])}, at {_when(scene, c.source)}: if the map looks doubled or "
                          "bent, look at it first.", "know", Focus("closure", far)))
    return notes


def _pruned(slam: Slam) -> list[Note]:
    pruned = slam.pruned.keyframes
    return [] if not pruned else [Note(
        f"{counted(pruned, 'keyframe')} {'was' if pruned == 1 else 'were'} summarised where enough others had seen the "
        "same: their closures are on the map, their scans are not kept.", "know")]


def _doubts(slam: Slam) -> list[Note]:
    """What looks wrong about the sensors."""
    doubts = slam.sensor.get("doubts")
    return [Note(capital(doubt)) for doubt in doubts] if isinstance(doubts, list) else []


def _slip_notes(slip: OdometrySlip | None, scene: Scene) -> list[Note]:
    if slip is None or not len(slip.events):
        return []
    worst = int(np.argmax(slip.sizes[:, 0]))
    return [Note(f"Odometry and map disagree in {counted(len(slip.events), 'place')}, at worst by "
                 f"{metres(float(slip.sizes[worst, 0]))} within two seconds at t = "
                 f"{slip.events[worst, 0] - scene.times.min():.1f} s: wheels slipped, the robot was lifted, or clocks "
                 "differ.", "know", _span(slip.events[worst], scene))]


def _left_out(skipped: Mapping[str, int]) -> list[Note]:
    if not skipped:
        return []
    return [Note("Left out: " + listed([f"{count:,} × {reason}" for reason, count in skipped.items()]) + ".", "know")]


def _span(event: Array, scene: Scene) -> Focus:
    first, last = np.searchsorted(scene.times, event)
    top = len(scene.times) - 1
    return Focus("span", int(min(max(first - 1, 0), top)), int(min(last, top)))


# --- the section about the log ------------------------------------------------------------------------------------


def _gyro(slam: Slam) -> list[tuple[str, str]]:
    """What the gyro was found to be worth; nothing of one that does not turn as the robot does."""
    gyro = slam.sensor.get("gyro")
    if not isinstance(gyro, dict) or not gyro["turns_along"]:
        return []
    names = ("bias_rad_per_second", "bias_deviation_rad_per_second", "noise_rad_per_sqrt_second")
    bias, sure, noise = (np.degrees(gyro[name]) for name in names)
    aside, late = gyro["matches_without_it"], round(1000 * gyro["stamped_late_seconds"])
    return [("Gyro against the map", f"bias {bias:+.2f}° a second (± {sure:.2g}), off by {noise:.2g}° after a second, "
             f"{100 * gyro['scale_error']:+.2g} % in turns, stamped {late} ms late"
             + (f"; left aside at {counted(aside, 'scan')}" if aside else ""))]


def _log_section(health: LogHealth | None, skipped: Mapping[str, int], slip: OdometrySlip | None,
                 scene: Scene, gyro: list[tuple[str, str]]) -> Section:
    facts: list[tuple[str, str]] = []
    gaps: list[tuple[float, tuple[str, ...]]] = []
    if health is not None:
        laser = health.laser
        begin = health.scans.first
        for stream in (health.scans, health.odometry, None if health.gyro is None else health.gyro.stream):
            if stream is not None:
                number = counted(stream.count, "record")
                facts.append((capital(stream.name)[:-1], f"{number}, {stream.rate:.1f} a second"))
                gaps += _interruptions(stream, begin)
        facts.append(("Beams", f"{listed([f'{beams:,}' for beams in laser.beams])} over "
                               f"{degrees(laser.field_of_view)}, {degrees(laser.resolution)} apart"))
        facts.append(("Returns", f"median {metres(laser.median)}, longest {metres(laser.longest)}; "
                                 f"{100 * laser.no_return:.0f} % of the beams met nothing"))
        if health.odometry is not None:
            facts.append(("Way by odometry", metres(health.distance)))
        gaps += [(time, (f"{time - begin:.1f} s", "odometry", "jump", metres(length)))
                 for time, length in _longest(health.jumps)]
    facts += gyro
    facts.append(("Left out", listed([f"{n:,} × {reason}" for reason, n in skipped.items()]) or "nothing"))
    tables = [] if health is None else [Table(
        "Gaps and clock jumps", ("at", "sensor", "what", "size"), [row for _, row in gaps],
        [_span(np.array([time, time]), scene) for time, _ in gaps],
        "The records come evenly, and the clock never steps back.",
        "The longest of each kind; when nothing came for ten intervals and two seconds, it counts as a gap.")]
    if slip is None:
        return Section("Health of the log", facts, (), tables)
    order = np.argsort(-slip.sizes[:, 0], kind="stable")[:_SLIPS]
    tables.append(Table(
        "Where odometry and map disagree", ("from", "to", "by", "turn"),
        [(f"{slip.events[k, 0] - scene.times.min():.1f} s", f"{slip.events[k, 1] - scene.times.min():.1f} s",
          metres(float(slip.sizes[k, 0])), degrees(float(slip.sizes[k, 1]))) for k in order],
        [_span(slip.events[k], scene) for k in order], "Odometry and map agree all along.",
        "Motions over two seconds, compared: more than 15 cm or 8° apart, and more than a quarter of the motion."))
    every = max(1, -(-len(slip.times) // _CHART))
    chart = Chart("Odometry against map", "m", slip.times[::every], [("disagreement over 2 s", slip.distance[::every])],
                  "How far the motions by odometry and by the map differ over two seconds.")
    return Section("Health of the log", facts, (), tables, [chart] if len(slip.times) > 2 else [])


def _interruptions(stream: StreamHealth, begin: float) -> list[tuple[float, tuple[str, ...]]]:
    kinds = (("silent", stream.gaps), ("clock steps back", stream.steps_back))
    return [(time, (f"{time - begin:.1f} s", stream.name, what, f"{size:.3g} s"))
            for what, events in kinds for time, size in _longest(events)]


def _longest(events: Array) -> list[tuple[float, float]]:
    """Time and size of the largest few."""
    return [(float(time), float(size)) for time, size in events[np.argsort(-events[:, 1], kind="stable")[:_GAPS]]]


def _verdicts(closures: list[Closure]) -> Table:
    """How many candidates ended how; each row leads to the first of them."""
    rows, focus = [], []
    for verdict in Verdict:
        mine = [k for k, c in enumerate(closures) if c.verdict is verdict]
        if mine:
            rows.append((verdict.value, f"{len(mine):,}"))
            focus.append(Focus("closure", mine[0]))
    return Table("What became of the candidates for loop closures", ("verdict", "closures"), rows, focus,
                 "No place was seen twice.", "Step through them with n and p on the map.")
