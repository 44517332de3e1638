"""Times of frames: their unit, frames of equal time, frames that repeat the one before."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

import numpy as np

from ergoqp.errors import RecordingError

_BLOCK: Final = 4000
"""Frames that are compared at once."""
_UNITS: Final = {
    1.0: "seconds",
    1e-3: "milliseconds",
    1e-6: "microseconds",
    1e-9: "nanoseconds",
    1e-7: "ticks of 100 nanoseconds",
}
"""Units of time [s], the usual ones first; .NET and Windows count in ticks."""
_SHORTEST, _STAMPS_LONGEST = 0.9e-3, 0.7
"""Limits of the median step between frames [s]."""
_PLAUSIBLE: Final = (9.0, 500.0)
"""Usual numbers of frames per second [Hz]: of several units that fit, one with such a rate wins."""
_SLOW: Final = 12.0
"""Below this rate, another unit with a usual rate is mentioned [Hz]."""
_CENTURY: Final = (946_684_800.0, 4_102_444_800.0)
"""The years 2000 to 2100, counted from 1970 [s]."""
_BEGINS: Final = {unit: (0.0,) for unit in _UNITS} | {1e-7: (11_644_473_600.0, 62_135_596_800.0)}
"""Unit -> beginnings of its clocks, before 1970 [s]: ticks count from the year 1601 or 1."""
SLOWEST, FASTEST = 0.01, 10_000.0
"""Limits of a stated rate [Hz]."""
RATES: Final = f"frames per second from {SLOWEST:g} to {FASTEST:g}"
LONGEST: Final = 1e7
"""Longest duration of a recording: four months [s]."""
_ALIKE: Final = 0.1
"""Relative difference that times and a stated rate may have."""
_OTHERS: Final = 0.02
"""Share of frames that may have the time of the frame before and other content, by mistake."""
_UNIT: Final = (
    r"s|sec|seconds|ms|msec|milliseconds|us|µs|usec|microseconds|ns|nsec|nanoseconds|ticks"
)
_TIMES: Final = re.compile(
    r"[%#]?\s*(?:time[\s_]?stamps?|times?|ts?|sec|seconds)"
    rf"(?:\s*[\[(]\s*(?P<unit>{_UNIT})\s*[\])]|[\s_.]+(?P<tail>{_UNIT}))?",
    re.IGNORECASE,
)
_SECONDS: Final = {"s": 1.0, "m": 1e-3, "u": 1e-6, "μ": 1e-6, "n": 1e-9, "t": 1e-7}
"""First letter of a unit of time -> the unit [s]; the mu is the Greek one that `casefold` gives."""


def to_seconds(
    where: str,
    stamps: np.ndarray,
    unit: float | None = None,
    shown: Sequence[np.ndarray] = (),
    remedy: str = "",
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Return times from zero [s], the frames that are kept (n,) bool, and sentences.

    A frame with the time of the frame before it is left out.

    Args:
        where: the file's name, for messages.
        stamps: the time column (n,).
        unit: its unit [s]; None finds it.
        shown: content of the frames, arrays (n, ...): frames of equal time should be equal.
        remedy: what the user can do if they differ, for the message.

    Raises:
        RecordingError: if most times are missing, time runs backwards, no unit fits, or many
            frames of equal time differ.
    """
    if not len(stamps):
        raise RecordingError(f"{where}: got no frame, allowed a recording with movement in it")
    known = np.isfinite(stamps)
    if not known.all():
        if known.sum() < max(2, len(known) / 2):
            raise RecordingError(f"{where}: frame {np.argmin(known) + 1} has no time")
        time, left, notes = to_seconds(
            where, stamps[known], unit, [values[known] for values in shown], remedy
        )
        kept = known.copy()
        kept[known] = left
        lost = f"{int((~known).sum())} of {len(known)} frames have no time and are left out."
        return time, kept, [lost, *notes]
    time = stamps - stamps[0]
    steps = np.diff(time)
    if len(back := np.flatnonzero(steps < 0)):
        at = int(back[0])
        raise RecordingError(
            f"{where}: time runs backwards from frame {at + 1} to {at + 2}, from"
            f" {stamps[at]:.10g} to {stamps[at + 1]:.10g}"
        )
    notes = []
    if unit is None:
        usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.01
        unit, notes = _unit_of(where, float(stamps[0]), usual)
    time = unit * time
    kept, said = drop_duplicate_times(where, time, shown, remedy)
    return time[kept], kept, [*said, *notes, _spacing(time[kept])]


