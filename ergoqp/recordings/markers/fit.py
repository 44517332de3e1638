"""Places of markers on the fitted body: their offsets and residuals.

One function serves all people and all marker sets: the person's lengths and the markers' offsets
are its inputs, so nothing is compiled again.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.human import Body
from ergoqp.human.person_file import Marker
from ergoqp.joints import SIDES
from ergoqp.recordings.fitting.centres_of import growth_of
from ergoqp.recordings.markers.frames import SEGMENTS, inputs, segments
from ergoqp.recordings.markers.landmarks import RIGID
from ergoqp.recordings.markers.rigid import brought_to, shape_of

_ON: Final = {
    "asis": ("pelvis", "trunk"),
    "psis": ("pelvis", "trunk"),
    "sacrum": ("pelvis", "trunk"),
    "c7": ("trunk",),
    "back": ("trunk",),
    "notch": ("trunk",),
    "xiphoid": ("trunk",),
    "acromion": ("trunk", "shoulder"),
    "upper_arm": ("shoulder",),
    "outer_elbow": ("shoulder", "elbow"),
    "inner_elbow": ("shoulder", "elbow"),
    "forearm": ("elbow", "wrist"),
    "wrist_thumb": ("elbow", "wrist"),
    "wrist_small": ("elbow", "wrist"),
    "hand": ("wrist",),
    "thigh": ("hip",),
    "outer_knee": ("hip", "knee"),
    "inner_knee": ("hip", "knee"),
    "shank": ("knee",),
    "outer_ankle": ("knee", "ankle"),
    "inner_ankle": ("knee", "ankle"),
    "heel": ("ankle",),
    "forefoot": ("ankle",),
    "head_front": ("head",),
    "head_back": ("head",),
}
"""Landmark -> frames that it may be fixed to, on its own side where there are two."""
_BLOCK: Final = 4096
_ROUNDS: Final = 3
_ASTRAY: Final = 3.0
"""Positions farther away than this many times the median are not used for a marker's place."""


def markers_on(
    body: Body,
    pelvis: np.ndarray,
    postures: np.ndarray,
    markers: Mapping[str, np.ndarray],
    landmarks: Mapping[str, str],
) -> dict[str, Marker]:
    """Return the places of markers on a body: each on the nearby segment with which it moves.

    The markers of pelvis, trunk or head are all on one segment, in the shape that they keep: a
    tilting pelvis rotates against both segments to which its markers may be fixed.

    Args:
        body: the person.
        pelvis: x, y, z [m] and yaw [rad] (n, 4).
        postures: joint angles (n, 32) [rad].
        markers: name -> positions (n, 3) [m]; NaN where not seen.
        landmarks: name -> the landmark that it marks, or the segment that it is on.
    """
    if not markers:
        return {}
    turns, places = _frames(body, pelvis, postures)
    found: dict[str, Marker] = {}
    for names in _together(markers, landmarks):
        best: tuple[float, str, list[np.ndarray]] | None = None
        for frame in _beside(landmarks[names[0]]):
            i = SEGMENTS.index(frame)
            local = [
                np.einsum("nji,nj->ni", turns[:, i], markers[name] - places[:, i]) for name in names
            ]
            offsets, usual = zip(*map(_middle, local), strict=True)
            if best is None or sum(usual) < best[0]:
                best = (sum(usual), frame, list(offsets))
        assert best is not None
        _, frame, offsets = best
        shape = shape_of(np.stack([markers[name] for name in names], axis=1))
        if shape is not None and (rigid := brought_to(shape, np.array(offsets))) is not None:
            # A marker that is never seen with the others is not in the shape.
            offsets = list(np.where(np.isfinite(rigid[0]), rigid[0], offsets))
        for name, offset in zip(names, offsets, strict=True):
            away = np.linalg.norm(markers[name] - _placed(turns, places, frame, offset), axis=1)
            away = away[np.isfinite(away)]
            residual = float(np.sqrt(np.mean(away**2)))
            found[name] = Marker(
                frame, (float(offset[0]), float(offset[1]), float(offset[2])), residual
            )
    lost = Marker("pelvis", (0.0, 0.0, 0.0), float("nan"))
    return {name: found.get(name, lost) for name in markers}


def places_of_markers(
    body: Body, pelvis: np.ndarray, postures: np.ndarray, sits: Mapping[str, Marker]
) -> dict[str, np.ndarray]:
    """Return marker -> positions (n, 3) [m], from its place on a body.

    Args:
        body: the person.
        pelvis: x, y, z [m] and yaw [rad] (n, 4).
        postures: joint angles (n, 32) [rad].
        sits: marker -> its place on the body, from `markers_on`.
    """
    turns, places = _frames(body, pelvis, postures)
    return {
        name: _placed(turns, places, each.frame, np.array(each.offset))
        for name, each in sits.items()
    }


def _placed(turns: np.ndarray, places: np.ndarray, frame: str, offset: np.ndarray) -> np.ndarray:
    """Return a marker (n, 3) [m] on one of the frames (rotations n, f, 3, 3; places n, f, 3)."""
    i = SEGMENTS.index(frame)
    return places[:, i] + turns[:, i] @ offset


def _together(
    markers: Mapping[str, np.ndarray], landmarks: Mapping[str, str]
) -> list[tuple[str, ...]]:
    """Return groups of the markers that are seen: a rigid segment's together, others alone."""
    groups: dict[str, tuple[str, ...]] = {}
    for name, path in markers.items():
        if np.isfinite(path).all(axis=1).any():
            mark = landmarks[name]
            rigid = (part for part, parts in RIGID.items() if mark in (part, *parts))
            group = next(rigid, name)
            groups[group] = (*groups.get(group, ()), name)
    return list(groups.values())


def _beside(landmark: str) -> list[str]:
    """Return the frames that a marker may be fixed to."""
    if landmark in SEGMENTS:
        return [landmark]
    side, _, name = landmark.partition("_")
    if side not in SIDES:
        return list(_ON[landmark])
    return [part if part in SEGMENTS else f"{side}_{part}" for part in _ON[name]]


def _middle(local: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the mean of points (n, 3) without outliers, and the median distance from it."""
    local = local[np.isfinite(local).all(axis=1)]
    offset = np.median(local, axis=0)
    for _ in range(_ROUNDS):
        away = np.linalg.norm(local - offset, axis=1)
        near = away <= _ASTRAY * max(float(np.median(away)), 1e-6)
        offset = local[near].mean(axis=0)
    return offset, float(np.sqrt(np.median(((local - offset) ** 2).sum(axis=1))))


def _frames(body: Body, pelvis: np.ndarray, postures: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rotations (n, f, 3, 3) and positions (n, f, 3) [m] of `SEGMENTS`."""
    z, function, growth = np.hstack([pelvis, postures]), _function(), growth_of(body)
    parts = [np.array(function(z[at : at + _BLOCK].T, growth)) for at in range(0, len(z), _BLOCK)]
    values = np.hstack(parts).T.reshape(len(z), len(SEGMENTS), 4, 3)
    return np.swapaxes(values[:, :, 1:], 2, 3), values[:, :, 0]


@cache
def _function() -> ca.Function:
    """Return a function: pelvis and posture (36,), growth (14,) -> position and axes of each."""
    given = inputs()
    rows = [part for place, turn, _ in segments(*given) for part in (place, ca.vec(turn))]
    return ca.Function("frames", given, [ca.densify(ca.cse(ca.vertcat(*rows)))])
