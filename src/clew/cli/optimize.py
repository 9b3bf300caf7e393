"""``clew optimize``: a pose graph file in, the optimised graph out."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from clew.cli.options import Json, LogLevel, LogLevelOption, Quiet

if TYPE_CHECKING:
    from clew.io import GraphFile
    from clew.noise import Kernel
    from clew.solve import Solution


class Method(str, Enum):
    """Choices of ``--method``."""

    LEVENBERG_MARQUARDT = "levenberg-marquardt"
    GAUSS_NEWTON = "gauss-newton"
    DOGLEG = "dogleg"


class Init(str, Enum):
    """Choices of ``--init``."""

    AUTO = "auto"
    FILE = "file"
    TREE = "tree"
    ROTATION = "rotation"
    JOINT = "joint"
    SEQUENTIAL = "sequential"


def optimize(
    graph: Annotated[Path, typer.Argument(help="Pose graph: g2o or TORO, plain or packed.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            help="Write the result; the ending chooses the format: .g2o, .graph (TORO), .tum (the vertex id as "
            "timestamp), .csv, .kitti or .txt (KITTI, by vertex id); .g2o.gz and .graph.gz are packed.",
        ),
    ] = None,
    method: Annotated[Method, typer.Option(help="How steps are found.")] = Method.LEVENBERG_MARQUARDT,
    robust: Annotated[
        str | None,
        typer.Option(
            help="Robust kernel, NAME or NAME:SCALE: huber, pseudo-huber, cauchy, geman-mcclure, welsch, "
            "tukey, dcs."
        ),
    ] = None,
    init: Annotated[
        Init,
        typer.Option(
            help="Initial guess: the file's values, a spanning tree, rotations first, a graph that grows pose by "
            "pose (landmarks), or the best of these."
        ),
    ] = Init.AUTO,
    max_iterations: Annotated[int, typer.Option(min=0, help="Limit on the steps tried.")] = 100,
    marginals: Annotated[
        Path | None,
        typer.Option(
            help="Write the covariance of every variable as CSV: key, kind, then the matrix row by row in the "
            "variable's own frame, translation first (m, rad)."
        ),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(help="Draw the result as PNG; with --marginals, ellipses too.")
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(
            show_default=False,
            help="Write the report, one HTML file with the graph to look around in, how sure it is and what fits "
            "badly. Default: beside the result (-o best.g2o: best.report.html).",
        ),
    ] = None,
    no_report: Annotated[bool, typer.Option("--no-report", help="Write no report beside the result.")] = False,
    as_json: Json = False,
    quiet: Quiet = False,
    log_level: LogLevelOption = LogLevel.WARNING,
    threads: Annotated[int, typer.Option(min=1, help="Threads of the factorisation.")] = 1,
) -> None:
    """Optimise a pose graph and say how it went.

    **Examples**

    `clew optimize manhattan.g2o -o optimised.g2o`

    `clew optimize out/graph.g2o --robust dcs --json`

    Exit code 0 says that there is a result; whether it converged is in the text, and in `status` of `--json`. Bad
    input ends with exit code 2 and one line.
    """
    clock = _Clock()
    from clew.cli.formats import GRAPHS, TRAJECTORIES, format_of
    from clew.cli.progress import stages
    from clew.cli.solution_outputs import (
        draw,
        report_beside,
        write_marginals,
        write_result,
        write_solution_report,
    )
    from clew.cli.terminal import messages
    from clew.errors import InputError
    from clew.io import read_graph
    from clew.solve import Status
    from clew.solve import optimize as solve

    kernel = None if robust is None else parse_kernel(robust)
    if output is not None:
        format_of(output, GRAPHS + TRAJECTORIES)
    if report is None and output is not None and not no_report:
        report = report_beside(output)
    check_outputs(output, marginals, plot, report)  # a wrong name shall not cost a solve
    clock.skip()
    with stages(messages(quiet)) as shown:
        shown.begin("reading", note=graph.name)
        file = read_graph(graph)
        clock.lap("read")
        _check(file, init)
        shown.begin("solving", note=f"initial guess, {len(file.graph):,} variables")
        solution = solve(
            file.graph,
            method=method.value,
            init=init.value,
            robust=kernel,
            max_iterations=max_iterations,
            threads=threads,
            callback=shown.iterations(max_iterations),
        )
    clock.skip()
    clock.seconds["initialise"] = solution.seconds["initialise"]
    clock.seconds["solve"] = solution.seconds["total"] - solution.seconds["initialise"]
    if output is not None:
        write_result(output, file, solution)
    clock.lap("write")
    if marginals is not None:
        if solution.status is Status.UNDERCONSTRAINED:
            free = " ".join(solution.diagnosis)
            raise InputError(f"{graph}: no marginals, the measurements leave variables free: {free}")
        write_marginals(marginals, solution)
    clock.lap("marginals")
    if plot is not None:
        draw(plot, solution, ellipses=marginals is not None)
        clock.lap("plot")
    if report is not None:
        write_solution_report(report, file, solution, robust=kernel, notes=_notes(file))
        clock.lap("report")
    seconds = clock.finish()
    if as_json:
        typer.echo(_as_json(file, solution, seconds))
    elif not quiet:
        typer.echo(_as_text(file, solution, seconds))


def check_outputs(
    output: Path | None, marginals: Path | None, plot: Path | None, report: Path | None = None
) -> None:
    """Refuse outputs that would overwrite each other or cannot be written.

    Raises:
        InputError: two outputs of one name, a picture that is no PNG, a report that is no HTML, or a folder that is
            missing.
    """
    from clew.errors import InputError

    if report is not None and report.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{report}: reports are HTML files; give a name that ends in .html")

    if plot is not None and plot.suffix.lower() != ".png":
        raise InputError(f"{plot}: pictures are PNG files; give a name that ends in .png")
    given = [path for path in (output, marginals, plot, report) if path is not None]
    if len({path.resolve() for path in given}) < len(given):
        raise InputError(f"{given[0]}: two outputs have one name; give each its own")
    for path in given:
        if not path.resolve().parent.is_dir():
            raise InputError(f"{path}: the folder {path.parent} does not exist; make it first")


def parse_kernel(text: str) -> Kernel:
    """The robust kernel that ``NAME`` or ``NAME:SCALE`` stands for.

    Raises:
        InputError: no such kernel, or a scale that is not a positive number.
    """
    from clew import noise
    from clew.errors import InputError

    kernels: dict[str, Callable[..., Kernel]] = {
        "huber": noise.Huber,
        "pseudo-huber": noise.PseudoHuber,
        "cauchy": noise.Cauchy,
        "geman-mcclure": noise.GemanMcClure,
        "welsch": noise.Welsch,
        "tukey": noise.Tukey,
        "dcs": noise.DCS,
    }
    name, colon, scale = text.partition(":")
    if name.lower() not in kernels:
        raise InputError(f"--robust {text}: no kernel of that name; choose {', '.join(kernels)}")
    kernel = kernels[name.lower()]
    if not colon:
        return kernel()
    try:
        number = float(scale)
    except ValueError:
        raise InputError(f"--robust {text}: {scale!r} is not a number") from None
    return kernel(number)


def _check(file: GraphFile, init: Init) -> None:
    from clew.errors import InputError

    if init is Init.FILE and not file.has_values:
        raise InputError(f"{file.path}: the file gives no values of vertices; use --init auto")


def _as_json(file: GraphFile, solution: Solution, seconds: dict[str, float]) -> str:
    return json.dumps(
        {
            "chi2_initial": _finite(solution.chi2_initial),
            "chi2": _finite(solution.chi2),
            "iterations": solution.iterations,
            "status": solution.status.name.lower(),
            "message": solution.status.value,
            "init": solution.init,
            "diagnosis": list(solution.diagnosis),
            "notes": _notes(file),
            "seconds": seconds,
        }
    )


def _finite(number: float) -> float | None:
    return number if math.isfinite(number) else None  # JSON has no infinity


def _as_text(file: GraphFile, solution: Solution, seconds: dict[str, float]) -> str:
    counts = ", ".join(f"{count:,} {name}" for name, count in file.graph.counts.items())
    lines = [f"{file.path.name}: {counts}", *_notes(file)]
    lines.append(
        f"chi2 {solution.chi2_initial:.6g} -> {solution.chi2:.6g} in {solution.iterations} iterations "
        f"from the guess {solution.init!r}"
    )
    lines += [solution.status.value, *solution.diagnosis]
    lines.append(", ".join(f"{stage} {1e3 * spent:.0f} ms" for stage, spent in seconds.items()))
    return "\n".join(lines)


def _notes(file: GraphFile) -> list[str]:
    """What reading the file found worth saying."""
    report = file.report
    notes = []
    if count := len(report.reduced):
        notes.append(
            f"{_count(count, 'edge has', 'edges have')} an indefinite information matrix (first in line "
            f"{report.reduced[0]}); their translation and rotation blocks are used"
        )
    if (count := len(report.created)) and file.has_values:
        first = ", ".join(map(str, report.created[:3])) + (", ..." if count > 3 else "")
        notes.append(
            f"{_count(count, 'vertex is', 'vertices are')} only mentioned by edges ({first}) and given no values"
        )
    if count := len(report.repeated):
        notes.append(
            f"{_count(count, 'line defines', 'lines define')} a vertex again (first in line {report.repeated[0]}); the "
            "first definition of each was taken"
        )
    for tag, count in report.unknown_tags.items():
        name = tag if tag.isprintable() else ascii(tag)
        notes.append(f"{_count(count, 'line', 'lines')} {name}: not understood and left out")
    return notes


def _count(count: int, one: str, many: str) -> str:
    return f"{count:,} {one if count == 1 else many}"


class _Clock:
    """Seconds by stage."""

    def __init__(self) -> None:
        self._start = self._last = time.perf_counter()
        self.seconds = dict.fromkeys(("read", "initialise", "solve", "marginals", "write"), 0.0)

    def skip(self) -> None:
        """Leave the time since the last lap to no stage."""
        self._last = time.perf_counter()

    def lap(self, stage: str) -> None:
        """Count the time since the last lap."""
        now = time.perf_counter()
        self.seconds[stage] = now - self._last
        self._last = now

    def finish(self) -> dict[str, float]:
        """All stages and the total."""
        return {**self.seconds, "total": time.perf_counter() - self._start}
