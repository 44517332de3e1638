"""Gaps and jumps: frames between those that are known, or between those that are wrong.

The accelerations of people are bounded. A bone that turns and turns back faster than a person can
has moved in the recording only.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

BRIDGED: Final = 0.2
"""Longest gap of a lost joint that is interpolated [s]."""
_LEAP: Final = 300.0
"""Change of a bone's angular velocity above which it jumps [rad/s^2]; hammering reaches 130."""
_MOVED: Final = 0.03
"""Smallest relative movement of a jumping bone's ends [m], because noise turns short bones."""
_TURNED: Final = np.radians(10.0)
"""Smallest angle of a jump [rad]."""
_AT_ONCE: Final = 5
"""If more bones than this jump at once, it is a cut or a keyframe, not an error."""


def leaps(bones: Mapping[str, np.ndarray], time: np.ndarray) -> dict[str, np.ndarray]:
    """Return the steps between frames in which bones jump: bone -> (n - 1,) bool.

    Args:
        bones: bone -> vector from one end to the other (n, 3) [m], NaN where not seen.
        time: times of the frames (n,) [s], increasing.
    """
    if not bones:
        return {}
    # Repeated frames are skipped: a slower sensor is recorded several times.
    new = moments(bones)
    found, since = {}, np.diff(time[new])
    for name, bone in bones.items():
        turn = angle_between(bone[new][:-1], bone[new][1:])
        speed = np.pad(turn / since, 1, constant_values=np.nan)
        faster = speed[1:-1] - np.fmax(speed[:-2], speed[2:])
        moved = np.linalg.norm(np.diff(bone[new], axis=0), axis=1)
        steps = np.zeros(len(time) - 1, dtype=bool)
        leaping = (faster > _LEAP * since) & (turn > _TURNED) & (moved > _MOVED)
        steps[np.flatnonzero(new)[1:][leaping] - 1] = True
        found[name] = steps
    cuts = np.sum(list(found.values()), axis=0) > _AT_ONCE
    return {name: steps & ~cuts for name, steps in found.items()}


def moments(paths: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the frames that do not repeat the frame before (n,) bool.

    Args:
        paths: name -> positions (n, 3), NaN where not seen.
    """
    new = np.zeros(len(next(iter(paths.values()))), dtype=bool)
    new[:1] = True
    for path in paths.values():
        one, other = path[:-1], path[1:]
        same = (one == other) | (np.isnan(one) & np.isnan(other))
        new[1:] |= ~same.all(axis=1)
    return new


def between_leaps(leaping: np.ndarray, wrong: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return the frames between two jumps, or between a jump and a wrong frame (n,) bool.

    A single jump does not count: it does not show on which side the recording is wrong.

    Args:
        leaping: steps between frames in which a bone jumps (n - 1,) bool.
        wrong: wrong frames (n,) bool.
        time: times of the frames (n,) [s], increasing.
    """
    # Frames and the steps between them alternate.
    marks, at = np.zeros(2 * len(time) - 1, dtype=bool), np.empty(2 * len(time) - 1)
    marks[::2], at[::2] = wrong, time
    marks[1::2], at[1::2] = leaping, (time[:-1] + time[1:]) / 2
    return closed(marks, at)[::2]


def closed(frames: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return some frames, and all between two of them that are less than `BRIDGED` apart."""
    if not frames.any():
        return frames
    between, before, after = gaps(frames)
    return frames | (between & (time[after] - time[before] < BRIDGED))


def gaps(frames: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the frames between some given ones (n,) bool, and the last given before and after."""
    known = np.flatnonzero(frames)
    at = np.searchsorted(known, np.arange(len(frames)))
    between = (at > 0) & (at < len(known))
    before, after = known[np.maximum(at - 1, 0)], known[np.minimum(at, len(known) - 1)]
    return between, before, after


def angle_between(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the angle between vectors (n,) [rad]; NaN where one is not seen."""
    across = np.linalg.norm(np.cross(one, other), axis=1)
    return np.arctan2(across, (one * other).sum(axis=1))
