"""Ctrl-C as a request to stop after the present measurement."""

from __future__ import annotations

import signal
import threading
from types import FrameType, TracebackType


class Interrupt:
    """While the block lasts, the first Ctrl-C sets `requested`; a second one ends the program.

    Stopping between two measurements leaves the estimate whole, so that it can still be written.
    """

    def __init__(self) -> None:
        self.requested = False
        self._previous: signal.Handlers | int | object | None = None

    def __enter__(self) -> Interrupt:
        if threading.current_thread() is threading.main_thread():
            self._previous = signal.signal(signal.SIGINT, self._handle)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._previous is not None:
            signal.signal(signal.SIGINT, self._previous)  # type: ignore[arg-type]  # what signal.signal returned

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if self.requested:
            raise KeyboardInterrupt
        self.requested = True
