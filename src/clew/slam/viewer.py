"""Watching a run while it works."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from clew.slam.slam import Slam

_log = logging.getLogger(__name__)


class Viewer(Protocol):
    """Something that shows a `Slam` at work, given to it as `Slam(viewer=...)`.

    It is called in the thread of the run and has to be quick; it asks `Slam` for what it needs and keeps no reference
    to arrays that it might change.
    """

    def update(self, slam: Slam) -> None:
        """A scan has been taken."""
        ...

    def moved(self, slam: Slam) -> None:
        """All keyframes have been optimised or refined."""
        ...


class NullViewer:
    """Shows nothing; what a `Slam` has unless it is given another."""

    def update(self, slam: Slam) -> None:
        """Nothing."""

    def moved(self, slam: Slam) -> None:
        """Nothing."""


class GuardedViewer:
    """Passes everything on to a viewer until it fails: then it is left alone, and the run goes on."""

    def __init__(self, viewer: Viewer) -> None:
        self._viewer = viewer

    def update(self, slam: Slam) -> None:
        """Pass it on."""
        try:
            self._viewer.update(slam)
        except Exception as error:  # whatever a viewer does wrong, the map is worth more
            self._give_up(error)

    def moved(self, slam: Slam) -> None:
        """Pass it on."""
        try:
            self._viewer.moved(slam)
        except Exception as error:  # as above
            self._give_up(error)

    def _give_up(self, error: Exception) -> None:
        _log.warning("the viewer failed (%s: %s); the run goes on without it", type(error).__name__, error)
        self._viewer = NullViewer()
