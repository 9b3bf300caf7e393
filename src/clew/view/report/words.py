"""Numbers as people say them."""

from __future__ import annotations

import math
from collections.abc import Sequence


def counted(number: int, noun: str, plural: str | None = None) -> str:
    """A number with its noun: ``1 pose``, ``1,728 poses``."""
    return f"{number:,} {noun if number == 1 else plural or noun + 's'}"


def metres(length: float) -> str:
    """A length with a unit that fits its size and three digits."""
    if not math.isfinite(length):
        return "unknown"
    if abs(length) >= 10_000:
        return f"{length / 1000:,.0f} km"
    if abs(length) >= 1000:
        return f"{length / 1000:.2f} km"
    if abs(length) >= 100:
        return f"{length:.0f} m"
    if abs(length) >= 1:
        return f"{length:.2f} m" if abs(length) < 10 else f"{length:.1f} m"
    if abs(length) >= 0.1:
        return f"{100 * length:.0f} cm"
    return f"{100 * length:.1f} cm" if abs(length) >= 0.01 else f"{1000 * length:.1f} mm"


def degrees(angle: float) -> str:
    """An angle given in radians."""
    value = math.degrees(angle)
    return f"{value:.0f}°" if abs(value) >= 10 else f"{value:.1f}°" if abs(value) >= 1 else f"{value:.2f}°"


def duration(seconds: float) -> str:
    """A time span: ``12.5 s``, ``44 min 51 s``, ``3 h 12 min``."""
    if seconds < 100:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600:,} h {whole % 3600 // 60} min"


def number(value: float) -> str:
    """Four digits, no exponent where one can do without."""
    if not math.isfinite(value):
        return "-"
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.4g}"


def listed(items: Sequence[str]) -> str:
    """``a``, ``a and b``, ``a, b and c``."""
    return " and ".join(part for part in (", ".join(items[:-1]), *items[-1:]) if part)


def key_name(key: int) -> str:
    """A key of a graph; one whose top byte is a robot's letter as letter and number."""
    letter = key >> 56
    return f"{chr(letter)}{key & (2**56 - 1)}" if chr(max(letter, 0)).isalpha() else str(key)


def capital(text: str) -> str:
    """A sentence from a phrase."""
    text = text.strip()
    return text[:1].upper() + text[1:] + ("" if text.endswith((".", "!", "?")) else ".")
