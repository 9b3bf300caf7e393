"""Frames as messages to a page: what the page does not have yet, arrays in base 64."""

from __future__ import annotations

import base64
import json

import numpy as np
from numpy.typing import NDArray

from clew.view.live.frame import LiveFrame

Array = NDArray[np.float64]

CLOUDS_AT_ONCE = 300  # keyframes; a page that comes late gets the map in pieces


class Messenger:
    """Writes frames for one page and remembers what it has been sent."""

    def __init__(self) -> None:
        self._poses: Array = np.zeros((0, 3))
        self._clouds = 0

    @property
    def behind(self) -> bool:
        """Whether the page has not yet got the returns of all keyframes of the last frame."""
        return self._clouds < len(self._poses)

    def write(self, frame: LiveFrame) -> bytes:
        """The message of a frame: one event of a `text/event-stream` (WHATWG HTML, server-sent events).

        Poses are sent from the first one that has changed.
        """
        poses, old = frame.poses, self._poses
        common = min(len(poses), len(old))
        changed = np.flatnonzero((poses[:common] != old[:common]).any(axis=1))
        first = int(changed[0]) if len(changed) else common
        end = min(self._clouds + CLOUDS_AT_ONCE, len(poses))
        clouds = frame.clouds[self._clouds : end]
        content = {
            "stage": frame.stage, "scans": frame.scans, "total": frame.total, "rejected": frame.rejected,
            "seconds": round(frame.log_seconds, 2), "robot": [round(v, 4) for v in frame.robot.tolist()],
            "sensor": frame.sensor.tolist(), "keyframes": len(poses), "first": first,
            "poses": _packed(poses[first:].astype("<f4")), "clouds": [len(cloud) for cloud in clouds],
            "points": _packed(np.concatenate([*clouds, np.zeros((0, 2), np.int16)]).astype("<i2")),
            "scan": _packed(frame.scan.astype("<i2")), "closures": _packed(frame.closures.astype("<i4")),
        }  # fmt: skip
        self._poses, self._clouds = poses, end
        name = b"event: last\n" if frame.last and not self.behind else b""
        return name + b"data: " + json.dumps(content, separators=(",", ":")).encode() + b"\n\n"


def _packed(array: NDArray[np.generic]) -> str:
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()
