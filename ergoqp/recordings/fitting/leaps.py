"""Gaps and leaps: what is between moments that are known, or that are wrong.

Accelerations of people stay bounded: a bone that turns within a frame as no body can, and back, was
somewhere else only in the recording.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

BRIDGED: Final = 0.2
"""For how long a joint may be lost: what is between is taken for it [s]."""
_LEAP: Final = 300.0
"""A bone leaps whose turning changes by more within a frame [rad/s^2]; hammering, by 130."""
_MOVED: Final = 0.03
"""And of which one end moves by more to the other [m]: short ones turn by noise."""
_TURNED: Final = np.radians(10.0)
"""A leap is a turn by more [rad]."""
_AT_ONCE: Final = 5
"""Where more bones leap at once it is a cut or a keyframe, and no point that was lost."""


def leaps(bones: Mapping[str, np.ndarray], time: np.ndarray) -> dict[str, np.ndarray]:
    """Return the steps between frames in which bones leap: bone -> (n - 1,) bool.

    Args:
        bones: from one end to the other (n, 3) [m], NaN where not seen.
        time: when (n,) [s], increasing.
    """
    if not bones:
        return {}
    # A frame that is the one before once more is no moment of its own: slower sensors are written
    # down several times.
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
    """Return which frames are not the one before once more (n,) bool.

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
    """Return the frames between leaps, or between one and what is wrong (n,) bool.

    Nothing tells on which side of a single leap the recording is wrong, if it is.

    Args:
        leaping: steps between frames (n - 1,) bool.
        wrong: frames (n,) bool.
        time: when (n,) [s], increasing.
    """
    # Frames and the steps between them, in turn.
    marks, at = np.zeros(2 * len(time) - 1, dtype=bool), np.empty(2 * len(time) - 1)
    marks[::2], at[::2] = wrong, time
    marks[1::2], at[1::2] = leaping, (time[:-1] + time[1:]) / 2
    return closed(marks, at)[::2]


def closed(frames: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return the frames, and those between two of them that are less than `BRIDGED` apart."""
    if not frames.any():
        return frames
    between, before, after = gaps(frames)
    return frames | (between & (time[after] - time[before] < BRIDGED))


def gaps(frames: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return which frames are between some (n,) bool, and the last before and next after them."""
    known = np.flatnonzero(frames)
    at = np.searchsorted(known, np.arange(len(frames)))
    between = (at > 0) & (at < len(known))
    before, after = known[np.maximum(at - 1, 0)], known[np.minimum(at, len(known) - 1)]
    return between, before, after


def angle_between(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the angle between vectors (n,) [rad]; NaN where one is not seen."""
    across = np.linalg.norm(np.cross(one, other), axis=1)
    return np.arctan2(across, (one * other).sum(axis=1))
