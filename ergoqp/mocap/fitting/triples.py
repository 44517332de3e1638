"""Choice between the two triples of shoulder angles that give the same arm.

Flexion f, abduction a and rotation r give the same arm as f + 180, 180 - a and r + 180 degrees. The
two triples meet where the arm points straight to the side. A movement keeps to one of them. Over
the whole recording the sequence with the least change from frame to frame is chosen (Viterbi's
algorithm).
"""

from __future__ import annotations

from typing import Final

import numpy as np

_TOLERANCE: Final = np.radians(20.0)
"""Excess over the ranges that is free of cost, because people can reach it [rad]."""
_IMPLAUSIBLE: Final = 10.0
"""Cost of an angle beyond that, per second [1/s]."""
_LEAST: Final = 0.1
"""Smallest weight of a change of the flexion, even where the flexion is not determined."""
_HANGS: Final = np.radians(60.0)
"""Elevation of an arm below which it is never read by an abduction above 90 degrees [rad]."""
_NEVER: Final = 1e6
"""Cost of what cannot be."""
_OVER: Final = 0.6
"""Cost of a start with an abduction above 90 degrees [rad]."""
_GAP: Final = 0.5
"""Duration of a gap after which the sequence begins anew [s]."""


def both_ways(
    angles: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return both triples of angles (n, 3) [rad], shifted by whole turns towards their ranges.

    Args:
        angles: flexion, abduction within 90 degrees of zero, and rotation (n, 3) [rad].
        lower: lower ends of the ranges (3,) [rad].
        upper: upper ends of the ranges (3,) [rad].
    """
    other = np.pi + angles * np.array([1.0, -1.0, 1.0])
    return near(angles, lower, upper), near(other, lower, upper)


def near(angles: np.ndarray, lower: np.ndarray | float, upper: np.ndarray | float) -> np.ndarray:
    """Return angles, shifted by whole turns to be nearest to the middle of a range [rad]."""
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
    """Return the frames in which the second of two triples of angles is chosen (n,) bool.

    Args:
        pair: the triples (n, 3) [rad], see `both_ways`; NaN where the arm is not seen.
        shows: how well flexion, abduction and rotation are determined (n, 3), 0 to 1.
        lower: lower ends of the ranges (3,) [rad].
        upper: upper ends of the ranges (3,) [rad].
        time: times of the frames (n,) [s].
        begin: whether the second triple is chosen at first; None: unknown.
    """
    seen = np.flatnonzero(np.isfinite(pair[0][:, :2]).all(axis=1))
    if not len(seen):
        return np.zeros(len(time), dtype=bool)
    both = np.stack([np.nan_to_num(each[seen]) for each in pair])
    told, at = shows[seen], time[seen]
    beyond = np.maximum(lower - both, both - upper).clip(0)
    since = np.diff(at, prepend=-np.inf)[:, None]
    here = _IMPLAUSIBLE * np.minimum(since, 0.1) * (beyond - _TOLERANCE).clip(0) * told
    # After a gap, angles within the ranges and an arm that is lifted forward are preferred.
    anew = beyond * told + np.array([[[0.0]], [[_OVER]]]) / 3
    cost = (here + np.where(since > _GAP, anew, 0.0)).sum(axis=2)
    if begin is not None:
        cost[0 if begin else 1, 0] += _NEVER
    # The second triple raises an arm over its side: it says nothing of one that hangs.
    height = np.cos(both[0, :, 0]) * np.cos(both[0, :, 1])
    cost[1] += np.where(height > np.cos(_HANGS), 2 * _NEVER, 0.0)
    weight = np.minimum(told[1:], told[:-1])
    weight[:, 0] = np.maximum(weight[:, 0], _LEAST)
    # From each triple of a frame to each of the next one.
    way = (weight * np.abs(both[:, 1:] - both[:, None, :-1])).sum(axis=3)
    way[:, :, since[1:, 0] > _GAP] = 0.0
    # While an arm is not seen, it keeps the triple of the last frame in which it was seen.
    before = np.searchsorted(seen, np.arange(len(time)), side="right") - 1
    return _least(cost, way)[np.maximum(before, 0)]


def _least(here: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Return the sequence of two states with the least cost (k,) bool.

    Args:
        here: cost of each state in each frame (2, k).
        way: cost of each change, from state to state (2, 2, k - 1).
    """
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
