"""Which of two triples of angles a shoulder has: both turn the arm alike.

Flexion f, abduction a and rotation r place an arm exactly as f + 180, 180 - a and r + 180 degrees
do. They meet where the arm points straight to the side. A movement keeps to one of them, and over
a whole recording the ones are taken that change least from frame to frame (Viterbi's algorithm).
"""

from __future__ import annotations

from typing import Final

import numpy as np

_TOLERANCE: Final = np.radians(20.0)
"""What people can do beyond the ranges [rad]."""
_IMPLAUSIBLE: Final = 10.0
"""How dear an angle beyond that is, in a second [1/s]."""
_LEAST: Final = 0.1
"""A leap of the flexion counts at least so much, even where the flexion does not show."""
_OVER: Final = 0.6
"""How dear it is to begin with an abduction above 90 degrees [rad]."""
_GAP: Final = 0.5
"""After so long a recording begins anew [s]."""


def both_ways(
    angles: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return both triples of angles (n, 3) [rad], each angle as near to its range as turns can.

    Args:
        angles: flexion, abduction within 90 degrees of zero, and rotation (n, 3) [rad].
        lower: of the ranges (3,) [rad].
        upper: of the ranges (3,) [rad].
    """
    other = np.pi + angles * np.array([1.0, -1.0, 1.0])
    return near(angles, lower, upper), near(other, lower, upper)


def near(angles: np.ndarray, lower: np.ndarray | float, upper: np.ndarray | float) -> np.ndarray:
    """Return angles turned by whole turns to where they are nearest to a range [rad]."""
    middle = (lower + upper) / 2
    return middle + (angles - middle + np.pi) % (2 * np.pi) - np.pi


def chosen(
    pair: tuple[np.ndarray, np.ndarray],
    shows: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    time: np.ndarray,
    begin: bool | None = None,
) -> np.ndarray:
    """Return for each frame which of two triples of angles is taken (n,) bool: the second.

    Args:
        pair: the triples (n, 3) [rad], see `both_ways`; NaN where the arm is not seen.
        shows: how much flexion, abduction and rotation show (n, 3), 0 to 1.
        lower: of the ranges (3,) [rad].
        upper: of the ranges (3,) [rad].
        time: when (n,) [s].
        begin: whether the second is taken at first; None: that is not known.
    """
    seen = np.flatnonzero(np.isfinite(pair[0][:, :2]).all(axis=1))
    if not len(seen):
        return np.zeros(len(time), dtype=bool)
    both = np.stack([np.nan_to_num(each[seen]) for each in pair])
    told, at = shows[seen], time[seen]
    beyond = np.maximum(lower - both, both - upper).clip(0)
    since = np.diff(at, prepend=-np.inf)[:, None]
    here = _IMPLAUSIBLE * np.minimum(since, 0.1) * (beyond - _TOLERANCE).clip(0) * told
    # Who comes from nowhere is thought to be within the ranges, and to lift the arm forward.
    anew = beyond * told + np.array([[[0.0]], [[_OVER]]]) / 3
    cost = (here + np.where(since > _GAP, anew, 0.0)).sum(axis=2)
    if begin is not None:
        cost[0 if begin else 1, 0] = np.inf
    weight = np.minimum(told[1:], told[:-1])
    weight[:, 0] = np.maximum(weight[:, 0], _LEAST)
    way = np.empty((2, 2, len(at) - 1))
    for before in (0, 1):
        for after in (0, 1):
            way[before, after] = (weight * np.abs(both[after, 1:] - both[before, :-1])).sum(axis=1)
    way[:, :, since[1:, 0] > _GAP] = 0.0
    # While an arm is not seen it keeps to the way before.
    before = np.searchsorted(seen, np.arange(len(time)), side="right") - 1
    return _least(cost, way)[np.maximum(before, 0)]


def _least(here: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Return the cheapest sequence of two states (k,) bool, of being there and of the ways."""
    first, second = here[:, 0].tolist()
    came = []
    for (cost, beyond), (stay, leave, back, keep) in zip(
        here.T[1:].tolist(), way.reshape(4, -1).T.tolist(), strict=True
    ):
        origin = (first + stay > second + back, first + leave > second + keep)
        came.append(origin)
        first, second = (
            cost + min(first + stay, second + back),
            beyond + min(first + leave, second + keep),
        )
    state = second < first
    states = [state]
    for origin in reversed(came):
        state = origin[state]
        states.append(state)
    return np.array(states[::-1])
