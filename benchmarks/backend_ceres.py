"""Ceres in full: a small program of our own (peers/ceres_pose_graph.cpp), compiled when the benchmark is run.

pyceres brings no cost of relative poses, and one written in Python would measure Python.
"""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
from pathlib import Path

from backend_peers import Refused, Run

SOURCE = Path(__file__).parent / "peers" / "ceres_pose_graph.cpp"
_EIGEN = ("/usr/include/eigen3", "/usr/local/include/eigen3", "/opt/homebrew/include/eigen3")


def build_ceres(folder: Path) -> tuple[Path | None, str]:
    """The compiled program, or None and why there is none: something is missing, or Ceres does not fit.

    Args:
        folder: where the program is put.
    """
    compiler = shlex.split(os.environ.get("CXX", "")) or ["c++"]
    if shutil.which(compiler[0]) is None:
        return None, f"missing: a C++ compiler ({compiler[0]} is not there)"
    includes = [f"-I{path}" for path in _EIGEN if Path(path).is_dir()]
    probe = [*compiler, "-x", "c++", "-std=c++17", "-E", *includes, "-include", "ceres/version.h", os.devnull]
    if subprocess.run(probe, capture_output=True, check=False).returncode:
        return None, "missing: apt-get install libceres-dev"
    program = folder / "ceres_pose_graph"
    flags = ["-O3", "-DNDEBUG", "-std=c++17", *includes]
    command = [*compiler, *flags, str(SOURCE), "-o", str(program), "-lceres", "-lglog"]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    if result.returncode:
        errors = [line for line in result.stderr.splitlines() if "error" in line or "undefined" in line]
        return None, f"incompatible: {(errors or ['it does not compile'])[0].strip()}"
    return program, ""


def run_ceres_program(program: str, path: Path, solid: bool, iterations: int) -> Run:
    """Ceres with relative poses in C++ and analytic Jacobians, the faster of SuiteSparse and Eigen, one thread."""
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    result = subprocess.run([program, str(path), str(iterations)], capture_output=True, text=True, check=False,
                            env=environment)
    if result.returncode:
        raise Refused(f"ended with code {result.returncode}")
    version, library, seconds, chi2 = result.stdout.split()
    if library == "none":
        raise Refused("no solution")
    return Run(f"Ceres {version}", float(seconds), float(chi2))
