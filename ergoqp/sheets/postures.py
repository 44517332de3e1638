"""Checks of posture arrays: shape and unit are checked once, here."""

from __future__ import annotations

from typing import Final, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ergoqp.errors import InputError
from ergoqp.joints import JOINTS
from ergoqp.sheets.description import TIE

_DECIMALS: Final = 4
"""Decimals [deg] to which 32-bit numbers are read; they may be off by 0.00002 deg."""


def read_postures(postures: ArrayLike) -> NDArray[np.float64]:
    """Return postures as a read-only array of shape (n, 32) [rad] that no other code can write to.

    32-bit numbers are rounded to the nearest 0.0001 deg, so that 60 deg are 60 deg.

    An array that already is read-only and owns its data is not copied: an hour of postures is
    110 MB.

    Args:
        postures: shape (n, 32) or (32,).

    Raises:
        InputError: if they are not numbers of that shape.
    """
    try:
        rows = postures if _is_final(postures) else np.array(postures, dtype=float, order="C")
        if rows is not postures and np.asarray(postures).dtype == np.float32:
            rows = np.radians(np.round(np.degrees(rows), _DECIMALS))
    except (TypeError, ValueError) as error:
        raise InputError(
            f"postures: got no array of numbers ({error}), allowed: shape (n, 32) or (32,) rad"
        ) from None
    if rows.shape == (len(JOINTS),):
        rows = rows[np.newaxis]
    if rows.ndim != 2 or rows.shape[1] != len(JOINTS):
        raise InputError(
            f"postures: got shape {rows.shape}, allowed: shape (n, 32) or (32,) rad, in the order"
            " of JOINTS"
        )
    rows.setflags(write=False)
    return rows


def _is_final(postures: ArrayLike) -> TypeGuard[NDArray[np.float64]]:
    """Return whether this is an array of numbers that owns its data and cannot be written to."""
    return (
        type(postures) is np.ndarray
        and postures.base is None
        and not postures.flags.writeable
        and postures.dtype == np.float64
        and postures.flags.c_contiguous
    )


def check_angles(angles: NDArray[np.float64], first_row: int) -> NDArray[np.bool_]:
    """Return which postures of a block have no NaN, shape (n,).

    Args:
        angles: shape (32, n), one row per joint [rad].
        first_row: number of the block's first posture, for the message.

    Raises:
        InputError: if an angle is beyond +-180 deg or infinite.
    """
    count = angles.shape[1]
    # Fast path for the usual case. A NaN fails both comparisons.
    if count == 0 or (angles.min() >= -np.pi and angles.max() <= np.pi):
        return np.ones(count, dtype=bool)
    beyond = np.abs(angles) > np.pi + TIE
    if beyond.any():
        row = int(np.argmax(beyond.any(axis=0)))
        joint = int(np.argmax(beyond[:, row]))
        raise InputError(
            f"postures: row {first_row + row}, {JOINTS[joint]}: got {angles[joint, row]:g} rad,"
            " allowed: -pi to pi (degrees given as radians?)"
        )
    return np.logical_not(np.isnan(angles).any(axis=0))
