"""Which frames of a recording are not to be scored, and why.

A posture that the recording does not show is no posture: a bone that the body cannot follow within
its joints' ranges, a bone that is suddenly longer, a body that is nowhere near, a joint that was
lost. Such frames are not scored, counted, and named.
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
"""By how much a bone of the body may point elsewhere [rad]: half a band of the sheet."""
_RIGID: Final = 0.001
"""A skeleton's bones vary by less than this share of their length."""
_LEAST: Final = 0.02
"""By what share those may be longer or shorter: aside, that is 12 degrees."""
_USUALLY: Final = 6.0
"""By how many times their usual deviation others may be."""
_MOST: Final = 0.3
"""By what share no bone may be."""
_POOR: Final = 0.10
"""How far the body may be from the recording, RMS over the centres [m]."""
_ASTRAY: Final = 0.20
"""How far one joint centre of the body may be [m]."""
_MEANWHILE: Final = np.radians(12.0)
"""By how much it may turn meanwhile [rad]."""

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
"""Joints of which the angle between two bones is scored."""
_CENTRES: Final = (
    "neck",
    *(f"{side}_{name}" for side in SIDES for name in ("shoulder", "elbow", "wrist", "hip", "knee")),
)
"""Centres that nothing scored can be without."""
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
"""What a score stands on, if the recording tells it at all, and the joints; told is the first."""


@dataclass(frozen=True)
class Usual:
    """How long a bone usually is.

    Attributes:
        length: its median [m].
        leeway: by how much it may be longer or shorter [m].
    """

    length: float
    leeway: float


def usual_lengths(places: Mapping[str, np.ndarray]) -> dict[str, Usual]:
    """Return how long the bones are that tell of what is scored; only those that are seen.

    A bone of a skeleton is rigid, one between measured points varies. So a bone may vary as many
    times more than it usually does as makes it another posture.

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
    """Return where the body does not follow the recording: cause -> those frames (n,) bool.

    Args:
        places: centre -> positions of the recording (n, 3) [m], NaN where not seen.
        fitted: the same of the body.
        error: RMS distance of the centres (n,) [m].
        usual: lengths of the bones, see `usual_lengths`.
        time: when (n,) [s].
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
        # Where it passes through its length on a way that is wrong before and after, too.
        stretched = closed(off > usual[name].leeway, time)
        causes[f"{name} of another length"] = stretched
        causes[f"{name} leaps"] = between_leaps(leaping[name], stretched, time) & ~stretched
    causes["body far from the recording"] = error > _POOR
    for centre in _CENTRES:
        if centre in places:
            apart = np.linalg.norm(places[centre] - fitted[centre], axis=1)
            causes[f"{spoken(centre)} far from the body's"] = apart > _ASTRAY
    return causes


def not_seen(observed: np.ndarray, postures: np.ndarray, time: np.ndarray) -> dict[str, np.ndarray]:
    """Return where what a score stands on is not seen: cause -> those frames (n,) bool.

    Args:
        observed: which joints are told (n, 32) bool.
        postures: their angles (n, 32) [rad].
        time: when (n,) [s].
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
    """Return names and ends of bones, and by what share they may vary if they are not rigid.

    A trunk that bends is shorter, and a shoulder that is raised is nearer to the neck.
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
    """Return the frames of gaps that cannot be bridged, and of those at an end (n,) bool."""
    between, before, after = gaps(told)
    long = time[after] - time[before] > BRIDGED
    turned = (np.abs(angles[after] - angles[before]) > _MEANWHILE).any(axis=1)
    return ~told & ~(between & ~long & ~turned)


def _with_middles(places: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the places with the middle of the hips and the upper end of the head's bone."""
    found = dict(places)
    if "right_hip" in places and "left_hip" in places:
        found["hips"] = (places["right_hip"] + places["left_hip"]) / 2
    if "head" in places or "head_top" in places:
        found["skull"] = places.get("head_top", places.get("head", np.empty(0)))
    return found


def _bone(places: Mapping[str, np.ndarray], start: str, end: str) -> np.ndarray:
    return places[end] - places[start]
