"""Check of a motion that the user's own code returns, and conversion to plain arrays."""

from __future__ import annotations

from collections.abc import Mapping
from numbers import Real
from typing import Any, Final

import numpy as np

from ergoqp.arguments import shown, unmasked
from ergoqp.recordings.fitting.axes import UPS
from ergoqp.recordings.formats.stamps import FASTEST, LONGEST, SLOWEST
from ergoqp.recordings.motion import JointMotion

_SLACK: Final = 0.1
"""Tolerance for the length of quaternions and axes, which should be one."""
_SLACK_TIME: Final = 0.999
"""Factor on the limits of the time between frames, as a tolerance for rounding."""
_LARGEST: Final = 1e9
"""Largest number in any unit; the square of a much larger one would be infinite."""


def lacking(motion: Any) -> str:
    """Return in words what of a motion violates `JointMotion`, or an empty text."""
    if not isinstance(motion, JointMotion):
        return shown(motion)
    names = motion.names
    listed = isinstance(names, tuple | list) and all(isinstance(n, str) and n for n in names)
    if not listed or not names:
        return f"the names {_line(names)}"
    if len(set(names)) < len(names):
        return "a name twice"
    if broken := [name for name in names if name.splitlines() != [name]]:
        return f"the name {shown(broken[0])}"
    times = _numbers(motion.time)
    if times is None or times.ndim != 1 or not len(times):
        return f"the times {_line(motion.time)}"
    count = len(times)
    shapes: list[tuple[str, Any, tuple[int, ...]]] = [
        ("positions", motion.positions, (count, len(names), 3))
    ]
    if motion.rest is not None:
        shapes.append(("rest", motion.rest, (len(names), 3)))
    for what, each, shape in (
        ("turns", motion.turns, (count, 4)),
        ("objects", motion.objects, (count, 4, 4)),
        ("angles", motion.angles, (count,)),
    ):
        if not isinstance(each, Mapping) or not all(isinstance(name, str) for name in each):
            return f"the {what} {_line(each)}"
        shapes += [(f"{what} of {name}", values, shape) for name, values in each.items()]
    for what, values, shape in shapes:
        if wrong := _no_numbers(values, shape):
            return f"{what} {wrong}"
    return _no_times(times) or _no_turns(motion) or _too_large(motion, shapes) or _no_words(motion)


def normalised(motion: JointMotion) -> JointMotion:
    """Return a motion that passed `lacking` as arrays of floats, with times from zero.

    Masked elements become NaN, and so does a point with a missing coordinate.
    """
    time, positions = _floats(motion.time).astype(float), _floats(motion.positions)
    seen = np.isfinite(positions)
    partly = np.asarray(seen.any(axis=2) & ~seen.all(axis=2))
    if partly.any():
        positions = np.where(partly[:, :, None], positions.dtype.type(np.nan), positions)
    return JointMotion(
        tuple(motion.names),
        positions,
        time - time[0],
        None if motion.rest is None else _floats(motion.rest),
        tuple(motion.notes),
        {name: _floats(each) for name, each in motion.turns.items()},
        {name: _floats(each) for name, each in motion.objects.items()},
        {name: _floats(each) for name, each in motion.angles.items()},
        motion.markers,
        motion.unit,
        motion.up,
        dict(motion.measures),
    )


def _numbers(values: Any) -> np.ndarray | None:
    """Return an array of real numbers, NaN where they are masked; None if it is no such array."""
    try:
        array = unmasked(values)
    except Exception:  # rows of different lengths, or any error of a user's object
        return None
    return array if array.dtype.kind in "iuf" else None


def _floats(values: Any) -> np.ndarray:
    """Return numbers as floats of 64 bits; floats of 32 bits stay as they are."""
    array = unmasked(values)
    kind = np.float32 if (array.dtype.kind, array.dtype.itemsize) == ("f", 4) else np.float64
    with np.errstate(over="ignore"):  # numbers of more than 64 bits may overflow
        return array.astype(kind, copy=False)


