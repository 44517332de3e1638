"""Recorded loops: posture and pose over time, rests of the person, and their delay."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from ergoqp.arguments import as_tuple, read_array, shown
from ergoqp.errors import InputError, ModelError
from ergoqp.expressions import read_pose
from ergoqp.files.read import read_npz
from ergoqp.joints import JOINTS
from ergoqp.problem.geometry import pose_error
from ergoqp.problem.settings import Frames

WINDOW: Final = 1.0
"""Time over which postures are averaged [s]."""

LONGEST: Final = 5.0
"""An object at rest for this long is judged, even if the person is not steady [s]."""

STEADY: Final = float(np.radians(1.0))
"""Largest RMS difference of the means of two consecutive windows at rest [rad]."""


@dataclass(frozen=True)
class Resting:
    """A measured rest.

    Attributes:
        time: time of the loop at the end of the rest [s].
        pose: pose of the object (4, 4) [m].
        posture: mean posture of the last second, over the frames in which a joint was seen (32,)
            [rad]; NaN if it was never seen.

    Example:
        >>> import numpy as np
        >>> from ergoqp.identification.loops import Resting
        >>> rest = Resting(time=4.2, pose=np.eye(4), posture=np.zeros(32))
        >>> rest.posture.shape
        (32,)
    """

    time: float
    pose: np.ndarray
    posture: np.ndarray


class RestWatch:
    """Collects postures while the object is at rest, and detects when the person rests too."""

    def __init__(self) -> None:
        """Start with an object that moves."""
        self.begin()

    def begin(self) -> None:
        """Delete what was collected, because the object moves."""
        self._still, self._windows = 0.0, []
        self._sum, self._count, self._in_window = np.zeros(1), np.zeros(1), 0.0

    def add(
        self, now: float, dt: float, still: bool, posture: np.ndarray, pose: np.ndarray
    ) -> Resting | None:
        """Add a period; return the rest as soon as it is detected.

        Args:
            now: time of the loop [s].
            dt: period [s].
            still: whether the object is at rest in this period.
            posture: measured posture (32,) [rad], NaN for joints that are not seen or not new.
            pose: pose of the object (4, 4) [m].
        """
        if not still:
            if self._still:
                self.begin()
            return None
        seen = np.isfinite(posture)
        self._sum = self._sum + np.where(seen, posture, 0.0)
        self._count = self._count + seen
        self._still += dt
        self._in_window += dt
        if self._in_window < WINDOW - dt / 2:
            return None
        mean = np.full(posture.shape, np.nan)
        np.divide(self._sum, self._count, out=mean, where=self._count > 0)
        self._windows.append(mean)
        self._sum, self._count, self._in_window = np.zeros(1), np.zeros(1), 0.0
        if not (self._steady() or self._still >= LONGEST - dt / 2):
            return None
        self.begin()
        return Resting(now, pose.copy(), mean)

    def _steady(self) -> bool:
        if len(self._windows) < 2:
            return False
        apart = self._windows[-1] - self._windows[-2]
        both = np.isfinite(apart)
        return bool(both.any() and np.sqrt(np.mean(apart[both] ** 2)) < STEADY)


def rests_of(given: Any) -> list[Resting]:
    """Return the rests in what a user gives.

    Args:
        given: `Resting`s, or pairs of a posture (32,) [rad] and a pose (4, 4) [m].

    Raises:
        InputError: if there is none, or one cannot be read.
    """
    found = []
    for number, each in enumerate(as_tuple("rests", given)):
        if isinstance(each, Resting):
            found.append(each)
            continue
        where = f"rests[{number}]"
        try:
            posture, pose = each
        except (TypeError, ValueError):
            raise InputError(f"{where}: got {shown(each)}, allowed a posture and a pose") from None
        angles = _angles(f"{where}: posture", posture)
        found.append(Resting(0.0, read_pose(f"{where}: pose", pose), angles))
    if not found:
        raise InputError("rests: got none, allowed at least one")
    return found


def _angles(what: str, value: Any) -> np.ndarray:
    """Return angles (32,) [rad], NaN for joints that were not seen."""
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError):
        array = np.zeros(0)
    allowed = f"{len(JOINTS)} angles [rad], NaN for what is not seen"
    if array.shape != (len(JOINTS),):
        raise InputError(f"{what}: got {shown(value)}, allowed {allowed}")
    return read_array(what, np.where(np.isnan(array), 0.0, array), array.shape, allowed) + array * 0


_BACK: Final = 0.5
"""Time after which an object at rest is still at the same place [s]."""
_STAYS: Final = (2e-3, float(np.radians(0.5)))
"""Limits of the same place [m], [rad]: above the noise of a pose, below a motion to follow."""
_LONGEST: Final = 10.0
"""Longest period [s]."""
_DAY: Final = 86400.0
"""Longest loop [s]."""


@dataclass(frozen=True, eq=False)
class LoopLog:
    """Postures and poses over time.

    Attributes:
        time: time of each sample (n,) [s], increasing.
        postures: postures (n, 32) [rad], NaN where a joint was not seen.
        poses: poses of the object (n, 4, 4) [m].
    """

    time: np.ndarray
    postures: np.ndarray
    poses: np.ndarray


def watched(given: Any, frames: Frames | None = None) -> LoopLog | None:
    """Return the loop in what a user gives, None if it is not a loop.

    Args:
        given: an `ergoqp.simulation.run.Run`, the folder of one, or the entries of a stepper's log.
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
        return LoopLog(loop.time, loop.postures, frames.base @ loop.poses @ frames.flange)
    return None


def rests_in(loop: LoopLog) -> list[Resting]:
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


def _of_folder(folder: Path) -> LoopLog:
    names = ("time", "postures", "poses")
    try:
        arrays = read_npz(folder / "run.npz", names)
    except ModelError as error:
        raise InputError(
            f"rests: got the folder {folder}, allowed one that a run was saved in ({error})"
        ) from None
    return _checked(f"the folder {folder}", *(arrays[name] for name in names))


def _of_log(log: Sequence[Mapping[str, Any]]) -> LoopLog:
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


def _checked(what: str, time: Any, postures: Any, poses: Any) -> LoopLog:
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
    return LoopLog(time, postures, poses)


def _is_rigid(pose: np.ndarray) -> bool:
    """Return whether a pose is rigid, by a quick test: reading every pose would take long."""
    turn = pose[:3, :3]
    return bool(
        np.abs(turn.T @ turn - np.eye(3)).max() < 1e-6
        and np.abs(pose[3] - (0, 0, 0, 1)).max() < 1e-6
        and np.abs(pose[:3, 3]).max() < 50
        and np.linalg.det(turn) > 0
    )


_PERIOD: Final = 0.01
"""Period of the compared samples, and step between the tried delays [s]."""
_LONGEST_DELAY: Final = 0.6
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


def delay_of(loop: LoopLog) -> float | None:
    """Return the delay with which a person follows the object [s], None if it does not show.

    It is the delay for which the shifted motion of the object explains the motion of the joints
    best. How the joints follow the object is unknown and changes with the posture. So it is fitted
    by least squares for every piece of two seconds. The noise of each joint follows from the
    residuals. The result is the sum of the person's delay and the lag of the hand.
    """
    grid = np.arange(loop.time[0], loop.time[-1], _PERIOD)
    back, over = round(_LONGEST_DELAY / _PERIOD), round(_OVER / _PERIOD)
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
