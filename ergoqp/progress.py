"""Progress callbacks of long computations."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[float], None]
"""Called with the share that is done, from 0 to 1."""


def unseen(share: float) -> None:
    """Ignore the progress."""


def part_of(progress: Progress, begin: float, end: float) -> Progress:
    """Return the progress callback of a part of the work, between two shares of the whole."""
    return lambda share: progress(begin + (end - begin) * share)
