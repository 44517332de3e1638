"""Frames of a recording that are not scored, and the causes.

A frame is not scored if the recording does not show a posture in it: a bone that the body cannot
follow within its joints' ranges, a bone that is suddenly longer or shorter, a body that is far from
the recording, or a joint that is lost. Such frames are counted, with their causes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from ergoqp.joints import INDEX, SIDES, spoken
from ergoqp.recordings.fitting.leaps import (
    BRIDGED,
    angle_between,
    between_leaps,
    closed,
    gaps,
    leaps,
)

_OFF: Final = np.radians(10.0)
"""Largest angle between a bone of the body and the recorded one [rad]: half a band of the sheet."""
_RIGID: Final = 0.001
"""Variation of a rigid skeleton's bones is below this share of their length."""
_LEAST: Final = 0.02
"""Share by which such a bone may be longer or shorter; with a sideways error it is 12 degrees."""
_USUALLY: Final = 6.0
"""Factor on its usual variation by which another bone may be longer or shorter."""
_MOST: Final = 0.3
"""Largest share by which any bone may be longer or shorter."""
_POOR: Final = 0.10
"""Largest distance between body and recording, RMS over the centres [m]."""
_ASTRAY: Final = 0.20
"""Largest distance of one joint centre of the body from the recorded one [m]."""
_MEANWHILE: Final = np.radians(12.0)
"""Largest turn of a segment during a gap that is interpolated [rad]."""

_DIRECTIONS: Final = (
    ("trunk", "hips", "neck"),
    ("neck", "neck", "skull"),
    *((f"{side} upper arm", f"{side}_shoulder", f"{side}_elbow") for side in SIDES),
)
"""Bones whose direction is scored."""
_BENDS: Final = tuple(
    (f"{side} {joint}", *(f"{side}_{centre}" for centre in (start, joint, end)))
    for side in SIDES
    for start, joint, end in (("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle"))
)
"""Joints whose angle between two bones is scored."""
_CENTRES: Final = (
    "neck",
    *(f"{side}_{name}" for side in SIDES for name in ("shoulder", "elbow", "wrist", "hip", "knee")),
)
"""Centres on which a scored angle depends."""
NEEDED: Final = (
    ("trunk", "trunk_flexion", "trunk_side_bend"),
    ("neck", "neck_flexion", "neck_side_bend"),
    *(
        (f"{side} {part}", *(f"{side}_{joint}" for joint in joints))
        for side in SIDES
        for part, *joints in (
            ("upper arm", "shoulder_flexion", "shoulder_abduction"),
            ("forearm", "elbow_flexion"),
            ("knee", "knee_flexion"),
        )
    ),
)
"""Segments that a score needs if the recording ever determines them, and their joints.

The first joint tells whether the segment is determined.
"""


@dataclass(frozen=True)
class Usual:
    """Usual length of a bone.

    Attributes:
        length: median of its length [m].
        leeway: how much longer or shorter it may be [m].
    """

    length: float
    leeway: float


def usual_lengths(places: Mapping[str, np.ndarray]) -> dict[str, Usual]:
    """Return the usual lengths of the bones that determine the score, if they are seen.

    A bone of a skeleton is rigid, and one between measured points varies. The leeway is therefore a
    multiple of the bone's usual variation.

    Args:
        places: centre -> positions (n, 3) [m], NaN where not seen.
    """
    places, found = _with_middles(places), {}
    for name, start, end, least in _bones():
        if start in places and end in places:
            length = np.linalg.norm(places[end] - places[start], axis=1)
            if np.isfinite(length).any():
                middle = float(np.nanmedian(length))
                varies = 1.4826 * float(np.nanmedian(np.abs(length - middle))) / max(middle, 1e-9)
                share = _LEAST if varies < _RIGID else min(max(_USUALLY * varies, least), _MOST)
                found[name] = Usual(middle, share * middle)
    return found


