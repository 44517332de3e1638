"""What a caller gives to a step: read without ever raising, because the loop goes on."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from ergoqp.arguments import shown, unmasked

_FLOAT: Final = np.dtype(float)


def put(
    target: np.ndarray, value: Any, shape: tuple[int, ...], name: str, notes: dict[str, str]
) -> None:
    """Copy a user's array into a buffer of the same shape.

    An unusable array fills the buffer with NaN, which the step detects, and leaves a note.
    """
    if type(value) is np.ndarray and value.dtype is _FLOAT and value.shape == shape:
        target[...] = value
        return
    try:
        array = value if type(value) is np.ndarray else unmasked(value)
        if array.shape != shape:
            notes[name] = f"{name} has shape {array.shape}, allowed {shape}"
        elif array.dtype.kind not in "biuf":
            notes[name] = f"{name} holds {array.dtype.name} values, allowed real numbers"
        else:
            target[...] = array
            return
    except Exception as error:  # any error of a user's object; the loop goes on
        notes[name] = (
            f"{name} cannot be read as an array ({type(error).__name__}), allowed shape {shape}"
        )
    target[...] = np.nan


def number(value: Any, name: str, notes: dict[str, str]) -> float:
    """Return a user's number. Anything else gives NaN, which the step detects, and leaves a note.

    A flag is no number: it stands for something else by mistake.
    """
    try:
        if not isinstance(value, (str, bytes, bytearray, bool, np.bool_)):
            return float(value)
    except Exception:  # any error: not a number
        pass
    notes[name] = f"{name} is {shown(value)}, allowed a number in s"
    return float("nan")


def truth(value: Any, name: str, notes: dict[str, str]) -> bool:
    """Return a user's flag. Any other value gives False and leaves a note.

    For example a text or NaN never enables anything.
    """
    try:
        if isinstance(value, (bool, np.bool_)):
            return bool(value)
        if not isinstance(value, (str, bytes, bytearray)) and float(value) in (0.0, 1.0):
            return float(value) == 1.0
        notes[name] = f"{name} is {value!r:.40}, allowed True or False"
    except Exception:  # any error of a user's object
        notes[name] = f"{name} cannot be read as True or False"
    return False
