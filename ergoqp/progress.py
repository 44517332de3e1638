"""What long work calls to say how far it is."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[float], None]
"""Is called with the share that is done, from 0 to 1."""


def unseen(share: float) -> None:
    """Let nobody see how far it is."""


def part_of(progress: Progress, begin: float, end: float) -> Progress:
    """Return the progress of a part of the work, which begins and ends at these shares of it."""
    return lambda share: progress(begin + (end - begin) * share)
