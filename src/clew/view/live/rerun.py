"""The live view in rerun (rerun.io), for who has it: ``pip install 'clew[live]'``."""

from __future__ import annotations

import importlib
import importlib.util
import logging
import socket
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from clew.errors import InputError, MissingDependencyError
from clew.geometry import se2
from clew.slam import Slam
from clew.view.live.frame import FrameMaker, LiveFrame
from clew.view.live.server import LOOPBACK

_log = logging.getLogger(__name__)

LEAST_INTERVAL = 0.3  # seconds between two frames
MAP_INTERVAL = 2.0  # and between two maps
RUN_SHARE = 0.04  # of the run's time that showing may cost
MOST_MAP_POINTS = 200_000
START_SECONDS, SETTLE_SECONDS, FLUSH_SECONDS = 15.0, 1.0, 10.0
_OTHERWISE = "use --live FILE.rrd for a recording, or --live for the browser"

_WALL, _SCAN = (20, 23, 29), (232, 89, 12)
_PATH, _CLOSURE = (22, 104, 214), (194, 37, 92)


def load_rerun() -> Any:
    """The library `rerun`, told apart: missing, or installed but of another make.

    Raises:
        MissingDependencyError: it is missing or does not fit.
    """
    advice = "install it with: pip install 'clew[live]', or use --live, which needs nothing"
    if importlib.util.find_spec("rerun") is None:
        raise MissingDependencyError(f"the live view in rerun needs the library rerun-sdk, which is missing; {advice}")
    needed = ("RecordingStream", "Points2D", "LineStrips2D", "TextLog")
    try:
        rerun = importlib.import_module("rerun")
        missing = [name for name in needed if not hasattr(rerun, name)]
    except Exception as error:  # a broken installation may raise anything
        raise MissingDependencyError(f"the installed rerun cannot be loaded ({error}); {advice}") from error
    if missing:
        raise MissingDependencyError(f"the installed rerun does not fit (it has no {missing[0]}); {advice}")
    return rerun


class RerunViewer:
    """Shows a `Slam` at work in the rerun viewer, or writes a recording for it.

    Args:
        title: of the recording.
        save: an ``.rrd`` file to write; None starts the viewer.
        total: scans in the log.

    Raises:
        MissingDependencyError: the library is missing or does not fit.
        InputError: the viewer does not start, or the file cannot be written.
    """

    def __init__(self, title: str = "", save: Path | None = None, total: int = 0) -> None:
        self._rr = load_rerun()
        self._stream = self._rr.RecordingStream("clew")
        try:
            if save is None:
                self._stream.connect_grpc(_start_viewer())
            else:
                self._stream.save(str(save))
        except InputError:
            raise
        except Exception as error:  # the library's own errors are of many kinds
            where = "the rerun viewer cannot be reached" if save is None else f"{save}: cannot be written"
            raise InputError(f"{where} ({' '.join(str(error).split())}); {_OTHERWISE}") from None
        if title:
            self._stream.send_recording_name(title)
        self._maker = FrameMaker(total)
        self._stage, self._ended = "mapping", False
        self._next = self._next_map = 0.0

    def __enter__(self) -> RerunViewer:
        return self

    def __exit__(self, *of_error: object) -> None:
        self.close("finished" if of_error[0] is None else "failed")

    def update(self, slam: Slam) -> None:
        """Show a frame if it is time for one."""
        begin = time.perf_counter()
        if begin >= self._next:
            self._show(slam, with_map=begin >= self._next_map)
            spent = time.perf_counter() - begin
            self._next = begin + max(LEAST_INTERVAL, spent / RUN_SHARE)
            if begin >= self._next_map:
                self._next_map = begin + MAP_INTERVAL

    def moved(self, slam: Slam) -> None:
        """Show a frame with the map at once."""
        self._show(slam, with_map=True)

    def stage(self, stage: str) -> None:
        """Say what goes on from now on."""
        self._stage = stage
        self._stream.log("stage", self._rr.TextLog(stage))

    def finish(self, stage: str = "finished") -> None:
        """Say that no frame will follow. What is said first counts."""
        if not self._ended:
            self._ended = True
            self.stage(stage)

    def close(self, stage: str = "finished") -> None:
        """Say that no frame will follow and hand over what is still to be written."""
        self.finish(stage)
        try:
            self._stream.flush(timeout_sec=FLUSH_SECONDS)
        except Exception as error:  # the viewer was closed; the library's own errors are of many kinds
            _log.info("the rerun viewer has not taken everything (%s)", error)
        self._stream.disconnect()

    def _show(self, slam: Slam, with_map: bool) -> None:
        frame = self._maker.take(slam, self._stage)
        rr, stream = self._rr, self._stream
        stream.set_time("log", duration=frame.log_seconds)
        path = frame.poses[:, :2]
        stream.log("world/path", rr.LineStrips2D([_up(path)], colors=[_PATH]))
        stream.log("world/robot", rr.Points2D(_up(frame.robot[None, :2]), colors=[_PATH], radii=[0.2]))
        scan = se2.act(frame.robot, frame.scan / 100.0)
        stream.log("world/scan", rr.Points2D(_up(scan), colors=[_SCAN], radii=[0.04]))
        stream.log("world/closures", rr.LineStrips2D(_up(path[frame.closures]), colors=[_CLOSURE]))
        if with_map:
            stream.log("world/map", rr.Points2D(_up(map_points(frame)), colors=[_WALL], radii=[0.025]))


def _start_viewer() -> str:
    """Start the viewer, for this machine only, and tell its address; the library's own way listens to all machines.

    Raises:
        InputError: it ends at once, or does not listen in time.
    """
    with socket.socket() as free:
        free.bind((LOOPBACK, 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "rerun", "--bind", LOOPBACK, "--port", str(port)]
    viewer = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                              start_new_session=True)
    until = time.monotonic() + START_SECONDS
    while time.monotonic() < until and viewer.poll() is None:
        with suppress(OSError), socket.create_connection((LOOPBACK, port), timeout=1.0):
            time.sleep(SETTLE_SECONDS)  # without a screen it listens first, and then ends
            if viewer.poll() is None:
                return f"rerun+http://{LOOPBACK}:{port}/proxy"
        time.sleep(0.1)
    if viewer.poll() is None:
        viewer.terminate()
    raise InputError(f"the rerun viewer does not start (is there a screen?); {_OTHERWISE}")


def map_points(frame: LiveFrame) -> NDArray[np.float64]:
    """``(n, 2)`` returns of all keyframes in the world, thinned to what a viewer takes."""
    clouds = frame.clouds[: len(frame.poses)]
    if not clouds:
        return np.zeros((0, 2))
    poses = np.repeat(frame.poses, [len(cloud) for cloud in clouds], axis=0)
    points = np.concatenate(clouds)
    step = max(1, -(-len(points) // MOST_MAP_POINTS))
    return np.asarray(se2.act(poses[::step], points[::step] / 100.0))


def _up(points: NDArray[np.float64]) -> NDArray[np.float32]:
    """With y upwards: rerun's two-dimensional views have it downwards."""
    return np.asarray(points * np.array([1.0, -1.0]), dtype=np.float32)
