"""Lean of a skeleton's trunk and neck, and the joint centres after it is removed.

The line from the middle of the hips to the base of the neck is vertical in few skeletons of an
upright person, because a skeleton's joints are not in line where the angles of the spine are zero.
The neck leans forward in everyone. Without a correction, an upright head would be scored as bent.

Zero of trunk and neck: where in a recording the person stands straight.

The zero is taken from the first of these that exists:

1. what the user states;
2. a T-pose at the start or the end, because people stand straight in it;
3. a second or more of walking with the hips above the feet, if the skeleton leans in it by more
   than walkers do;
4. the skeleton's rest pose, if its naming is known to rest upright;
5. that walk, whatever its lean;
6. a second of standing with hanging arms, if the trunk leans backward in it.

If there is none, the trunk is measured to the vertical and the neck to the trunk.

Joint centres cannot distinguish a skeleton that leans from a person who leans all the time. So a
lean is an interval, from the corrected to the uncorrected angle, unless a second of these confirms
one of its ends. Markers on the skin show where the spine is: a trunk of markers is never corrected
unless the user states when it is straight.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.joints import SIDES
from ergoqp.mocap.fitting.posture import every_centre, unit
from ergoqp.mocap.fitting.standins import either

_HEAD: Final = ("head", "head_top", "nose")
_LEGS: Final = ("pelvis", "hip", "knee", "ankle", "toe")


def leans(places: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return the forward lean of the trunk, and of the neck to the trunk, each (n,) [rad].

    NaN where the recording does not determine it.

    Args:
        places: centre -> positions (n, 3), any unit, x forward, y left, z up.
    """
    place = every_centre(places)
    left, trunk = _left(place), place["neck"] - _hips(place)
    level = left * [1.0, 1.0, 0.0]
    level /= np.maximum(np.linalg.norm(level, axis=1, keepdims=True), 1e-12)
    ahead = np.stack([level[:, 1], -level[:, 0], 0 * level[:, 0]], axis=1)
    lean = np.arctan2((ahead * trunk).sum(axis=1), trunk[:, 2])
    neck = places.get("head_top", place["head"]) - place["neck"]
    forward = np.cross(left, trunk)
    size = np.linalg.norm(forward, axis=1)
    along = (trunk * neck).sum(axis=1) * size / np.linalg.norm(trunk, axis=1).clip(1e-12)
    return lean, np.arctan2((forward * neck).sum(axis=1), along)


def straightened(
    places: Mapping[str, np.ndarray], trunk: float, neck: float
) -> dict[str, np.ndarray]:
    """Return the centres after the trunk and the neck have been turned back.

    The base of the neck is rotated back about the hips. Everything above the hips is shifted by the
    same vector, without a rotation. The head is rotated back about the base of the neck.

    Args:
        places: centre -> positions (n, 3) [m].
        trunk: angle by which the trunk is turned back [rad].
        neck: angle by which the neck is turned back [rad], relative to the original trunk.
    """
    shift = shift_of(places, trunk)
    if shift is None or trunk == neck == 0.0:
        return dict(places)
    left = _bridged(_left(every_centre(places)))
    found = {
        centre: path if centre.endswith(_LEGS) else (path + shift).astype(path.dtype)
        for centre, path in places.items()
    }
    for name in _HEAD:
        if name in found:
            # Turning the trunk back makes the neck lean more by that angle: it is removed, too.
            arm = _turned(found[name] - found["neck"], left, -trunk - neck)
            found[name] = (found["neck"] + arm).astype(found[name].dtype)
    return found


def shift_of(places: Mapping[str, np.ndarray], trunk: float) -> np.ndarray | None:
    """Return the shift of everything above the hips (n, 3) [m]; None if no trunk is seen.

    Args:
        places: centre -> positions (n, 3) [m].
        trunk: angle by which the trunk is turned back [rad].
    """
    place = every_centre(places)
    # The shift is interpolated where a hip is not seen for a moment.
    level = _bridged(_left(place)) * [1.0, 1.0, 0.0]
    level /= np.maximum(np.linalg.norm(level, axis=1, keepdims=True), 1e-12)
    arm = place["neck"] - _hips(place)
    shift = _bridged(_turned(arm, level, -trunk) - arm)
    return shift if np.isfinite(shift).any() else None


