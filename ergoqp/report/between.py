"""Values that are known between two ends, in words: ``4``, ``4 to 7``, ``5 (4 to 7)``."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ergoqp.report import palette


def between(low: str, high: str) -> str:
    """Return two ends in words, as one if they are equal."""
    return low if low == high else f"{low} to {high}"


def around(best: float, low: float, high: float, form: Callable[[float], str] = str) -> str:
    """Return a value with its ends.

    The value itself is left out if it is the lower end: what is not seen is taken as zero, which
    often scores lowest, and such a score is no estimate.

    Args:
        best: the value of the likeliest postures.
        low: its lower end.
        high: its upper end.
        form: how a number is written.
    """
    words = between(form(low), form(high))
    return words if form(best) == form(low) else f"{form(best)} ({words})"


def risk_between(low: int, high: int) -> str:
    """Return the words of the risk of two final scores, ``"low"`` or ``"low to high"``."""
    return between(palette.risk_of_score(low), palette.risk_of_score(high))


def levels_between(low: float, high: float) -> tuple[int, ...]:
    """Return the action levels from that of one final score, or mean of them, to that of another.

    Args:
        low: the lower score, 1 to 15.
        high: the higher one.
    """
    ends: NDArray[np.int64] = palette.level_of_score([round(low), round(high)])
    return tuple(range(int(ends[0]), int(ends[1]) + 1))
