"""A loop as it was watched: postures and poses over time, from a run, its folder or a log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from ergoqp.errors import InputError
from ergoqp.identification.resting import Resting, RestWatch
from ergoqp.joints import JOINTS
from ergoqp.problem.way import pose_error

_BACK: Final = 0.5
"""An object is at rest that is where it was so long ago [s],"""
_STAYS: Final = (2e-3, float(np.radians(0.5)))
"""to this [m], [rad]: more than a pose's noise, less than any motion that somebody follows."""


@dataclass(frozen=True, eq=False)
class Watched:
    """Postures and poses over time.

    Attributes:
        time: of each sample (n,) [s], increasing.
        postures: (n, 32) [rad], NaN where a joint was not seen.
        poses: of the object (n, 4, 4) [m].
    """

    time: np.ndarray
    postures: np.ndarray
    poses: np.ndarray


def watched(given: Any) -> Watched | None:
    """Return the loop in what a user gives, None if it is none.

    Args:
        given: an `ergoqp.Run`, the folder of one, or the entries that a stepper's log got.

    Raises:
        InputError: if it is one of these, and cannot be read.
    """
    if isinstance(given, (str, Path)):
        return _of_folder(Path(given))
    if all(hasattr(given, name) for name in ("time", "postures", "poses")):
        return Watched(given.time, given.postures, given.poses)
    if isinstance(given, Sequence) and given and isinstance(given[0], Mapping):
        return _of_log(given)
    return None


def rests_in(loop: Watched) -> list[Resting]:
    """Return the last rest of every stay of the object.

    Raises:
        InputError: if there is none.
    """
    watch, found, stays = RestWatch(), [], False
    back, periods = 0, np.diff(loop.time, prepend=loop.time[:1])
    for now, (time, pose) in enumerate(zip(loop.time, loop.poses, strict=True)):
        while time - loop.time[back] > _BACK:
            back += 1
        moved = pose_error(loop.poses[back], pose)
        still = bool(
            time - loop.time[0] >= _BACK
            and np.linalg.norm(moved[:3]) < _STAYS[0]
            and np.linalg.norm(moved[3:]) < _STAYS[1]
        )
        rest = watch.add(float(time), float(periods[now]), still, loop.postures[now], pose)
        if rest is not None:
            # One stay is one rest, however long: the last, to which the person has come.
            found = [*(found[:-1] if stays else found), rest]
            stays = True
        stays = stays and still
    if not found:
        raise InputError(
            "rests: got a loop in which the object never rested long enough for the person to,"
            " allowed one with a stay of two seconds or more"
        )
    return found


def _of_folder(folder: Path) -> Watched:
    path = folder / "run.npz"
    try:
        with np.load(path, allow_pickle=False) as held:
            return Watched(held["time"], held["postures"], held["poses"])
    except (OSError, KeyError, ValueError) as error:
        raise InputError(
            f"rests: got the folder {folder}, allowed one that a run was saved in ({error})"
        ) from None


def _of_log(log: Sequence[Mapping[str, Any]]) -> Watched:
    times, postures, poses, now = [], [], [], 0.0
    for number, entry in enumerate(log):
        where = f"rests: entry {number} of the log"
        try:
            told, fresh = bool(entry["has_pose"][0]), bool(entry["frame"][0])
            seen = np.asarray(entry["observed"], dtype=bool)
            posture = np.asarray(entry["posture"], dtype=float)
            pose, period = np.reshape(entry["pose"], (4, 4), order="F"), float(entry["dt"][0])
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise InputError(
                f"{where} is not one of a stepper's ({error}), allowed the dicts that its log got"
            ) from None
        if not told:
            raise InputError(
                f"{where} has no pose, allowed the log of a loop that was given the object's pose"
            )
        new = fresh and float(entry["age"][0]) == 0.0
        postures.append(np.where(seen & new, posture, np.full(len(JOINTS), np.nan)))
        poses.append(pose)
        times.append(now)
        now += period
    return Watched(np.array(times), np.array(postures), np.array(poses))
