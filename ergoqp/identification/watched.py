"""A recorded loop: postures and poses over time, from a run, its folder or a log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from ergoqp.arguments import shown
from ergoqp.errors import InputError, ModelError
from ergoqp.expressions.rigid import read_pose
from ergoqp.files.npz import read_npz
from ergoqp.identification.resting import Resting, RestWatch
from ergoqp.joints import JOINTS
from ergoqp.problem.frames import Frames
from ergoqp.problem.way import pose_error

_BACK: Final = 0.5
"""Time after which an object at rest is still at the same place [s]."""
_STAYS: Final = (2e-3, float(np.radians(0.5)))
"""Limits of the same place [m], [rad]: above the noise of a pose, below a motion to follow."""
_LONGEST: Final = 10.0
"""Longest period [s]."""
_DAY: Final = 86400.0
"""Longest loop [s]."""


@dataclass(frozen=True, eq=False)
class Watched:
    """Postures and poses over time.

    Attributes:
        time: time of each sample (n,) [s], increasing.
        postures: postures (n, 32) [rad], NaN where a joint was not seen.
        poses: poses of the object (n, 4, 4) [m].
    """

    time: np.ndarray
    postures: np.ndarray
    poses: np.ndarray


def watched(given: Any, frames: Frames | None = None) -> Watched | None:
    """Return the loop in what a user gives, None if it is not a loop.

    Args:
        given: an `ergoqp.Run`, the folder of one, or the entries of a stepper's log.
        frames: what the poses of a log are reported in. None: as they are.

    Raises:
        InputError: if it is one of these, and cannot be read.
    """
    if isinstance(given, (str, Path)):
        return _of_folder(Path(given))
    if all(hasattr(given, name) for name in ("time", "postures", "poses")):
        return _checked("the run", given.time, given.postures, given.poses)
    if isinstance(given, Sequence) and given and isinstance(given[0], Mapping):
        loop = _of_log(given)
        if frames is None or not frames.moved:
            return loop
        return Watched(loop.time, loop.postures, frames.base @ loop.poses @ frames.flange)
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
            # A stay counts as one rest: the last one, at which the person has arrived.
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
    names = ("time", "postures", "poses")
    try:
        arrays = read_npz(folder / "run.npz", names)
    except ModelError as error:
        raise InputError(
            f"rests: got the folder {folder}, allowed one that a run was saved in ({error})"
        ) from None
    return _checked(f"the folder {folder}", *(arrays[name] for name in names))


def _of_log(log: Sequence[Mapping[str, Any]]) -> Watched:
    times, postures, poses, now = [], [], [], 0.0
    for number, entry in enumerate(log):
        where = f"entry {number} of the log"
        try:
            told, new, asked, period = (
                float(np.ravel(entry[name])[0]) for name in ("has_pose", "frame", "ask", "dt")
            )
            new = new > 0 and float(np.ravel(entry["age"])[0]) == 0.0
            seen = np.asarray(entry["observed"], dtype=float) > 0.5
            posture = np.where(seen & new, np.asarray(entry["posture"], dtype=float), np.nan)
            pose = np.reshape(entry["pose"], (4, 4), order="F")
        except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
            raise InputError(
                f"rests: {where} is not one of a stepper's ({type(error).__name__}: {error}),"
                " allowed the dicts that its log got"
            ) from None
        if posture.shape != (len(JOINTS),):
            raise InputError(f"rests: {where} has no {len(JOINTS)} angles, allowed a person's log")
        if not 0.0 < period <= _LONGEST:
            # The step rejected it too: its length is unknown.
            continue
        if not asked:
            if not told:
                raise InputError(
                    f"rests: {where} has no pose, allowed the log of a loop that was given the"
                    " object's pose"
                )
            postures.append(posture)
            poses.append(pose)
            times.append(now)
        now += period
    return _checked("the log", np.array(times), np.array(postures), np.array(poses))


def _checked(what: str, time: Any, postures: Any, poses: Any) -> Watched:
    """Return a loop whose arrays are valid."""
    found = []
    shapes = ("time", time, ()), ("postures", postures, (len(JOINTS),)), ("poses", poses, (4, 4))
    for name, value, shape in shapes:
        try:
            array = np.asarray(value)
            array = array.astype(float) if array.dtype.kind in "fiu" else np.zeros(0)
        except (TypeError, ValueError):
            array = np.zeros(0)
        if array.ndim != 1 + len(shape) or array.shape[1:] != shape or not len(array):
            allowed = f"numbers of shape ({', '.join(map(str, ('n', *shape)))})"
            raise InputError(f"rests: {what} has {shown(value)} as {name}, allowed {allowed}")
        found.append(array)
    time, postures, poses = found
    if not len(time) == len(postures) == len(poses):
        raise InputError(f"rests: {what} has arrays of different lengths, allowed the same one")
    whole = np.isfinite(time).all() and np.diff(time, prepend=-np.inf).min() > 0
    if not whole or time[-1] - time[0] > _DAY:
        raise InputError(f"rests: {what} has times that do not grow, allowed at most a day of them")
    if np.nanmax(np.abs(postures), initial=0.0) > 2 * np.pi:
        raise InputError(f"rests: {what} has angles beyond a turn, allowed radians, NaN if unseen")
    for number in range(len(poses)):
        if not _is_rigid(poses[number]):
            read_pose(f"rests: {what}, pose {number}", poses[number])
    return Watched(time, postures, poses)


def _is_rigid(pose: np.ndarray) -> bool:
    """Return whether a pose is rigid, by a quick test: reading every pose would take long."""
    turn = pose[:3, :3]
    return bool(
        np.abs(turn.T @ turn - np.eye(3)).max() < 1e-6
        and np.abs(pose[3] - (0, 0, 0, 1)).max() < 1e-6
        and np.abs(pose[:3, 3]).max() < 50
        and np.linalg.det(turn) > 0
    )
