"""The map that scans are matched against: the last few keyframes."""

from __future__ import annotations

from dataclasses import dataclass

from clew.place import surfels_of
from clew.scan import IndexedClouds, LaserScan, LikelihoodPyramid, ScanPoints, build_pyramid, fill_surfaces, index_cloud
from clew.slam.config import SlamConfig
from clew.slam.keyframes import KeyframeStore
from clew.slam.recent_views import RecentViews

PYRAMID_LEVELS = 5


@dataclass(frozen=True)
class LocalMap:
    """Surfels of recent keyframes in the frame of the last one, for alignment and for the correlative search.

    What these keyframes saw goes with them, to find returns that contradict it.
    """

    index: IndexedClouds
    pyramid: LikelihoodPyramid
    views: RecentViews


class LocalMapBuilder:
    """Makes the local map anew at each keyframe; walls that a keyframe sampled sparsely are filled once."""

    def __init__(self, keyframes: KeyframeStore, config: SlamConfig) -> None:
        self._keyframes = keyframes
        self._config = config
        self._views = RecentViews(keyframes)
        self._surfaces: dict[int, ScanPoints] = {}  # those of the keyframes in the map, filled

    def build(self, index: int, scan: LaserScan) -> LocalMap:
        """The map about keyframe `index`, the newest, without what the keyframes in it contradict.

        Args:
            index: its number.
            scan: that it was made of.
        """
        options, cleaning = self._config.tracking, self._config.cleaning
        members = self._keyframes.between(index + 1 - options.map_keyframes, index + 1)
        changed = self._views.add(index, scan, members)
        self._surfaces = {
            k: self._surfaces[k]
            if k in self._surfaces and k not in changed
            else fill_surfaces(self._keyframes[k].points, cleaning)
            for k in members.tolist()
        }
        poses = self._keyframes.relative(index, members)
        surfels = surfels_of(list(self._surfaces.values()), poses, options.voxel)
        pyramid = build_pyramid(
            surfels.points, resolution=options.resolution, sigma=options.sigma, levels=PYRAMID_LEVELS
        )
        return LocalMap(index_cloud(surfels), pyramid, self._views)
