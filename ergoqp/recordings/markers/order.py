"""Check that markers are where their names say, by orders that every body has.

A marker that is named wrongly for the whole take keeps its distances, so the other checks do not
notice it. But the markers along a limb have an order, both sides are equally long, left is to the
left, and the face is in front. A violation counts if it lasts nearly all the time, because a marker
may also fall off early in the take.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.joints import SIDES

_NEARLY_ALL: Final = 0.9
"""Share of the frames in which a violation has to occur."""
_ALONG: Final = (
    ("acromion", "upper_arm", "outer_elbow"),
    ("outer_elbow", "forearm", "wrist_thumb"),
    ("outer_elbow", "wrist_thumb", "hand"),
    ("outer_elbow", "wrist_small", "hand"),
    ("asis", "thigh", "outer_knee"),
    ("outer_knee", "shank", "outer_ankle"),
    ("outer_ankle", "heel", "forefoot"),
)
"""The second landmark is nearer to the first than the third is, on each side."""
_UP: Final = (("back", "c7"), ("xiphoid", "notch"))
"""The first landmark is nearer to the hips than the second."""
_ALIKE: Final = (
    ("acromion", "outer_elbow"),
    ("outer_elbow", "wrist_thumb"),
    ("asis", "outer_knee"),
    ("outer_knee", "outer_ankle"),
    ("outer_ankle", "forefoot"),
)
"""Pairs of landmarks that are equally far apart on the right and on the left."""
_UNLIKE: Final = 1.35
"""Largest ratio of the distances on both sides."""
_APART: Final = (
    ("outer_elbow", "acromion", 0.15),
    ("wrist_thumb", "acromion", 0.20),
    ("wrist_small", "acromion", 0.20),
    ("thigh", "asis", 0.08),
    ("outer_knee", "asis", 0.10),
    ("shank", "asis", 0.10),
    ("outer_ankle", "asis", 0.15),
)
"""Landmark, pair that defines the sideways direction, and how far crossed limbs may cross [m]."""
_WIDE: Final = 0.12
"""Largest width of a wrist between its two markers [m]."""


def check_order(where: str, at: Mapping[str, np.ndarray]) -> None:
    """Raise if markers cannot be where their names say.

    Args:
        where: the recording's name, for messages.
        at: landmark -> positions (n, 3) [m] in a sample of frames; NaN where not seen.

    Raises:
        RecordingError: if so, with the landmarks.
    """
    for found in _impossible(at):
        raise RecordingError(
            f"{where}: got markers in impossible places ({found}), allowed markers where their"
            " names say; exchange their names (mapping), or reverse a mirrored axis"
        )


def _impossible(at: Mapping[str, np.ndarray]) -> Iterator[str]:
    for side in SIDES:
        for names in _ALONG:
            origin, near, far = (f"{side}_{name}" for name in names)
            if origin in at and near in at and far in at:
                yield from _beyond(origin, at[origin], near, far, at)
        pair = [f"{side}_wrist_{which}" for which in ("thumb", "small")]
        if all(name in at for name in pair):
            wide = _lengths(at[pair[0]] - at[pair[1]])
            if _nearly_always(wide - _WIDE):
                yield f"the {side} wrist is {_cm(wide)} wide between its markers"
    for one, other in _ALIKE:
        if all(f"{side}_{name}" in at for side in SIDES for name in (one, other)):
            right, left = (_lengths(at[f"{side}_{one}"] - at[f"{side}_{other}"]) for side in SIDES)
            longer = np.maximum(right, left) - _UNLIKE * np.minimum(right, left)
            if _nearly_always(longer):
                yield (
                    f"{_spoken(one)} and {_spoken(other)} are {_cm(right)} apart on the right and"
                    f" {_cm(left)} on the left"
                )
    yield from _turned(at)


def _beyond(
    origin: str, place: np.ndarray, near: str, far: str, at: Mapping[str, np.ndarray]
) -> Iterator[str]:
    """Yield an error in words if the first of two landmarks is not nearer to a place (n, 3)."""
    if _nearly_always(_lengths(at[near] - place) - _lengths(at[far] - place)):
        yield f"{_spoken(near)} is farther from {_spoken(origin)} than {_spoken(far)}"


def _turned(at: Mapping[str, np.ndarray]) -> Iterator[str]:
    """Yield errors in words: sides that are exchanged, and fronts that are behind."""
    across: dict[str, np.ndarray] = {}
    for name in ("asis", "acromion"):
        if all(f"{side}_{name}" in at for side in SIDES):
            left = at[f"left_{name}"] - at[f"right_{name}"]
            across[name] = left / np.maximum(_lengths(left)[:, None], 1e-9)
    for name, reference, most in _APART:
        if reference in across and all(f"{side}_{name}" in at for side in SIDES):
            apart = at[f"left_{name}"] - at[f"right_{name}"]
            if _nearly_always(-(apart * across[reference]).sum(axis=1) - most):
                yield f"the left {_spoken(name)} is to the right of the right one"
    if "asis" not in across:
        return
    hips = (at["left_asis"] + at["right_asis"]) / 2
    for near, far in _UP:
        if near in at and far in at:
            yield from _beyond("hips", hips, near, far, at)
    if "acromion" not in across:
        return
    up = (at["left_acromion"] + at["right_acromion"]) / 2 - hips
    for which, front, behind in (
        ("acromion", "notch", "c7"),
        ("acromion", "xiphoid", "back"),
        ("acromion", "head_front", "head_back"),
        ("asis", "asis", "psis"),
    ):
        before, after = _middle(at, front), _middle(at, behind)
        if before is None or after is None:
            continue
        ahead = np.cross(across[which], up)
        if _nearly_always(((after - before) * ahead).sum(axis=1)):
            yield f"{_spoken(front)} is behind {_spoken(behind)}"


def _middle(at: Mapping[str, np.ndarray], name: str) -> np.ndarray | None:
    if name in at:
        return at[name]
    sides = [at[f"{side}_{name}"] for side in SIDES if f"{side}_{name}" in at]
    return (sides[0] + sides[1]) / 2 if len(sides) == 2 else None


def _nearly_always(values: np.ndarray) -> bool:
    """Return whether values (n,) are above zero in nearly all frames that have one."""
    known = values[np.isfinite(values)]
    return len(known) > 0 and float((known > 0).mean()) >= _NEARLY_ALL


def _lengths(vectors: np.ndarray) -> np.ndarray:
    return np.linalg.norm(vectors, axis=1)


def _cm(lengths: np.ndarray) -> str:
    return f"{100 * np.nanmedian(lengths):.0f} cm"


def _spoken(name: str) -> str:
    return name.replace("_", " ")
