"""When the frames of a recording are, by what its time column says."""

from __future__ import annotations

from typing import Final

import numpy as np

from ergoqp.errors import RecordingError

_UNITS: Final = {1.0: "seconds", 1e-3: "milliseconds", 1e-6: "microseconds", 1e-9: "nanoseconds"}
_SHORTEST, _LONGEST = 0.9e-3, 0.7
"""Between these is the usual step between frames [s]: no two units do."""
_SLOWEST, _FASTEST = 0.01, 10_000.0
"""Rates that may be stated [Hz]."""
_BLOCK: Final = 4000
"""Frames that are compared at once."""


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
    time = stamps - stamps[0]
    steps = np.diff(time)
    if len(back := np.flatnonzero(steps < 0)):
        at = int(back[0])
        raise RecordingError(
            f"{where}: time runs backwards from frame {at + 1} to {at + 2}, from"
            f" {stamps[at]:.10g} to {stamps[at + 1]:.10g}, allowed times that increase"
        )
    notes = []
    if unit is None:
        usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.01
        fitting = [each for each in _UNITS if _SHORTEST <= each * usual < _LONGEST]
        if not fitting:
            raise RecordingError(
                f"{where}: the frames are {usual:g} apart in time, allowed is what is a thousandth"
                " to 0.7 of a second in seconds, milli-, micro- or nanoseconds"
            )
        unit = fitting[0]
        if unit != 1.0:
            notes.append(f"Times are taken as {_UNITS[unit]}.")
    time = unit * time
    kept = np.concatenate([[True], np.diff(time) > 0])
    if not kept.all():
        notes.insert(
            0,
            f"{int((~kept).sum())} of {len(kept)} frames have the time of the frame before and are"
            " left out.",
        )
        time = time[kept]
    notes.append(_spacing(time))
    return time, kept, notes


def steady(where: str, count: int, rate: float) -> tuple[np.ndarray, list[str]]:
    """Return times from zero [s] of frames whose rate was stated [Hz], and sentences.

    Raises:
        RecordingError: the rate is none.
    """
    if not _SLOWEST <= rate <= _FASTEST:
        raise RecordingError(
            f"{where}: rate: got {rate:g}, allowed frames per second from {_SLOWEST:g} to"
            f" {_FASTEST:g}"
        )
    return np.arange(count) / rate, [f"There are {rate:g} frames per second, as stated."]


def repeated(positions: np.ndarray) -> list[str]:
    """Say how many frames are those before them once more."""
    count = 0
    for at in range(1, len(positions), _BLOCK):
        now = positions[at : at + _BLOCK]
        before = positions[at - 1 : at - 1 + len(now)]
        same = (now == before) | (np.isnan(now) & np.isnan(before))
        count += int(same.all(axis=(1, 2)).sum())
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
