"""Zero of trunk and neck: where in a recording the person stands straight.

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
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.joints import SIDES
from ergoqp.recordings.fitting.leaning import leans

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
    count = len(next(iter(places.values())))
    found = stands_straight(places) & (np.abs(leans(places)[0]) < _LIKELY)
    for side in SIDES:
        ends = [places.get(f"{side}_{centre}") for centre in ("shoulder", "elbow", "wrist")]
        other = places.get(f"{'left' if side == 'right' else 'right'}_shoulder")
        if other is None or any(end is None for end in ends):
            return np.zeros(count, dtype=bool)
        shoulder, elbow, wrist = (end for end in ends if end is not None)
        out = shoulder - other
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
    stands: np.ndarray | None = None
    for side in SIDES:
        hip, knee, ankle = (places.get(f"{side}_{name}") for name in ("hip", "knee", "ankle"))
        if hip is not None and knee is not None and ankle is not None:
            straight = _cosine(knee - hip, ankle - knee) > math.cos(_STRAIGHT)
            stands = straight if stands is None else stands & straight
    return np.zeros(len(next(iter(places.values()))), dtype=bool) if stands is None else stands


def _arms_hang(places: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the frames in which no upper arm is raised by more than 45 degrees (n,) bool."""
    hang = np.ones(len(next(iter(places.values()))), dtype=bool)
    for side in SIDES:
        shoulder, elbow = places.get(f"{side}_shoulder"), places.get(f"{side}_elbow")
        if shoulder is not None and elbow is not None:
            down = np.broadcast_to([0.0, 0.0, -1.0], shoulder.shape)
            hang &= ~(_cosine(elbow - shoulder, down) < math.cos(math.radians(45)))
    return hang


def _walks(places: Mapping[str, np.ndarray], time: np.ndarray) -> np.ndarray:
    """Return the frames in which the person walks, also on a treadmill (n,) bool.

    That is where one foot passes the other.
    """
    walks = np.zeros(len(time), dtype=bool)
    if any(f"{side}_{name}" not in places for side in SIDES for name in ("hip", "ankle")):
        return walks
    left = (places["left_hip"] - places["right_hip"])[:, :2]
    apart = (places["right_ankle"] - places["left_ankle"])[:, :2]
    passed = (apart[:, 0] * left[:, 1] - apart[:, 1] * left[:, 0]) / np.maximum(
        np.linalg.norm(left, axis=1), 1e-9
    )
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


def _hips_ahead(places: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the distance of the hips ahead of the feet (n,) [m]; zero if either is missing."""
    names = [f"{side}_{name}" for name in ("hip", "ankle") for side in SIDES]
    if any(name not in places for name in names):
        return np.zeros(len(next(iter(places.values()))))
    hips, feet = (
        (places[f"right_{name}"] + places[f"left_{name}"]) / 2 for name in ("hip", "ankle")
    )
    left = (places["left_hip"] - places["right_hip"])[:, :2]
    ahead = (hips - feet)[:, 0] * left[:, 1] - (hips - feet)[:, 1] * left[:, 0]
    return ahead / np.maximum(np.linalg.norm(left, axis=1), 1e-9)


def _duration(frames: np.ndarray, time: np.ndarray) -> float:
    """Return the total duration of some frames (n,) bool [s]."""
    return float(frames.sum() * np.median(np.diff(time))) if len(time) > 1 else 0.0


def _cosine(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    size = np.linalg.norm(one, axis=1) * np.linalg.norm(other, axis=1)
    return (one * other).sum(axis=1) / np.where(size > 0, size, np.nan)
