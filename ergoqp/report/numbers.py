"""Numbers for people: no exponents, and no more digits than needed."""

from __future__ import annotations

from typing import Final

import numpy as np

_LEAST: Final = 1e-6
"""Smaller numbers are written as smaller than this."""


def plain(value: float, digits: int = 3) -> str:
    """Return a number with some significant digits, such as ``4420``, ``0.0312``, ``< 0.000001``.

    Args:
        value: any number; a number that is not finite gives a dash.
        digits: number of significant digits, without zeros at the end.
    """
    value = float(value)
    if not np.isfinite(value):
        return "–"
    if 0 < abs(value) < _LEAST:
        return f"< {np.format_float_positional(_LEAST)}" if value > 0 else "0"
    text = np.format_float_positional(value, digits, unique=False, fractional=False, trim="-")
    return text.replace("-", "−")


def microseconds(value: float) -> str:
    """Return a duration [µs] as text, in µs or ms."""
    return f"{plain(value)} µs" if value < 1e4 else f"{plain(value / 1e3)} ms"
