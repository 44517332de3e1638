"""Unit, axes and lean of a skeleton, and the moment in which the person stands straight.

Lean of a skeleton's trunk and neck, and the joint centres after it is removed.

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

Joint centres cannot distinguish a skeleton that leans from a person who leans all the time. Walkers
are assumed to be upright, and nobody is assumed to stand bent backward. Somebody who pushes a cart
all day with the hips above the feet is read as upright; `neutral` has to be stated then. A sentence
reports every correction.

Conversion of the file's unit and axes to metres with x forward, y left, z up. What the file does
not state is found from the body.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from ergoqp.errors import RecordingError
from ergoqp.joints import SIDES
from ergoqp.mocap.fitting.posture import either, every_centre, unit

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
    """

    trunk: float
    neck: float
    sentence: str


def neutral_of(
    places: Mapping[str, np.ndarray], rest: Mapping[str, np.ndarray], time: np.ndarray
) -> Neutral:
    """Return the lean of a skeleton, by the rule of this module.

    Args:
        places: centre -> positions (n, 3) [m].
        rest: centre -> position (3,) in an upright rest pose; empty if there is none.
        time: times of the frames (n,) [s].
    """
    trunk, neck = leans(places)
    posed = calibration_poses(places)
    if found := _straight(trunk[posed], neck[posed], _LITTLE, "in the T-pose"):
        return found
    walks, walking = _walks(places, time), None
    if _duration(walks, time) >= _LONG and np.nanmean(_hips_ahead(places)[walks]) >= _BEHIND:
        walking = _straight(trunk[walks], neck[walks], _WALKER, "while the person walks")
    if walking and walking.trunk:
        return walking
    resting = {centre: place[None] for centre, place in rest.items()}
    if resting and (found := _straight(*leans(resting), _LITTLE, "in the skeleton's rest pose")):
        return found
    if walking:
        return walking
    stands = stands_straight(places) & _arms_hang(places)
    if _duration(stands, time) >= _LONG:
        found = _straight(trunk[stands], -trunk[stands], _WALKER, "while the person stands")
        if found and found.trunk < 0:
            return found
    sentence = "No upright moment is found: the trunk is measured to the vertical."
    return Neutral(0.0, 0.0, sentence)


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
    found = _straight(trunk[frames], neck[frames], 0.0, when)
    if found is None:
        raise RecordingError(
            f"neutral: got a posture {when} in which the trunk is not seen or leans by more than"
            f" {math.degrees(_LIKELY):.0f} deg, allowed one that is upright"
        )
    return found


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


def _straight(trunk: np.ndarray, neck: np.ndarray, least: float, when: str) -> Neutral | None:
    """Return the median of these leans as a `Neutral`; None if it is unknown or too large."""
    if not np.isfinite(trunk).any():
        return None
    lean = float(np.nanmedian(trunk))
    nod = float(np.nanmedian(neck)) if np.isfinite(neck).any() else -lean
    if abs(lean) > _LIKELY or abs(nod) > 2 * _LIKELY:
        return None
    if abs(lean) <= least:
        # The trunk is not corrected then; the neck is, relative to that trunk.
        lean = 0.0
    said = f"The person is taken to be straight {when}"
    if max(abs(lean), abs(nod)) > math.radians(0.5):
        said += f": the skeleton's trunk leans {_way(lean)} there, and its neck {_way(nod)}"
    return Neutral(lean, nod, f"{said}.")


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


UNITS: Final[dict[str, float]] = {
    "m": 1.0,
    "cm": 0.01,
    "mm": 0.001,
    "inch": 0.0254,
    "0.056444 m": 0.056444,
}
"""Units of length that recordings use [m]; the last one is that of the CMU database."""

LIKELY_STATURE: Final = (1.4, 2.1)
"""Range of an adult's stature, by which the unit is found [m]."""

UPS: Final = ("x", "y", "z", "-x", "-y", "-z")
"""Vertical axes that a file may have."""

_HIPS: Final = ("right_hip", "left_hip")
_SHOULDERS: Final = ("right_shoulder", "left_shoulder")
_UPPER = (("head",), ("neck",), _SHOULDERS)
_MIDDLE = (_HIPS, ("pelvis",))
_LOWER = (("right_ankle", "left_ankle"), ("right_knee", "left_knee"), *_MIDDLE)
# Smallest mean component along the vertical axis of the unit vectors from the feet to the head and
# to the hips; a single vector with this component is 53 degrees from the axis.
_CLEARLY_UP = 0.6
_IN_LINE: Final = np.cos(np.radians(10))
"""Smallest cosine between trunk and legs of a person who stands upright."""
_TILTED: Final = np.radians(12)
"""Smallest lean of people who stand upright that is taken for a tilt of the camera [rad]."""
_FEW: Final = 5
"""Fewer frames of standing upright than this do not count."""