def _no_numbers(values: Any, shape: tuple[int, ...]) -> str:
    """Return in words what is wrong with an array that needs a shape, or an empty text."""
    array = _numbers(values)
    if array is None:
        try:
            return f"of shape {np.shape(values)} and not numbers"
        except ValueError:
            return "whose rows differ in length"
    if array.shape != shape:
        return f"of shape {array.shape} and not {shape}"
    return "with infinite numbers" if np.isinf(_floats(array)).any() else ""


def _no_times(times: np.ndarray) -> str:
    """Return in words what is wrong with times in seconds, or an empty text."""
    times = _floats(times)
    if not np.isfinite(times).all() or not (np.diff(times) > 0).all():
        return "times that do not increase"
    if len(times) == 1:
        return ""
    step = float(np.median(np.diff(times)))
    if not _SLACK_TIME / FASTEST <= step <= 1 / (_SLACK_TIME * SLOWEST):
        return f"times that are {step:.3g} s apart and not {1 / FASTEST:g} to {1 / SLOWEST:g} s"
    if times[-1] - times[0] > LONGEST:
        return f"times over {times[-1] - times[0]:.3g} s and not at most {LONGEST:g} s"
    return ""


def _no_turns(motion: JointMotion) -> str:
    """Return in words which orientations or poses of a motion are invalid, or an empty text."""
    for name, turns in motion.turns.items():
        seen = _seen(turns)
        # Large numbers are refused first, because their squares could be infinite.
        if (np.abs(seen) > _SLACK + 1).any() or (
            np.abs(np.linalg.norm(seen, axis=1) - 1) > _SLACK
        ).any():
            return f"turns of {name} that are not unit quaternions"
    for name, poses in motion.objects.items():
        whole = _seen(poses)
        axes = whole[:, :3, :3]
        if (
            (np.abs(axes) > _SLACK + 1).any()
            or (np.abs(np.einsum("nij,nik->njk", axes, axes) - np.eye(3)) > _SLACK).any()
            or (np.linalg.det(axes) < 0).any()
            or (np.abs(whole[:, 3] - [0, 0, 0, 1]) > _SLACK).any()
        ):
            return f"objects of {name} that are not poses"
    return ""


def _too_large(motion: JointMotion, shapes: list[tuple[str, Any, tuple[int, ...]]]) -> str:
    """Return in words which numbers are too large, or an empty text; not for positions."""
    for what, values, _ in shapes[1:]:
        array = np.abs(_floats(values))
        if np.fmax.reduce(array, axis=None, initial=0.0) > _LARGEST:
            return f"{what} with a number beyond {_LARGEST:g}"
    return ""


def _seen(values: Any) -> np.ndarray:
    """Return the frames of an array (n, ...) that are complete."""
    array = _floats(values)
    return array[np.isfinite(array).reshape(len(array), -1).all(axis=1)]


def _no_words(motion: JointMotion) -> str:
    """Return in words which of the other attributes of a motion is invalid, or an empty text."""
    if motion.unit is not None and not (_is_number(motion.unit) and motion.unit > 0):
        return f"the unit {shown(motion.unit)}"
    if motion.up is not None and not (isinstance(motion.up, str) and motion.up in UPS):
        return f"the vertical axis {_line(motion.up)}"
    if not isinstance(motion.notes, tuple | list) or not all(
        isinstance(note, str) for note in motion.notes
    ):
        return f"the notes {_line(motion.notes)}"
    if not isinstance(motion.markers, bool | np.bool_):
        return f"the markers {_line(motion.markers)}"
    measures = motion.measures
    if not isinstance(measures, Mapping) or not all(map(_is_number, measures.values())):
        return f"the measures {_line(measures)}"
    return ""


def _is_number(value: Any) -> bool:
    number: Any = value
    real = isinstance(value, Real) and not isinstance(value, bool)
    return real and bool(-_LARGEST <= number <= _LARGEST)


def _line(value: Any) -> str:
    """Return a value in one line, for a message."""
    return " ".join(shown(value).split())