def _turned(vectors: np.ndarray, axis: np.ndarray, angle: float) -> np.ndarray:
    """Return vectors (n, 3) rotated about unit axes (n, 3); about the left axis this is forward."""
    along = (axis * vectors).sum(axis=1, keepdims=True) * axis
    across = np.cross(axis, vectors)
    return along + np.cos(angle) * (vectors - along) + np.sin(angle) * across


def _bridged(vectors: np.ndarray) -> np.ndarray:
    """Return vectors (n, 3), linearly interpolated where they are not seen."""
    seen = np.isfinite(vectors).all(axis=1)
    if seen.all() or not seen.any():
        return vectors
    at = np.arange(len(vectors))
    return np.stack([np.interp(at, at[seen], each[seen]) for each in vectors.T], axis=1)


def _hips(place: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the middle of the hips (n, 3); the pelvis where one of them is not seen."""
    hips = (place["right_hip"] + place["left_hip"]) / 2
    return np.where(np.isfinite(hips), hips, place["pelvis"])


def _left(place: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the unit vectors from right to left (n, 3), of the hips or else of the shoulders."""
    pairs = (unit(place[f"left_{pair}"] - place[f"right_{pair}"]) for pair in ("hip", "shoulder"))
    return either(*pairs)


def first_middle(places: Mapping[str, np.ndarray], *groups: tuple[str, ...]) -> np.ndarray | None:
    """Return the middle of the first group of centres that the recording has; None if of none."""
    group = next((each for each in groups if all(name in places for name in each)), None)
    return None if group is None else np.mean([places[name] for name in group], axis=0)


_LIKELY: Final = math.radians(35)
"""Largest lean of a person's skeleton that stands straight [rad]."""
_WALKER: Final = math.radians(8)
"""Largest lean of the trunk in a walk or stand that is not corrected: walkers lean so far [rad]."""
_LITTLE: Final = math.radians(5)
"""Largest lean of the trunk that is not corrected otherwise: the sheet calls it upright [rad]."""
_SURE: Final = math.radians(2)
"""Largest lean of the trunk in a walk that needs no confirmation [rad]."""
_UPRIGHT: Final = math.radians(3)
"""Largest lean of the trunk of a person who stands upright, by a skeleton that does not lean."""
_NODS: Final = (math.radians(-10), math.radians(35))
"""Lean of the neck to the trunk in skeletons of people who look ahead [rad]."""
_LONG: Final = 1.0
"""Shortest duration of a walk or a stand [s]."""
_STRIDE: Final = 0.5
"""Duration of a piece of the recording that is tested for walking [s]."""
_PASSED: Final = 0.25
"""Smallest distance by which one foot passes the other in such a piece of a walk [m]."""
_PIECES: Final = 5
"""Number of means that are compared in such a piece."""
_BEHIND: Final = -0.04
"""Hips further behind the feet than this, on average over a walk, belong to a stoop [m]."""
_STRAIGHT: Final = math.radians(30)
_POSED: Final = math.radians(20)
"""Largest angle between the arms of a T-pose and straight to the sides [rad]."""


@dataclass(frozen=True)
class Neutral:
    """Lean of the skeleton of a person who stands straight.

    Attributes:
        trunk: forward lean of the trunk [rad].
        neck: forward lean of the neck relative to the trunk [rad].
        sentence: sentence that states where the lean was taken from.
        trunk_ends: least and greatest lean that it may be instead [rad].
        neck_ends: the same of the neck.
    """

    trunk: float
    neck: float
    sentence: str
    trunk_ends: tuple[float, float]
    neck_ends: tuple[float, float]

    @property
    def nods(self) -> tuple[float, float]:
        """Lowest and highest change of the neck's flexion after its correction [rad]."""
        return self.neck - self.neck_ends[1], self.neck - self.neck_ends[0]

    @property
    def uncorrected(self) -> Neutral:
        """The same, with a trunk that is measured to the vertical."""
        said = (
            f"{self.sentence} The trunk is measured to the vertical all the same, because the arms"
            " would be beyond their ranges otherwise."
        )
        return replace(self, trunk=0.0, trunk_ends=(0.0, 0.0), sentence=said)


_T_POSE: Final = "in the T-pose"
_WALK: Final = "while the person walks"
_REST: Final = "in the skeleton's rest pose"
_STAND: Final = "while the person stands"


def neutral_of(
    places: Mapping[str, np.ndarray],
    rest: Mapping[str, np.ndarray],
    time: np.ndarray,
    skin: bool = False,
) -> Neutral:
    """Return the lean of a skeleton, by the rule of this module.

    Args:
        places: centre -> positions (n, 3) [m].
        rest: centre -> position (3,) in an upright rest pose; empty if there is none.
        time: times of the frames (n,) [s].
        skin: whether the centres are those of markers on the skin.
    """
    trunk, neck = leans(places)
    posed, walks = calibration_poses(places), _long(_walks(places, time), time)
    stands = _stand(stands_straight(places) & _arms_hang(places) & ~walks & ~posed, trunk, time)
    found: dict[str, tuple[float, float]] = {}
    for when, frames in ((_T_POSE, posed), (_WALK, walks), (_STAND, stands)):
        if (lean := _medians(trunk[frames], neck[frames])) is not None:
            found[when] = lean
    if rest and (lean := _medians(*leans({name: place[None] for name, place in rest.items()}))):
        found[_REST] = lean
    behind = _WALK in found and np.nanmean(_hips_ahead(places)[walks]) < _BEHIND
    walk, stand = (found.get(when, (0.0, 0.0))[0] for when in (_WALK, _STAND))
    likely = [
        (_T_POSE, _LITTLE),
        *([(_WALK, _WALKER)] if abs(walk) > _WALKER and not behind else []),
        (_REST, _LITTLE),
        *([(_WALK, _WALKER)] if not behind else []),
        *([(_STAND, _WALKER)] if stand < -_WALKER else []),
    ]
    for when, least in likely:
        if when in found:
            return _neutral(when, least, found, skin)
    sentence = "No upright moment is found: the trunk is measured to the vertical"
    nod = max(float(np.nanmedian(neck)), 0.0) if np.isfinite(neck).any() else 0.0
    if nod > math.radians(0.5):
        sentence += (
            f", and the neck to the trunk; as the neck leans forward by {math.degrees(nod):.0f} deg"
            " most of the time, its zero may be there, too"
        )
    return Neutral(0.0, 0.0, f"{sentence}.", _hull(0.0, 0.0 if skin else walk), (0.0, nod))


def _neutral(
    when: str, least: float, found: Mapping[str, tuple[float, float]], skin: bool
) -> Neutral:
    """Return the lean of a skeleton, and what it may be instead.

    Args:
        when: where the person is likely to be straight.
        least: largest lean of the trunk that is not corrected [rad].
        found: median lean of trunk and neck [rad] wherever the person may be straight.
        skin: whether the centres are those of markers on the skin.
    """
    (lean, nod), others = found[when], {name: each for name, each in found.items() if name != when}
    trunk = 0.0 if skin or abs(lean) <= least else lean
    said = _said(when, trunk, nod)
    usual = (nod, nod) if _NODS[0] <= nod <= _NODS[1] else _hull(0.0, nod)
    if skin or abs(lean) < (_SURE if when == _WALK else _LITTLE):
        return Neutral(trunk, nod, f"{said}.", (trunk, trunk), usual)
    for witness in (_REST, _STAND):
        if witness in others and abs(others[witness][0]) <= _LITTLE < abs(lean):
            # The skeleton does not lean, so the person does.
            nod = others[witness][1]
            said = (
                f"The trunk leans {_way(lean)} {when}, and not {witness}: there the person is taken"
                f" to be straight, with the neck {_way(nod)}"
            )
            return Neutral(0.0, nod, f"{said}.", (0.0, 0.0), (nod, nod))
    if when == _WALK and lean < 0:
        # Nobody walks bent backward by more than walkers lean.
        return Neutral(trunk, nod, f"{said}.", (trunk, trunk), usual)
    alike = [name for name, each in others.items() if abs(each[0] - lean) <= _LITTLE]
    # Who stoops stands as stooped as he walks.
    if (when == _REST and not others) or set(alike) - {_STAND}:
        return Neutral(trunk, nod, f"{said}.", (trunk, trunk), usual)
    if abs(lean) > _LITTLE:
        said += (
            ". Nothing confirms that: whether the skeleton leans or the person does looks the same,"
            " so the score is given for both"
        )
    # Who leans forward and looks ahead bends the neck backward by as much.
    ends = _hull(nod, nod + max(lean, 0.0))
    return Neutral(trunk, nod, f"{said}.", _hull(0.0, lean, *(e[0] for e in others.values())), ends)


def _hull(*values: float) -> tuple[float, float]:
    return min(values), max(values)


def _long(frames: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return some frames (n,) bool, or none of them if they are too short to tell a lean."""
    return frames if _duration(frames, time) >= _LONG else np.zeros_like(frames)


def _stand(stands: np.ndarray, trunk: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return the frames of standing (n,) bool that may tell a lean; often none.

    Who works stands bent as well. So only an upright part counts, if it is a second and a tenth of
    the standing, or all of a standing that leans backward, which nobody does at work.

    Args:
        stands: frames in which the person stands with hanging arms (n,) bool.
        trunk: forward lean of the trunk (n,) [rad].
        time: times of the frames (n,) [s].
    """
    stands = stands & np.isfinite(trunk)
    upright = stands & (np.abs(trunk) < _UPRIGHT)
    if upright.sum() >= 0.1 * stands.sum() and _duration(upright, time) >= _LONG:
        return upright
    back = stands.any() and np.nanmedian(trunk[stands]) < -_WALKER
    return _long(stands, time) if back else np.zeros_like(stands)


def _medians(trunk: np.ndarray, neck: np.ndarray) -> tuple[float, float] | None:
    """Return the median lean of trunk and neck [rad]; None if it is unknown or too large."""
    if not np.isfinite(trunk).any():
        return None
    lean = float(np.nanmedian(trunk))
    nod = float(np.nanmedian(neck)) if np.isfinite(neck).any() else -lean
    return None if abs(lean) > _LIKELY or abs(nod) > 2 * _LIKELY else (lean, nod)


def stated_neutral(places: Mapping[str, np.ndarray], frames: np.ndarray, when: str) -> Neutral:
    """Return the lean of a skeleton in frames in which the person stands straight.

    Args:
        places: centre -> positions (n, 3) [m].
        frames: those frames (n,) bool.
        when: their time in words, for messages: "at 2 s".

    Raises:
        RecordingError: if trunk or hips are not seen in any of them.
    """
    trunk, neck = leans(places)
    found = _medians(trunk[frames], neck[frames])
    if found is None:
        raise RecordingError(
            f"neutral: got a posture {when} in which the trunk is not seen or leans by more than"
            f" {math.degrees(_LIKELY):.0f} deg, allowed one that is upright"
        )
    lean, nod = found
    return Neutral(lean, nod, f"{_said(when, lean, nod)}.", (lean, lean), (nod, nod))


def calibration_poses(places: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the frames of a T-pose with which a recording begins or ends (n,) bool.

    A T-pose in the middle of a recording may be work and does not count.
    """
    posed = t_poses(places)
    other = np.flatnonzero(~posed)
    at = np.arange(len(posed))
    return posed if not len(other) else (at < other[0]) | (at > other[-1])


def t_poses(places: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the frames in which the person stands with both arms straight to the sides (n,) bool.

    A trunk that is bent by more than a skeleton leans is not a T-pose.
    """
    place = every_centre(places)
    found = stands_straight(places) & (np.abs(leans(places)[0]) < _LIKELY)
    for side, other in zip(SIDES, reversed(SIDES), strict=True):
        shoulder, elbow, wrist = (
            place[f"{side}_{name}"] for name in ("shoulder", "elbow", "wrist")
        )
        out = shoulder - place[f"{other}_shoulder"]
        for bone in (elbow - shoulder, wrist - elbow):
            found &= _cosine(bone, out) > math.cos(_POSED)
    return found


def _said(when: str, lean: float, nod: float) -> str:
    """Return in words where the person is straight, and by how much the skeleton leans there."""
    said = f"The person is taken to be straight {when}"
    if max(abs(lean), abs(nod)) > math.radians(0.5):
        said += f": the skeleton's trunk leans {_way(lean)} there, and its neck {_way(nod)}"
    return said


def _way(lean: float) -> str:
    """Return a lean in words; as 0 deg, it is forward."""
    degrees = round(math.degrees(lean))
    return f"{'backward' if degrees < 0 else 'forward'} by {abs(degrees)} deg"


def stands_straight(places: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the frames in which no known knee is bent much (n,) bool; none without a leg."""
    stands = [
        _cosine(places[knee] - places[hip], places[ankle] - places[knee]) > math.cos(_STRAIGHT)
        for hip, knee, ankle in (
            [f"{s}_{name}" for name in ("hip", "knee", "ankle")] for s in SIDES
        )
        if hip in places and knee in places and ankle in places
    ]
    none = np.zeros(len(next(iter(places.values()))), dtype=bool)
    return np.logical_and.reduce(stands) if stands else none


def _arms_hang(places: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the frames in which no upper arm is raised by more than 45 degrees (n,) bool."""
    place = every_centre(places)
    arms = [place[f"{side}_elbow"] - place[f"{side}_shoulder"] for side in SIDES]
    down = np.broadcast_to([0.0, 0.0, -1.0], arms[0].shape)
    raised = [_cosine(arm, down) < math.cos(math.radians(45)) for arm in arms]
    return ~np.logical_or.reduce(raised)


def _walks(places: Mapping[str, np.ndarray], time: np.ndarray) -> np.ndarray:
    """Return the frames in which the person walks, also on a treadmill (n,) bool.

    That is where one foot passes the other.
    """
    walks, place = np.zeros(len(time), dtype=bool), every_centre(places)
    passed = _ahead_of_hips(place, place["right_ankle"] - place["left_ankle"])
    block = np.floor((time - time[0]) / _STRIDE).astype(int)
    starts = np.flatnonzero(np.diff(block, prepend=-1))
    for first, last in zip(starts, [*starts[1:], len(time)], strict=True):
        rows = first + np.flatnonzero(np.isfinite(passed[first:last]))
        if len(rows) < _PIECES:
            continue
        # Means over some frames are compared, so that jumping points do not count as a walk.
        means = [passed[each].mean() for each in np.array_split(rows, _PIECES)]
        walks[rows] = max(means) - min(means) > _PASSED
    return walks


def _hips_ahead(place: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the distance of the hips ahead of the feet (n,) [m]."""
    hips, feet = ((place[f"right_{name}"] + place[f"left_{name}"]) / 2 for name in ("hip", "ankle"))
    return _ahead_of_hips(place, hips - feet)


def _ahead_of_hips(place: Mapping[str, np.ndarray], vectors: np.ndarray) -> np.ndarray:
    """Return the horizontal component of vectors (n, 3) along the forward axis of the hips."""
    left = (place["left_hip"] - place["right_hip"])[:, :2]
    ahead = vectors[:, 0] * left[:, 1] - vectors[:, 1] * left[:, 0]
    return ahead / np.maximum(np.linalg.norm(left, axis=1), 1e-9)


def _duration(frames: np.ndarray, time: np.ndarray) -> float:
    """Return the total duration of some frames (n,) bool [s]."""
    return float(frames.sum() * np.median(np.diff(time))) if len(time) > 1 else 0.0


def _cosine(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    size = np.linalg.norm(one, axis=1) * np.linalg.norm(other, axis=1)
    return (one * other).sum(axis=1) / np.where(size > 0, size, np.nan)
