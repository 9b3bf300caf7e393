"""Typed errors: one clear line each, saying what is wrong, where, and what to do about it."""

from __future__ import annotations


class ClewError(Exception):
    """Base of all errors that clew raises on purpose; its text is one line for the user."""


class InputError(ClewError):
    """Input that cannot be used (a file, an option, a value); the command ends with exit code 2."""


class MissingDependencyError(ClewError):
    """An optional library that a request needs is missing or has an incompatible version."""
