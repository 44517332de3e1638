"""When the frames of a recording are, by what its time column says."""

from __future__ import annotations

from typing import Final

import numpy as np

from ergoqp.errors import RecordingError

_UNITS: Final = {1.0: "seconds", 1e-3: "milliseconds", 1e-6: "microseconds", 1e-9: "nanoseconds"}
_SHORTEST, _LONGEST = 1e-3, 0.7
"""Between these is the usual step between frames [s]: no two units do."""


def seconds(
    where: str, stamps: np.ndarray, unit: float | None = None
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Return times from zero [s], the frames that are kept (n,) bool, and sentences.

    A frame with the time of the one before it is that frame once more, and left out.

    Args:
        where: the file's name, for messages.
        stamps: the time column (n,).
        unit: its unit [s]; None finds it.

    Raises:
        RecordingError: time is missing, runs backwards or has no unit that can be.
    """
    if not len(stamps):
        raise RecordingError(f"{where}: got no frame, allowed a recording with movement in it")
    if len(lost := np.flatnonzero(~np.isfinite(stamps))):
        raise RecordingError(
            f"{where}: frame {lost[0] + 1} has no time, allowed a time for each frame"
        )
    steps = np.diff(stamps)
    if len(back := np.flatnonzero(steps < 0)):
        at = int(back[0])
        raise RecordingError(
            f"{where}: time runs backwards from frame {at + 1} to {at + 2}, from"
            f" {stamps[at]:.10g} to {stamps[at + 1]:.10g}, allowed times that increase"
        )
    kept = np.concatenate([[True], steps > 0])
    notes = []
    if not kept.all():
        notes.append(
            f"{int((~kept).sum())} of {len(kept)} frames have the time of the frame before and are"
            " left out."
        )
    steps = np.diff(stamps[kept])
    if unit is None:
        usual = float(np.median(steps)) if len(steps) else 1.0
        fitting = [each for each in _UNITS if _SHORTEST <= each * usual < _LONGEST]
        if len(steps) and not fitting:
            raise RecordingError(
                f"{where}: the frames are {usual:g} apart in time, allowed is what is a thousandth"
                " to 0.7 of a second in seconds, milli-, micro- or nanoseconds"
            )
        unit = fitting[0] if fitting else 1.0
        if unit != 1.0:
            notes.append(f"Times are taken as {_UNITS[unit]}.")
    time = unit * (stamps[kept] - stamps[kept][0])
    notes.append(_spacing(time))
    return time, kept, notes


def repeated(positions: np.ndarray) -> list[str]:
    """Say how many frames are those before them once more."""
    same = (positions[1:] == positions[:-1]) | (np.isnan(positions[1:]) & np.isnan(positions[:-1]))
    count = int(same.all(axis=(1, 2)).sum())
    if count < 0.01 * len(positions):
        return []
    return [f"{count} of {len(positions)} frames are the frame before once more."]


def _spacing(time: np.ndarray) -> str:
    """Say how far apart the frames are."""
    steps = np.diff(time)
    if not len(steps):
        return "There is one frame."
    usual = float(np.median(steps))
    if np.abs(steps - usual).max() < 0.1 * usual:
        return f"The frames are uniform in time, {usual:.4g} s apart."
    return (
        f"The frames are not uniform in time: {usual:.4g} s apart in the median,"
        f" {steps.max():.4g} s at most."
    )