def find_unit(stature: float, where: str) -> float:
    """Return the size of the only unit that gives the stature of an adult [m].

    Args:
        stature: stature estimated from the bones [file unit].
        where: the file's name, for messages.

    Returns:
        The size of the unit [m].

    Raises:
        RecordingError: if no unit fits, or more than one.
    """
    low, high = LIKELY_STATURE
    fitting = {name: size for name, size in UNITS.items() if low <= stature * size <= high}
    if len(fitting) != 1:
        which = f"none of {', '.join(UNITS)} gives"
        if fitting:
            which = f"several units ({', '.join(fitting)}) give"
        raise RecordingError(
            f"{where}: the unit of length is unknown: the bones correspond to a stature of"
            f" {stature:.4g} file units, and {which} {low} to {high} m; state the unit (unit_to_m)"
        )
    return next(iter(fitting.values()))


def find_up(centres: Mapping[str, np.ndarray]) -> str | None:
    """Return the file's vertical axis, one of `UPS`.

    It is the one along which head and hips are above the feet. The head alone would fail for a
    person who stoops all the time, and the hips alone for a person who squats.

    Args:
        centres: centre -> positions (n, 3) in the file's axes.

    Returns:
        The axis, or None if none clearly points from the feet to the head.
    """
    feet = _middle(centres, _LOWER)
    rise = np.concatenate([_middle(centres, _UPPER) - feet, _middle(centres, _MIDDLE) - feet])
    length = np.linalg.norm(rise, axis=1, keepdims=True)
    direction = rise / np.where(length > 0, length, np.nan)
    # Without legs the hips stand for the feet, and the vector to the hips has no direction.
    seen = np.isfinite(direction).all(axis=1)
    mean = direction[seen].mean(axis=0) if seen.any() else np.zeros(3)
    axis = int(np.argmax(np.abs(mean)))
    if abs(mean[axis]) < _CLEARLY_UP:
        return None
    return ("" if mean[axis] > 0 else "-") + "xyz"[axis]


def axes_of(up: str) -> np.ndarray:
    """Return the rotation (3, 3) from the file's axes to ours.

    In a file with y up, x is left and z is forward for a person who faces along z. A cyclic
    permutation therefore turns its axes into ours. The heading on the floor stays the file's own.

    Args:
        up: the file's vertical axis, one of `UPS`.
    """
    place = "xyz".index(up[-1])
    turn = np.roll(np.eye(3), 2 - place, axis=0)
    # Half a turn about the forward axis exchanges up and down.
    return turn if up == up[-1] else np.diag([1.0, -1.0, -1.0]) @ turn


def leg_of(places: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Return the mean vector from ankle to hip of the legs (n, 3); None without a leg."""
    legs = [
        places[f"{side}_hip"] - places[f"{side}_ankle"]
        for side in SIDES
        if f"{side}_hip" in places and f"{side}_ankle" in places
    ]
    return np.mean(legs, axis=0) if legs else None


def upright_line(places: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Return the direction (3,) of bodies that stand upright, with legs and trunk in line.

    One leg is enough, and the shoulders may replace the neck. None if nobody stands upright, or if
    too little is seen.

    Args:
        places: centre -> positions (n, 3), any unit, along our axes.
    """
    leg = leg_of(places)
    top = first_middle(places, ("neck",), _SHOULDERS)
    hips = first_middle(places, ("pelvis",), _HIPS)
    if leg is None or top is None or hips is None:
        return None
    trunk = top - hips
    size = np.linalg.norm(leg, axis=1) * np.linalg.norm(trunk, axis=1)
    line = (leg * trunk).sum(axis=1) > _IN_LINE * size
    upright = line & stands_straight(places)
    if upright.sum() < _FEW:
        return None
    body = np.median((leg + trunk)[upright], axis=0)
    return body / np.linalg.norm(body)


def tilt_of(line: np.ndarray) -> np.ndarray | None:
    """Return the rotation (3, 3) that makes a direction (3,) vertical; None if it almost is."""
    if np.arccos(np.clip(line[2], -1, 1)) < _TILTED:
        return None
    across = np.cross(line, [0.0, 0.0, 1.0])
    angle = np.arctan2(np.linalg.norm(across), line[2])
    return Rotation.from_rotvec(angle * across / np.linalg.norm(across)).as_matrix()


def _middle(centres: Mapping[str, np.ndarray], choices: tuple[tuple[str, ...], ...]) -> np.ndarray:
    """Return the middle of the first group of which at least one centre exists."""
    # There is such a group: recordings without pelvis or upper trunk have been refused before.
    group = next(group for group in choices if any(name in centres for name in group))
    return np.mean([centres[name] for name in group if name in centres], axis=0)
