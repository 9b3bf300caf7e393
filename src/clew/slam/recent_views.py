"""What the keyframes of the local map saw, and which of each other's returns they contradict."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from clew.geometry import se2
from clew.mapping import View, Views, contradicted, view_of
from clew.scan import LaserScan, ScanPoints
from clew.slam.keyframes import KeyframeStore

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]
Counts = NDArray[np.int32]


class RecentViews:
    """Finds returns that the rays of other keyframes contradict, before and after them.

    A person is seen at a place that was free shortly before, and will be shortly after; so the newest keyframe is held
    against those of the local map, and these against it. All of it is in the front end's own frame, which no closure
    bends, so that nothing is ever moved. What it costs does not depend on how long the run is.
    """

    def __init__(self, keyframes: KeyframeStore) -> None:
        self._keyframes = keyframes
        self._numbers = np.empty(0, np.int64)  # of the keyframes, and of each
        self._clouds: list[ScanPoints] = []  # all of its returns,
        self._each: list[View] = []  # and what it saw.
        self._owner = np.empty(0, np.int64)  # Of all returns together: row of the keyframe,
        self._points = np.empty((0, 2))  # place,
        self._seen = np.empty(0, np.int32)  # and how many of the others saw it,
        self._through = np.empty(0, np.int32)  # or saw through it,
        self._left_out = np.empty(0, np.bool_)  # and whether it is left out
        self._views = Views([])

    def __len__(self) -> int:
        return len(self._numbers)

    def looks_at(self, points: ScanPoints, T_keyframe_robot: Array) -> tuple[Counts, Counts]:
        """How many keyframes saw something at the place of each return of a scan, and how many saw through it.

        Args:
            points: in the robot's frame.
            T_keyframe_robot: ``(3,)`` pose of the robot seen from the newest keyframe.
        """
        newest = self._keyframes[int(self._numbers[-1])].T_local_robot
        return self._views.looks_at(points.points, se2.compose(newest, T_keyframe_robot))

    def add(self, index: int, scan: LaserScan, members: Index) -> list[int]:
        """Take the newest keyframe, and leave out of keyframes what is contradicted by now.

        Args:
            index: its number.
            scan: that it was made of.
            members: ``(M,)`` keyframes of the local map, itself among them; all others are forgotten.

        Returns:
            Those whose returns have become other ones.
        """
        self._keep(np.isin(self._numbers, members))
        keyframe = self._keyframes[index]
        view = view_of(scan, keyframe.T_local_robot)
        seen, through = Views([view]).looks_at(self._points)
        self._seen += seen
        self._through += through
        points = se2.act(keyframe.T_local_robot, keyframe.points.points)
        seen, through = self._views.looks_at(points)  # by the last one that left the map, too
        self._clouds.append(keyframe.points)
        self._each.append(view)
        self._views = Views(self._each)
        self._owner = np.concatenate([self._owner, np.full(len(points), len(self._numbers))])
        self._numbers = np.append(self._numbers, index)
        self._points = np.concatenate([self._points, points])
        self._seen = np.concatenate([self._seen, seen])
        self._through = np.concatenate([self._through, through])
        self._left_out = np.concatenate([self._left_out, np.zeros(len(points), dtype=np.bool_)])
        return self._leave_out()

    def _keep(self, rows: Mask) -> None:
        """Forget all keyframes but some."""
        of_returns = rows[self._owner]
        self._numbers = self._numbers[rows]
        self._clouds = [cloud for cloud, kept in zip(self._clouds, rows, strict=True) if kept]
        self._each = [view for view, kept in zip(self._each, rows, strict=True) if kept]
        self._owner = (np.cumsum(rows) - 1)[self._owner[of_returns]]
        self._points, self._left_out = self._points[of_returns], self._left_out[of_returns]
        self._seen, self._through = self._seen[of_returns], self._through[of_returns]

    def _leave_out(self) -> list[int]:
        """Leave keyframes with the returns that are not contradicted; numbers of those for which these changed."""
        moved = contradicted(self._seen, self._through)
        changed = np.unique(self._owner[moved != self._left_out])
        for row in changed:
            stays = ~moved[self._owner == row]
            self._keyframes.replace_points(int(self._numbers[row]), self._clouds[row].select(stays))
        self._left_out = moved
        return [int(k) for k in self._numbers[changed]]
