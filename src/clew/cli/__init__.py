"""The clew command."""

from __future__ import annotations

from clew.cli.main import main

__all__ = ["main"]
