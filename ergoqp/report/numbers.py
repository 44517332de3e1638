"""Numbers as people read them: no exponents, and no more digits than matter."""

from __future__ import annotations

from typing import Final

import numpy as np

_LEAST: Final = 1e-6
"""What is smaller is said to be smaller than this."""


def plain(value: float, digits: int = 3) -> str:
    """Write a number to some significant digits, such as ``4420``, ``0.0312``, ``< 0.000001``.

    Args:
        value: any number; what is not finite is a dash.
        digits: that are not zeros at its end.
    """
    value = float(value)
    if not np.isfinite(value):
        return "–"
    if 0 < abs(value) < _LEAST:
        return f"< {np.format_float_positional(_LEAST)}" if value > 0 else "0"
    text = np.format_float_positional(value, digits, unique=False, fractional=False, trim="-")
    return text.replace("-", "−")


def microseconds(value: float) -> str:
    """Write a duration [µs], in the unit in which it is easy to read up to ten seconds."""
    return f"{plain(value)} µs" if value < 1e4 else f"{plain(value / 1e3)} ms"
