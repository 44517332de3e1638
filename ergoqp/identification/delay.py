"""The delay with which a person follows the object."""

from __future__ import annotations

from typing import Final

import numpy as np

from ergoqp.identification.watched import Watched
from ergoqp.problem.way import pose_error

_PERIOD: Final = 0.01
"""Period of the compared samples, and step between the tried delays [s]."""
_LONGEST: Final = 0.6
"""Longest delay that is tried [s]."""
_OVER: Final = 0.3
"""Duration of the compared motions [s]. Over a longer time, noise counts less."""
_SMOOTH: Final = 0.1
"""Length of the moving average over them [s]."""
_PIECE: Final = 2.0
"""Time for which a person follows in the same way [s]."""
_TURN: Final = 0.3
"""A turn of one radian counts as a motion of this length [m]."""
_MOVES: Final = 0.01
"""Motions of the object below this in `_OVER` give no information [m]."""
_RIDGE: Final = 1e-6
"""Directions in which the object hardly moves give no information [m^2]."""
_EXACT: Final = 1e-9
"""Smallest unexplained motion of a joint [rad^2 per piece]."""
_TELLS: Final = 8.0
"""A delay counts only if its log likelihood exceeds the mean over all delays by this much."""
_LEFT: Final = 0.7
"""It counts only if at most this share of the joints' motion is unexplained."""


def delay_of(loop: Watched) -> float | None:
    """Return the delay with which a person follows the object [s], None if it does not show.

    It is the delay for which the shifted motion of the object explains the motion of the joints
    best. How the joints follow the object is unknown and changes with the posture. So it is fitted
    by least squares for every piece of two seconds. The noise of each joint follows from the
    residuals. The result is the sum of the person's delay and the lag of the hand.
    """
    grid = np.arange(loop.time[0], loop.time[-1], _PERIOD)
    back, over = round(_LONGEST / _PERIOD), round(_OVER / _PERIOD)
    length = round(_PIECE / _PERIOD)
    joints = _smooth(_on(grid, loop.time, loop.postures))
    ways = _smooth(_on(grid, loop.time, _ways(loop.poses)))
    if len(grid) <= over + back + length or not joints.shape[1]:
        return None
    moves, goes = (each[over:] - each[:-over] for each in (joints, ways))
    fast = np.linalg.norm(goes, axis=1) > _MOVES
    pieces = [
        begin
        for begin in range(back, len(moves) - length + 1, length)
        if fast[begin - back : begin + length].mean() > 0.3
    ]
    whole, left = np.zeros(moves.shape[1]), np.full((back + 1, moves.shape[1]), _EXACT)
    for begin in pieces:
        part = moves[begin : begin + length]
        whole += np.sum(part**2, axis=0)
        for late in range(back + 1):
            way = goes[begin - late : begin - late + length]
            square = way.T @ way + length * _RIDGE * np.eye(6)
            rest = part - way @ np.linalg.solve(square, way.T @ part)
            left[late] += np.sum(rest**2, axis=0)
    unlikely = len(pieces) * np.log(left).sum(axis=1)
    at = int(np.argmin(unlikely))
    shows = unlikely.mean() - unlikely[at] > _TELLS and left[at].sum() < _LEFT * whole.sum()
    if not shows or at == back:
        return None
    if at == 0:
        return 0.0
    before, least, after = unlikely[at - 1 : at + 2]
    return _PERIOD * (at + 0.5 * (before - after) / (before - 2 * least + after))


def _ways(poses: np.ndarray) -> np.ndarray:
    """Return the displacement of the object (n, 6) [m] from its pose in the middle of the time."""
    ways = np.array([pose_error(poses[len(poses) // 2], pose) for pose in poses])
    ways[:, 3:] *= _TURN
    return ways


def _on(grid: np.ndarray, time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return values at other times, without the columns that were hardly ever seen."""
    seen = np.isfinite(values)
    columns = [
        np.interp(grid, time[known], column[known])
        for column, known in zip(values.T, seen.T, strict=True)
        if known.mean() > 0.5
    ]
    return np.stack(columns, axis=1) if columns else np.zeros((len(grid), 0))


def _smooth(values: np.ndarray) -> np.ndarray:
    width = round(_SMOOTH / _PERIOD)
    kernel = np.ones(width) / width
    kept = [np.convolve(column, kernel, "valid") for column in values.T]
    return np.stack(kept, axis=1) if kept else values
