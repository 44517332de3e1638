"""Assignment of markers to landmarks of the body, and checks that they are where their names say.

Check that markers are where their names say, by orders that every body has.

A marker that is named wrongly for the whole take keeps its distances, so the other checks do not
notice it. But the markers along a limb have an order, both sides are equally long, left is to the
left, and the face is in front. A violation counts if it lasts nearly all the time, because a marker
may also fall off early in the take.

Detection of limb markers that do not keep their distances: exchanged or fallen off.

Two or three markers are not a rigid shape that can be tracked (`ergoqp.mocap.markers.rigid`).
But along a limb each marker keeps its distance from its neighbours, as far as skin and joints
allow.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import Final

import numpy as np
from scipy.ndimage import binary_dilation

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


_TOGETHER: Final = (
    ("shoulder", "upper_arm", "outer_elbow", "inner_elbow"),
    ("outer_elbow", "inner_elbow", "forearm", "wrist_thumb", "wrist_small"),
    ("wrist_thumb", "wrist_small", "hand"),
    ("hip", "thigh", "outer_knee", "inner_knee"),
    ("outer_knee", "inner_knee", "shank", "outer_ankle", "inner_ankle"),
    ("outer_ankle", "inner_ankle", "heel", "forefoot"),
)
"""Groups of landmarks and joint centres of a side in which any two keep their distance: markers
beside a joint are near its axis."""
_SHARE: Final = 0.25
"""Least share of the time in which a marker is in its right place."""
_TIMES: Final = 6.0
"""Factor on the usual deviation of a distance by which it may differ."""
_LEEWAY: Final = (0.025, 0.08)
"""Limits of that difference: the smallest because skin moves, and the largest [m]."""
_BLADE: Final = 0.06
"""Its smallest limit for distances from a shoulder [m]: the shoulder blade turns with a raised arm,
and its marker is not at the joint."""


class Links:
    """The distances that markers of a person keep.

    Args:
        at: landmark -> positions (n, 3) [m] in a sample of frames; NaN where not seen.
    """

    def __init__(self, at: Mapping[str, np.ndarray]) -> None:
        """Measure the distances."""
        pairs = {
            (f"{side}_{one}", f"{side}_{other}")
            for side in SIDES
            for group in _TOGETHER
            for one, other in combinations(group, 2)
        }
        self._usual: dict[tuple[str, str], tuple[float, float]] = {}
        for one, other in sorted(pairs):
            if one in at and other in at:
                middle = usual_distance(at[one], at[other])
                if np.isfinite(middle):
                    least = _BLADE if "shoulder" in one + other else _LEEWAY[0]
                    off = np.abs(np.linalg.norm(at[one] - at[other], axis=1) - middle)
                    varies = 1.4826 * float(np.nanmedian(off))
                    leeway = float(np.clip(_TIMES * varies, least, _LEEWAY[1]))
                    self._usual[one, other] = (middle, leeway)

    def astray(self, at: Mapping[str, np.ndarray], around: int = 0) -> dict[str, np.ndarray]:
        """Return the landmarks in a wrong place -> those frames (n,) bool.

        A landmark with the most wrong distances is in a wrong place. Its distances are removed, and
        this is repeated until no distance is wrong. Landmarks with equally many are all taken, so
        of two landmarks that only disagree with each other neither is used.

        Args:
            at: landmark -> positions (n, 3) [m]; NaN where not seen.
            around: number of frames before and after, in which a marker moves there and back.
        """
        if not self._usual:
            return {}
        names = sorted({name for pair in self._usual for name in pair})
        which = np.array([[names.index(name) for name in pair] for pair in self._usual])
        usual, leeway = np.array(list(self._usual.values())).T
        length = np.stack(
            [np.linalg.norm(at[one] - at[other], axis=1) for one, other in self._usual], axis=1
        )
        seen = np.isfinite(length)
        broken = seen & (np.abs(np.where(seen, length, usual) - usual) > leeway)
        rows = np.flatnonzero(broken.any(axis=1))
        found = np.zeros((len(length), len(names)), dtype=bool)
        if len(rows):
            found[rows] = _out(broken[rows], which, len(names))
            found = binary_dilation(found, np.ones((2 * around + 1, 1), dtype=bool))
        return {name: found[:, i] for i, name in enumerate(names) if found[:, i].any()}


def _out(broken: np.ndarray, which: np.ndarray, count: int) -> np.ndarray:
    """Return which of some markers are in a wrong place (n, count) bool.

    Args:
        broken: links whose distance is wrong (n, links) bool.
        which: ends of the links (links, 2).
        count: number of markers.
    """
    ends = np.zeros((len(which), count))
    ends[np.arange(len(which))[:, None], which] = 1.0
    out = np.zeros((len(broken), count), dtype=bool)
    for _ in range(count):
        bad = broken @ ends
        now = (bad == bad.max(axis=1, keepdims=True)) & (bad > 0)
        if not now.any():
            break
        out |= now
        broken = broken & ((now @ ends.T) == 0)
    return out


def usual_distance(one: np.ndarray, other: np.ndarray) -> float:
    """Return the usual distance between two points (n, 3); NaN if they are never seen together.

    It is the median of the quarter of the frames in which the distance varies least, because either
    marker may fall off later.
    """
    length = np.linalg.norm(one - other, axis=1)
    ordered = np.sort(length[np.isfinite(length)])
    if not len(ordered):
        return float("nan")
    count = max(1, round(_SHARE * len(ordered)))
    first = int(np.argmin(ordered[count - 1 :] - ordered[: len(ordered) - count + 1]))
    return float(np.median(ordered[first : first + count]))
