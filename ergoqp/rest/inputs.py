"""Checks of the inputs of a simulated loop."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ergoqp.arguments import shown, table_of_numbers, unmasked
from ergoqp.errors import InputError
from ergoqp.joints import JOINTS, LOWER, UPPER, spoken

_OTHERWISE_DEG = 2.0  # a larger difference of the start from the given posture is reported
_AT_END = np.radians(0.01)  # a start this far beyond a joint's range counts as rounding


def read_posture(posture: ArrayLike) -> tuple[np.ndarray, list[str]]:
    """Return a posture (32,) [rad] within the joints' ranges, and a sentence if it was not.

    Raises:
        InputError: if it is not a posture.
    """
    try:
        angles = table_of_numbers("posture", posture)
    except InputError:
        raise InputError(
            f"posture: got {type(posture).__name__}, allowed {len(JOINTS)} angles in radians"
        ) from None
    if angles.shape != (len(JOINTS),):
        raise InputError(
            f"posture: got shape {angles.shape}, allowed ({len(JOINTS)},), in the order of"
            " ergoqp.JOINTS"
        )
    wrong = np.flatnonzero(~(np.abs(angles) <= np.pi))
    if wrong.size:
        raise InputError(
            f"posture: got {angles[wrong[0]]:g} for {JOINTS[wrong[0]]}, allowed radians within ±π"
            " (degrees given as radians?)"
        )
    inside = np.clip(angles, LOWER, UPPER)
    beyond = [spoken(JOINTS[i]) for i in np.flatnonzero(np.abs(angles - inside) > _AT_END)]
    if not beyond:
        return inside, []
    return inside, [
        f"The start is beyond the range of {', '.join(beyond)}; the person starts at its end."
    ]


def stood_otherwise(given: np.ndarray, start: np.ndarray) -> list[str]:
    """Return a sentence if a person does not start in the given posture (32,) [rad]."""
    apart = np.degrees(np.abs(start - given))
    joint = int(np.argmax(apart))
    if apart[joint] <= _OTHERWISE_DEG:
        return []
    return [
        "Before the run begins the person stands with flat soles, or sits with feet that reach the"
        " floor, and holds the object still: the start differs from the posture that was given, by"
        f" up to {apart[joint]:.0f} deg ({spoken(JOINTS[joint])})."
    ]


def read_observed(observed: ArrayLike | None) -> np.ndarray | None:
    """Return which joints are seen (32,), None: all.

    Raises:
        InputError: if it is neither None nor bool of that shape.
    """
    if observed is None:
        return None
    try:
        seen = unmasked(observed)
        if seen.shape == (len(JOINTS),) and seen.dtype == bool:
            return seen
    except Exception:  # not an array
        pass
    raise InputError(f"observed: got {shown(observed)}, allowed bool of shape ({len(JOINTS)},)")
