"""Where the base of the neck and the middle of the hips are, and what stands for them if lost.

Both ends of the trunk decide its lean. A neck that is lost is placed on both shoulders, where it is
at other times, and hips by the centre of the pelvis. If they are never seen together, the neck is
taken as the middle of the shoulders, and the pelvis as the middle of the hips. Shoulders rise and
reach ahead, and pelves have their centre elsewhere, so the lean is off by some degrees.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from ergoqp.mocap.fitting.coupled import about_up

_SAMPLE: Final = 8192
"""Number of frames of a long recording that show usual places, about."""
_NECK: Final = (np.radians(5.0), np.radians(8.0))
"""Half-angle by which the trunk may be off by a neck that stands for another, if it is seen at
other times, and if never. Real shoulders move by up to 0.04 m on a trunk of 0.5 m; centres of necks
in skeletons are up to 0.06 m from the middle of the shoulders."""
_HIPS: Final = (np.radians(3.0), np.radians(8.0))
"""The same for hips."""


@dataclass(frozen=True, eq=False)
class UsualPlaces:
    """Where both ends of the trunk usually are; NaN: never seen.

    Attributes:
        neck: base of the neck ahead of, left of and above the middle of the shoulders, as a share
            of the distance from there to the hips (3,).
        hips: middle of the hips ahead of, left of and above the centre of the pelvis (3,) [m].
    """

    neck: np.ndarray
    hips: np.ndarray


def usual_places(places: Mapping[str, np.ndarray]) -> UsualPlaces:
    """Return where both ends of the trunk usually are.

    Args:
        places: every centre -> positions (n, 3) [m], NaN where not seen.
    """
    some = slice(None, None, 1 + len(places["neck"]) // _SAMPLE)
    few = {centre: path[some].astype(float) for centre, path in places.items()}
    across = few["left_hip"] - few["right_hip"]
    yaw = np.arctan2(-across[:, 0], across[:, 1])
    hips = about_up(_middle(few, "hip") - few["pelvis"], yaw)
    return UsualPlaces(_median(neck_on(few)), _median(hips))


def neck_on(places: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return where the base of the neck is on the shoulders (n, 3), as in `UsualPlaces`.

    The axes are those of hips and shoulders, so an error of the neck does not turn them.

    Args:
        places: every centre -> positions (n, 3) [m], NaN where not seen.
    """
    middle = _middle(places, "shoulder")
    axes, size = _axes(places, middle - _middle(places, "hip"))
    along = np.einsum("nij,nj->ni", axes, places["neck"] - middle)
    return along / np.where(size > 0, size, np.nan)


def hips_of(places: Mapping[str, np.ndarray], yaw: np.ndarray, usual: UsualPlaces) -> np.ndarray:
    """Return the middle of the hips (n, 3) [m], or what stands for it.

    Args:
        places: every centre -> positions (n, 3) [m], NaN where not seen.
        yaw: heading of the body (n,) [rad].
        usual: where it usually is.
    """
    away = about_up(np.broadcast_to(np.nan_to_num(usual.hips), (len(yaw), 3)), -yaw)
    return either(_middle(places, "hip"), places["pelvis"] + away)


def neck_of(places: Mapping[str, np.ndarray], hips: np.ndarray, usual: UsualPlaces) -> np.ndarray:
    """Return the base of the neck (n, 3) [m], or what stands for it.

    Args:
        places: every centre -> positions (n, 3) [m], NaN where not seen.
        hips: middle of the hips (n, 3) [m].
        usual: where the neck usually is.
    """
    middle = _middle(places, "shoulder")
    axes, size = _axes(places, middle - hips)
    away = np.einsum("nij,i->nj", axes, np.nan_to_num(usual.neck)) * size
    return either(places["neck"], middle + away)


def off_by(places: Mapping[str, np.ndarray], usual: UsualPlaces) -> np.ndarray:
    """Return the half-angle by which the lean of the trunk may be off (n,) [rad].

    Args:
        places: every centre -> positions (n, 3) [m], NaN where not seen.
        usual: where both of its ends usually are.
    """
    half = np.zeros(len(places["neck"]), dtype=np.float32)
    for end, other, (known, unknown), place in (
        (places["neck"], _middle(places, "shoulder"), _NECK, usual.neck),
        (_middle(places, "hip"), places["pelvis"], _HIPS, usual.hips),
    ):
        stands = np.isnan(end[:, 0]) & np.isfinite(other[:, 0])
        half += np.where(stands, unknown if np.isnan(place[0]) else known, 0.0)
    return half


def either(*choices: np.ndarray) -> np.ndarray:
    """Return the first of several vectors that is seen, in each frame (n, 3)."""
    found = choices[-1]
    for choice in reversed(choices[:-1]):
        found = np.where(np.isfinite(choice).all(axis=1, keepdims=True), choice, found)
    return found


def _middle(places: Mapping[str, np.ndarray], pair: str) -> np.ndarray:
    return (places[f"right_{pair}"] + places[f"left_{pair}"]) / 2


def _axes(places: Mapping[str, np.ndarray], up: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the axes ahead, left and up of the shoulders (n, 3, 3), and the length of `up`."""
    ahead = np.cross(places["left_shoulder"] - places["right_shoulder"], up)
    axes = np.stack([ahead, np.cross(up, ahead), up], axis=1)
    length = np.linalg.norm(axes, axis=2, keepdims=True)
    return axes / np.where(length > 0, length, np.nan), length[:, 2]


def _median(vectors: np.ndarray) -> np.ndarray:
    """Return the median of those that are seen (3,); NaN if none is."""
    seen = np.isfinite(vectors).all(axis=1)
    return np.median(vectors[seen], axis=0) if seen.any() else np.full(3, np.nan)
