"""The places of a run: submaps about anchors and what they look like, made when they are asked for."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from clew.place import DescriptorIndex, Submap, TurnedRings, build_submap
from clew.scan import ScanPoints
from clew.slam.config import SlamConfig
from clew.slam.keyframes import KeyframeStore

Array = NDArray[np.float64]

QUERY_VOXEL = 0.05  # metres
#: Returns of a keyframe that a closure may tie: one that saw hardly anything itself hangs on others only by the way
#: between, which the match does not know.
LEAST_RETURNS = 20


@dataclass(frozen=True)
class Query:
    """What is to be found again: the surroundings of keyframe `source` as seen until then, in its frame.

    Attributes:
        source: index of the keyframe.
        members: keyframes that it is made of.
        surfels: its points.
        appearance: ``(d,)`` its descriptor.
    """

    source: int
    members: NDArray[np.int64]
    surfels: ScanPoints
    appearance: Array

    @property
    def view(self) -> Array:
        """``(2,)`` middle of what is seen, in the frame of the source."""
        return _view(self.surfels)


class Places:
    """Submaps and descriptors of keyframes."""

    def __init__(self, keyframes: KeyframeStore, config: SlamConfig) -> None:
        self._keyframes = keyframes
        self._options = config.closing
        self._submaps: OrderedDict[int, Submap] = OrderedDict()
        self._descriptor = TurnedRings()
        self._index = DescriptorIndex(self._descriptor)
        self._views: dict[int, Array] = {}

    def query(self, source: int) -> Query:
        """What the robot saw on its way to a keyframe."""
        members = self._keyframes.between(source + 1 - self._options.query_keyframes, source + 1)
        surfels = self._keyframes.surfels(source, members, QUERY_VOXEL)
        return Query(source, members, surfels, self._descriptor.describe([surfels])[0])

    def end(self, source: int) -> int:
        """Keyframes before this one lie a good stretch of path before the source, as do those of submaps about them."""
        paths = self._keyframes.paths
        far = int(np.searchsorted(paths, paths[source] - self._options.path))
        return max(min(source - self._options.submap_keyframes, far), 0)

    def are_anchors(self, keyframes: NDArray[np.int64], source: int) -> NDArray[np.bool_]:
        """Which keyframes carry a submap that a source may be matched against."""
        counted = (keyframes % self._options.anchor_every == 0) & (keyframes < self.end(source))
        return np.asarray(counted & (self._keyframes.returns[keyframes] >= LEAST_RETURNS))

    def can_close(self, source: int) -> bool:
        """Whether a keyframe saw enough itself, and places that it may be matched against lie before it."""
        return self.end(source) > 0 and bool(self._keyframes.returns[source] >= LEAST_RETURNS)

    def submap(self, anchor: int) -> Submap:
        """The submap about an anchor; the latest ones asked for are kept."""
        if anchor in self._submaps:
            self._submaps.move_to_end(anchor)
            return self._submaps[anchor]
        submap = self.submap_of(anchor, self._about(anchor))
        self._submaps[anchor] = submap
        if len(self._submaps) > self._options.cached_submaps:
            self._submaps.popitem(last=False)
        return submap

    def submap_of(self, keyframe: int, members: NDArray[np.int64]) -> Submap:
        """A submap of chosen keyframes in the frame of one of them."""
        keyframes = self._keyframes
        return build_submap(
            keyframe, keyframes.clouds(members), keyframes.relative(keyframe, members), keyframes.sensors(members)
        )

    def similarities(self, anchors: NDArray[np.int64], appearance: Array) -> Array:
        """Likeness ``(A,)`` of anchors with a descriptor."""
        new = [int(a) for a in anchors if int(a) not in self._index]
        if new:
            surfels = [self._keyframes.surfels(a, self._about(a), QUERY_VOXEL) for a in new]
            self._index.add(new, self._descriptor.describe(surfels))
            self._views.update(zip(new, map(_view, surfels), strict=True))
        return self._index.similarities(anchors, appearance)

    def view(self, anchor: int) -> Array:
        """``(2,)`` middle of what is seen about an anchor whose likeness has been asked for, in its frame."""
        return self._views[anchor]

    def forget(self, keyframes: list[int]) -> None:
        """Keyframes have been pruned: no more places of their own, but still part of the submaps that hold them."""
        for keyframe in keyframes:
            self._submaps.pop(keyframe, None)
            self._views.pop(keyframe, None)
        self._index.remove([k for k in keyframes if k in self._index])

    def renew(self) -> None:
        """Returns of keyframes have changed a little: submaps are made anew; what places look like stays."""
        self._submaps.clear()

    def _about(self, anchor: int) -> NDArray[np.int64]:
        half = self._options.submap_keyframes
        return self._keyframes.between(anchor - half, anchor + half + 1)


def _view(surfels: ScanPoints) -> Array:
    return np.asarray(surfels.points.mean(axis=0)) if len(surfels) else np.zeros(2)