def _unit_of(where: str, first: float, usual: float) -> tuple[float, list[str]]:
    """Return the unit of times [s], and a sentence if it is not seconds.

    Args:
        where: the file's name, for messages.
        first: the first time.
        usual: the median step.

    Raises:
        RecordingError: if no unit gives a rate of frames.
    """
    fitting = [each for each in _UNITS if _SHORTEST <= each * usual < _STAMPS_LONGEST]
    if not fitting:
        raise RecordingError(
            f"{where}: the frames are {usual:g} apart in time, allowed a thousandth to 0.7 of a"
            " second in seconds, milliseconds, microseconds, nanoseconds or ticks of 100 ns"
        )
    # A date shows the unit, whatever the step is.
    low, high = _CENTURY
    dated = [
        each
        for each in fitting
        if any(low <= each * first - begin <= high for begin in _BEGINS[each])
    ]
    slowest, fastest = _PLAUSIBLE
    likely = [each for each in fitting if slowest <= 1 / (each * usual) <= fastest]
    unit, *others = dated[:1] or likely or fitting
    if unit == 1.0:
        return unit, []
    said = f"Times are taken as {_UNITS[unit]}"
    if others and 1 / (unit * usual) < _SLOW:
        rates = (f"{1 / (each * usual):.3g} as {_UNITS[each]}" for each in others)
        said += f", {1 / (unit * usual):.3g} frames per second (they would be {', '.join(rates)})"
    return unit, [f"{said}."]


def drop_duplicate_times(
    where: str, time: np.ndarray, shown: Sequence[np.ndarray], remedy: str = ""
) -> tuple[np.ndarray, list[str]]:
    """Return the frames with another time than the frame before, (n,) bool, and sentences.

    Args:
        where: the file's name, for messages.
        time: times that do not run backwards (n,).
        shown: content of the frames, arrays (n, ...).
        remedy: what the user can do if frames of equal time differ, for the message.

    Raises:
        RecordingError: if many frames of equal time differ.
    """
    kept = np.concatenate([[True], np.diff(time) > 0])
    again = np.flatnonzero(~kept)
    if not len(again):
        return kept, []
    others = 0
    for begin in range(0, len(again), _BLOCK):
        at = again[begin : begin + _BLOCK]
        same = np.ones(len(at), dtype=bool)
        for values in shown:
            same &= are_alike(values[at], values[at - 1])
        others += int((~same).sum())
    if others > _OTHERS * len(kept):
        raise RecordingError(
            f"{where}: {others} of {len(kept)} frames have the time of the frame before and show"
            " something else, so the times are too coarse or there are several people, allowed"
            f" times that increase{remedy}"
        )
    differing = f" ({others} of them differ from it)" if others else ""
    return kept, [
        f"{len(again)} of {len(kept)} frames have the time of the frame before{differing} and are"
        " left out."
    ]


def time_head(word: str) -> tuple[bool, float | None]:
    """Return whether a column's head is that of times, and the unit that it states [s]."""
    match = _TIMES.fullmatch(word)
    stated = match and (match["unit"] or match["tail"])
    return match is not None, tick_of(stated) if stated else None


def tick_of(word: str) -> float | None:
    """Return the unit of time that a word denotes [s]; None if it denotes none."""
    return _SECONDS[word.casefold()[0]] if re.fullmatch(_UNIT, word, re.IGNORECASE) else None


def unit_by_rate(stamps: np.ndarray, rate: float) -> tuple[float, list[str]]:
    """Return the unit of times [s] with which their step agrees with a stated rate, and sentences.

    If no unit agrees, the times are taken as seconds, and a sentence says so: a rate in a header is
    often copied.

    Args:
        stamps: the time column (n,).
        rate: frames per second that the file states [Hz].
    """
    steps = np.diff(stamps)
    steps = steps[steps > 0]
    if not len(steps):
        return 1.0, []
    usual = float(np.median(steps))
    for unit, name in _UNITS.items():
        if abs(unit * usual * rate - 1) <= _ALIKE:
            said = f"Times are taken as {name}: the file states {rate:g} frames per second."
            return unit, [] if unit == 1.0 else [said]
    return 1.0, [
        f"The file states {rate:g} frames per second, but its times give {1 / usual:.4g}: the times"
        " are used."
    ]


def uniform_times(where: str, count: int, rate: float) -> tuple[np.ndarray, list[str]]:
    """Return times from zero [s] of frames whose rate was stated [Hz], and sentences.

    Raises:
        RecordingError: if the rate is out of range.
    """
    if not SLOWEST <= rate <= FASTEST:
        raise RecordingError(f"{where}: rate: got {rate:g}, allowed {RATES}")
    return np.arange(count) / rate, [f"There are {rate:g} frames per second, as stated."]


def count_repeated_frames(positions: np.ndarray) -> list[str]:
    """Return a sentence with the number of frames that repeat the frame before, if many do."""
    count = 0
    for at in range(1, len(positions), _BLOCK):
        now = positions[at : at + _BLOCK]
        before = positions[at - 1 : at - 1 + len(now)]
        count += int(are_alike(now, before).sum())
    if count < 0.01 * len(positions):
        return []
    return [f"{count} of {len(positions)} frames repeat the frame before."]


def are_alike(now: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Return which frames (n, ...) equal others (n, ...), with NaN equal to NaN, (n,) bool."""
    same = (now == before) | (np.isnan(now) & np.isnan(before))
    return same.all(axis=tuple(range(1, same.ndim)))


def _spacing(time: np.ndarray) -> str:
    """Return a sentence about the time between frames."""
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
