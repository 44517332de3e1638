"""Joint angles that a sheet scores: arrays that are checked, and their lower and upper ends."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ergoqp.arguments import unmasked
from ergoqp.errors import InputError
from ergoqp.joints import JOINTS, LOWER, UPPER
from ergoqp.sheets.description import TIE

_DECIMALS: Final = 4
"""Decimals [deg] to which 32-bit numbers are read; they may be off by 0.00002 deg."""

_SAME: Final = 2e-6
"""An end that is nearer to the posture is the posture: one may be a 32-bit number [rad]."""


def read_postures(postures: ArrayLike, name: str = "postures") -> NDArray[np.float64]:
    """Return postures as a read-only array of shape (n, 32) [rad] that no other code can write to.

    32-bit numbers are rounded to the nearest 0.0001 deg, so that 60 deg are 60 deg. What is masked
    is NaN.

    An array that already is read-only and owns its data is not copied: an hour of postures is
    110 MB.

    Args:
        postures: shape (n, 32) or (32,).
        name: what messages call them.

    Raises:
        InputError: if they are not numbers of that shape.
    """
    try:
        rows = postures if _is_final(postures) else np.array(unmasked(postures), float, order="C")
        if rows is not postures and np.asarray(postures).dtype == np.float32:
            rows = np.radians(np.round(np.degrees(rows), _DECIMALS))
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{name}: got no array of numbers ({error}), allowed: shape (n, 32) or (32,) rad"
        ) from None
    if rows.shape == (len(JOINTS),):
        rows = rows[np.newaxis]
    if rows.ndim != 2 or rows.shape[1] != len(JOINTS):
        raise InputError(
            f"{name}: got shape {rows.shape}, allowed: shape (n, 32) or (32,) rad, in the order"
            " of JOINTS"
        )
    rows.setflags(write=False)
    return rows


Ends = Callable[[slice], NDArray[np.float64]]
"""Lower and upper ends of the joint angles of some rows (2, rows, 32) [rad], made when asked for:
those of an hour are 220 MB."""


def read_ends(postures: NDArray[np.float64], low: ArrayLike | None, high: ArrayLike | None) -> Ends:
    """Return the lower and upper ends of joint angles (n, 32) [rad].

    An end within 2e-6 rad of the posture is the posture.

    Args:
        postures: from `read_postures`.
        low: shape (n, 32) or (32,) [rad]; NaN: the angle is unknown. None: the postures.
        high: the same.

    Raises:
        InputError: if they are not such numbers.
    """
    given = {}
    for name, end in (("low", low), ("high", high)):
        given[name] = postures if end is None else read_postures(end, name)
        if given[name].shape != postures.shape:
            raise InputError(
                f"{name}: got shape {given[name].shape}, allowed: that of postures,"
                f" {postures.shape}"
            )

    def ends(rows: slice) -> NDArray[np.float64]:
        likeliest = postures[rows]
        below, above = (
            np.where(np.abs(end[rows] - likeliest) <= _SAME, likeliest, end[rows])
            for end in given.values()
        )
        # A known angle may be beyond the range of its joint.
        return np.stack(
            [
                np.where(np.isnan(below), np.fmin(LOWER, likeliest), below),
                np.where(np.isnan(above), np.fmax(UPPER, likeliest), above),
            ]
        )

    return ends


def check_ends(postures: NDArray[np.float64], ends: NDArray[np.float64], first_row: int) -> None:
    """Check that postures are between their ends.

    Args:
        postures: a block of postures (n, 32) [rad].
        ends: lower and upper ends of its angles (2, n, 32) [rad].
        first_row: number of the block's first posture, for the message.

    Raises:
        InputError: if a posture is not, or its ends are exchanged.
    """
    low, high = ends
    wrong = (low > high + TIE) | (postures < low - TIE) | (postures > high + TIE)
    if wrong.any():
        row, joint = (int(each[0]) for each in np.nonzero(wrong))
        got = ", ".join(f"{each[row, joint]:.7g}" for each in (low, postures, high))
        raise InputError(
            f"low, high: row {first_row + row}, {JOINTS[joint]}: got low, posture and high of"
            f" {got} rad, allowed: ascending"
        )


def _is_final(postures: ArrayLike) -> TypeGuard[NDArray[np.float64]]:
    """Return whether this is an array of numbers that owns its data and cannot be written to."""
    return (
        type(postures) is np.ndarray
        and postures.base is None
        and not postures.flags.writeable
        and postures.dtype == np.float64
        and postures.flags.c_contiguous
    )


def check_angles(
    angles: NDArray[np.float64], first_row: int, name: str = "postures"
) -> NDArray[np.bool_]:
    """Return which postures of a block have no NaN, shape (n,).

    Args:
        angles: shape (32, n), one row per joint [rad].
        first_row: number of the block's first posture, for the message.
        name: what the message calls them.

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
            f"{name}: row {first_row + row}, {JOINTS[joint]}: got {angles[joint, row]:g} rad,"
            " allowed: -pi to pi (degrees given as radians?)"
        )
    return np.logical_not(np.isnan(angles).any(axis=0))
