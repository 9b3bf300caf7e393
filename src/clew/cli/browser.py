"""Opening a page in the user's browser."""

from __future__ import annotations

import os
import sys
import webbrowser


def has_display() -> bool:
    """Whether there is a screen for a browser; one in the terminal would take the terminal away."""
    return sys.platform in ("darwin", "win32") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def open_in_browser(url: str) -> bool:
    """Open an address; whether there was a browser to do so."""
    if not has_display():
        return False
    try:
        return webbrowser.open(url)
    except webbrowser.Error:
        return False
