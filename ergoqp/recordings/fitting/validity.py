"""Which frames of a recording are not to be scored, and why.

A posture that the recording does not show is no posture: a bone that the body cannot follow within
its joints' ranges, a bone that is suddenly longer, a body that is nowhere near, a joint that was
lost. Such frames are not scored, counted, and named.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np

from ergoqp.joints import INDEX, SIDES, spoken

_OFF: Final = np.radians(10.0)
"""By how much a bone of the body may point elsewhere [rad]: half a band of the sheet."""
_STRETCHED: Final = 0.3
"""By what share of its median a bone may be longer or shorter."""
_POOR: Final = 0.10
"""How far the body may be from the recording, RMS over the centres [m]."""
_ASTRAY: Final = 0.20
"""How far one joint centre of the body may be [m]."""
BRIDGED: Final = 0.2
"""For how long a joint may be lost: what is between is taken for it [s]."""

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
    ("trunk", "trunk_flexion"),
    ("neck", "neck_flexion"),
    *(
        (f"{side} {part}", f"{side}_{joint}")
        for side in SIDES
        for part, joint in (
            ("upper arm", "shoulder_flexion"),
            ("forearm", "elbow_flexion"),
            ("knee", "knee_flexion"),
        )
    ),
)
"""What a score stands on, if the recording tells it at all."""


def usual_lengths(places: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Return the median lengths of the bones that are scored [m]; only of those that are seen.

    Args:
        places: centre -> positions (n, 3) [m], NaN where not seen.
    """
    places, found = _with_middles(places), {}
    for name, start, end in _bones():
        if start in places and end in places:
            length = np.linalg.norm(places[end] - places[start], axis=1)
            if np.isfinite(length).any():
                found[name] = float(np.nanmedian(length))
    return found


def not_followed(
    places: Mapping[str, np.ndarray],
    fitted: Mapping[str, np.ndarray],
    error: np.ndarray,
    usual: Mapping[str, float],
) -> dict[str, np.ndarray]:
    """Return where the body does not follow the recording: cause -> those frames (n,) bool.

    Args:
        places: centre -> positions of the recording (n, 3) [m], NaN where not seen.
        fitted: the same of the body.
        error: RMS distance of the centres (n,) [m].
        usual: lengths of the bones [m], see `usual_lengths`.
    """
    causes = {}
    places, fitted = _with_middles(places), _with_middles(fitted)
    for name, *ends in _DIRECTIONS:
        if name in usual:
            bone, own = (_bone(each, *ends) for each in (places, fitted))
            causes[f"{name} beyond its range"] = _angle(bone, own) > _OFF
    for name, *ends in _BENDS:
        if all(end in places for end in ends):
            bones, own = (
                [_bone(each, *ends[:2]), _bone(each, *ends[1:])] for each in (places, fitted)
            )
            causes[f"{name} beyond its range"] = np.abs(_angle(*bones) - _angle(*own)) > _OFF
    for name, start, end in _bones():
        if name in usual:
            length = np.linalg.norm(places[end] - places[start], axis=1)
            stretched = np.abs(length - usual[name]) > _STRETCHED * usual[name]
            causes[f"{name} of another length"] = stretched
    causes["body far from the recording"] = error > _POOR
    for centre in _CENTRES:
        if centre in places:
            apart = np.linalg.norm(places[centre] - fitted[centre], axis=1)
            causes[f"{spoken(centre)} far from the body's"] = apart > _ASTRAY
    return causes


def not_seen(observed: np.ndarray, time: np.ndarray) -> dict[str, np.ndarray]:
    """Return where what a score stands on is not seen: cause -> those frames (n,) bool.

    Args:
        observed: which joints are told (n, 32) bool.
        time: when (n,) [s].
    """
    causes = {}
    for name, joint in NEEDED:
        told = observed[:, INDEX[joint]]
        if told.any():
            causes[f"{name} not seen"] = _lost(told, time)
    for name, joints in (
        ("trunk", ("trunk_flexion",)),
        ("arms", tuple(f"{side}_shoulder_flexion" for side in SIDES)),
    ):
        if not observed[:, [INDEX[joint] for joint in joints]].any():
            causes[f"{name} not seen"] = np.ones(len(time), dtype=bool)
    return causes


def _bones() -> Iterator[tuple[str, str, str]]:
    """Return names and ends of all bones that are scored."""
    yield from _DIRECTIONS
    for side in SIDES:
        yield f"{side} forearm", f"{side}_elbow", f"{side}_wrist"
        yield f"{side} thigh", f"{side}_hip", f"{side}_knee"
        yield f"{side} shank", f"{side}_knee", f"{side}_ankle"


def _lost(told: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return the frames of gaps that are longer than `BRIDGED`, or at an end (n,) bool."""
    seen = time[told]
    after = np.searchsorted(seen, time)
    before = np.where(after > 0, seen[np.maximum(after - 1, 0)], -np.inf)
    following = np.where(after < len(seen), seen[np.minimum(after, len(seen) - 1)], np.inf)
    return ~told & (following - before > BRIDGED)


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


def _angle(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the angle between vectors (n,) [rad]; NaN where one is not seen."""
    across = np.linalg.norm(np.cross(one, other), axis=1)
    return np.arctan2(across, (one * other).sum(axis=1))