def not_followed(
    places: Mapping[str, np.ndarray],
    fitted: Mapping[str, np.ndarray],
    error: np.ndarray,
    usual: Mapping[str, Usual],
    time: np.ndarray,
) -> dict[str, np.ndarray]:
    """Return the frames in which the body does not follow the recording: cause -> (n,) bool.

    Args:
        places: centre -> positions of the recording (n, 3) [m], NaN where not seen.
        fitted: centre -> positions of the body (n, 3) [m].
        error: RMS distance of the centres (n,) [m].
        usual: lengths of the bones, see `usual_lengths`.
        time: times of the frames (n,) [s].
    """
    causes = {}
    places, fitted = _with_middles(places), _with_middles(fitted)
    for name, *ends in _DIRECTIONS:
        if name in usual:
            bone, own = (_bone(each, *ends) for each in (places, fitted))
            causes[f"{name} beyond its range"] = angle_between(bone, own) > _OFF
    for name, *ends in _BENDS:
        if all(end in places for end in ends):
            bones, own = (
                [_bone(each, *ends[:2]), _bone(each, *ends[1:])] for each in (places, fitted)
            )
            causes[f"{name} beyond its range"] = (
                np.abs(angle_between(*bones) - angle_between(*own)) > _OFF
            )
    bones = {name: _bone(places, *ends) for name, *ends, _ in _bones() if name in usual}
    leaping = leaps(bones, time)
    for name, bone in bones.items():
        off = np.abs(np.linalg.norm(bone, axis=1) - usual[name].length)
        # Between two wrong frames, a frame in which the length happens to be right is wrong, too.
        stretched = closed(off > usual[name].leeway, time)
        causes[f"{name} of unusual length"] = stretched
        causes[f"{name} jumps"] = between_leaps(leaping[name], stretched, time) & ~stretched
    causes[f"body off by more than {_POOR:g} m"] = error > _POOR
    for centre in _CENTRES:
        if centre in places:
            apart = np.linalg.norm(places[centre] - fitted[centre], axis=1)
            causes[f"{spoken(centre)} off by more than {_ASTRAY:g} m"] = apart > _ASTRAY
    return causes


def not_seen(observed: np.ndarray, postures: np.ndarray, time: np.ndarray) -> dict[str, np.ndarray]:
    """Return the frames in which a segment that a score needs is not seen: cause -> (n,) bool.

    Args:
        observed: which joint angles are determined (n, 32) bool.
        postures: joint angles (n, 32) [rad].
        time: times of the frames (n,) [s].
    """
    causes = {}
    for name, *joints in NEEDED:
        told, angles = observed[:, INDEX[joints[0]]], postures[:, [INDEX[each] for each in joints]]
        if told.any():
            causes[f"{name} not seen"] = _lost(told, angles, time)
    for name, joints in (
        ("trunk", ("trunk_flexion",)),
        ("arms", tuple(f"{side}_shoulder_flexion" for side in SIDES)),
    ):
        if not observed[:, [INDEX[joint] for joint in joints]].any():
            causes[f"{name} not seen"] = np.ones(len(time), dtype=bool)
    return causes


def _bones() -> Iterator[tuple[str, str, str, float]]:
    """Yield name and ends of each bone, and its least leeway as a share if it is not rigid.

    The leeway of the trunk is larger because a bent trunk is shorter, and that of the shoulders
    because a raised shoulder is nearer to the neck.
    """
    yield "trunk", "hips", "neck", _MOST
    yield "neck", "neck", "skull", _MOST
    yield "pelvis", "right_hip", "left_hip", 0.1
    yield "shoulder girdle", "right_shoulder", "left_shoulder", 0.15
    for side in SIDES:
        yield f"{side} shoulder", "neck", f"{side}_shoulder", 0.2
        yield f"{side} upper arm", f"{side}_shoulder", f"{side}_elbow", 0.1
        yield f"{side} forearm", f"{side}_elbow", f"{side}_wrist", 0.06
        yield f"{side} thigh", f"{side}_hip", f"{side}_knee", 0.06
        yield f"{side} shank", f"{side}_knee", f"{side}_ankle", 0.06


def _lost(told: np.ndarray, angles: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return the frames of gaps that are not interpolated, or are at an end (n,) bool."""
    between, before, after = gaps(told)
    long = time[after] - time[before] > BRIDGED
    turned = (np.abs(angles[after] - angles[before]) > _MEANWHILE).any(axis=1)
    return ~told & ~(between & ~long & ~turned)


def _with_middles(places: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the positions with the middle of the hips and the upper end of the head's bone."""
    found = dict(places)
    if "right_hip" in places and "left_hip" in places:
        found["hips"] = (places["right_hip"] + places["left_hip"]) / 2
    if "head" in places or "head_top" in places:
        found["skull"] = places.get("head_top", places.get("head", np.empty(0)))
    return found


def _bone(places: Mapping[str, np.ndarray], start: str, end: str) -> np.ndarray:
    return places[end] - places[start]
