"""The live view in a browser; nothing beside the standard library is needed."""

from __future__ import annotations

import time
from dataclasses import replace

from clew.slam import Slam
from clew.view.live.frame import Feed, FrameMaker
from clew.view.live.server import LOOPBACK, LiveServer

LEAST_INTERVAL = 0.15  # seconds between two frames
RUN_SHARE = 0.02  # of the run's time that taking frames may cost


class BrowserViewer:
    """Shows a `Slam` at work on a page that a small local server hands out.

        with BrowserViewer(title="intel") as viewer:
            print(viewer.url)
            slam = Slam(viewer=viewer)
            ...

    Frames are taken a few times a second, and less often where that would cost more than two hundredths of the
    run's time. A page that is closed, slow or not there changes nothing: it is given the newest frame when it asks.

    Args:
        title: of the page.
        host: address to listen at.
        port: 0 for any that is free.
        total: scans in the log, for the progress; 0 if that is not known.

    Raises:
        InputError: the server cannot listen there.
    """

    def __init__(self, title: str = "", host: str = LOOPBACK, port: int = 0, total: int = 0) -> None:
        self.feed = Feed()
        self.server = LiveServer(self.feed, title, host, port)
        self._maker = FrameMaker(total)
        self._stage = "mapping"
        self._next = 0.0

    @property
    def url(self) -> str:
        """The address of the page, with its token."""
        return self.server.url

    def __enter__(self) -> BrowserViewer:
        return self

    def __exit__(self, *of_error: object) -> None:
        self.close("finished" if of_error[0] is None else "failed")

    def update(self, slam: Slam) -> None:
        """Take a frame if it is time for one."""
        begin = time.perf_counter()
        if begin >= self._next:
            self.feed.publish(self._maker.take(slam, self._stage))
            spent = time.perf_counter() - begin
            self._next = begin + max(LEAST_INTERVAL, spent / RUN_SHARE)

    def moved(self, slam: Slam) -> None:
        """Take a frame at once."""
        self.feed.publish(self._maker.take(slam, self._stage))

    def stage(self, stage: str) -> None:
        """Say what goes on from now on."""
        self._stage = stage
        self.feed.publish(replace(self.feed.newest(), stage=stage))

    def finish(self, stage: str = "finished") -> None:
        """Say that no frame will follow; pages keep the last one. What is said first counts."""
        if not self.feed.newest().last:
            self.feed.publish(replace(self.feed.newest(), stage=stage, last=True))

    def close(self, stage: str = "finished") -> None:
        """Say that no frame will follow and stop the server as soon as open pages have the last one."""
        self.finish(stage)
        self.server.close()
