"""The live view: a run shown while it works, in the browser or in rerun."""

from clew.view.live.browser import BrowserViewer
from clew.view.live.rerun import RerunViewer

__all__ = ["BrowserViewer", "RerunViewer"]
