"""Body of an unknown person, measured in the recording, and joint centres of a body."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from functools import cache
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.human import FRACTIONS, Body, Kinematics
from ergoqp.human.body import GROWTH, believable
from ergoqp.joints import JOINTS
from ergoqp.mocap.naming import CENTRES

_TELLING: Final = (("thigh", "shank", "trunk"), ("upper_arm", "forearm"))
"""Segments from which the stature is estimated: legs and trunk.

The arms are used only if those are missing, because character rigs often shorten the arms.
"""

_BETWEEN: Final[dict[str, tuple[tuple[str, str], ...]]] = {
    "neck": (("neck", "head"),),
    "head": (("head", "head_top"),),
    "shoulder_width": (("right_shoulder", "left_shoulder"),),
    "hip_width": (("right_hip", "left_hip"),),
    "upper_arm": (("right_shoulder", "right_elbow"), ("left_shoulder", "left_elbow")),
    "forearm": (("right_elbow", "right_wrist"), ("left_elbow", "left_wrist")),
    "thigh": (("right_hip", "right_knee"), ("left_hip", "left_knee")),
    "shank": (("right_knee", "right_ankle"), ("left_knee", "left_ankle")),
    "ankle_to_toe": (("right_ankle", "right_toe"), ("left_ankle", "left_toe")),
}
"""Segment -> the pairs of centres whose distance is its length, one pair per side."""


def measured_lengths(centres: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Return the segment lengths between named centres: frame medians, left and right averaged.

    Args:
        centres: centre -> positions (n, 3), any unit; NaN where not seen.

    Returns:
        Segment of `FRACTIONS`, or ``ankle_to_toe`` -> length in the same unit, for the segments
        whose ends were seen.
    """
    lengths = {}
    for segment, pairs in _BETWEEN.items():
        sides = [
            _median_distance(centres[a], centres[b])
            for a, b in pairs
            if a in centres and b in centres
        ]
        if sides := [side for side in sides if side > 0]:
            lengths[segment] = float(np.mean(sides))
    hips, shoulders = (_between(centres, joint) for joint in ("hip", "shoulder"))
    hips = centres.get("pelvis") if hips is None else hips
    if hips is not None and "neck" in centres:
        trunk = centres["neck"] - hips
        lengths["trunk"] = _median_distance(hips, centres["neck"])
        if shoulders is not None:
            with np.errstate(invalid="ignore", divide="ignore"):
                along = np.einsum("ni,ni->n", shoulders - hips, trunk) / np.linalg.norm(
                    trunk, axis=1
                )
            lengths["shoulder_height"] = _median(along)
    return {segment: length for segment, length in lengths.items() if length > 0}


def side_measured(segment: str, centres: Collection[str]) -> str | None:
    """Return the only side on which a segment is measured; None for both, or a middle segment.

    Args:
        segment: segment of `FRACTIONS`.
        centres: centres of the recording.
    """
    pairs = _BETWEEN.get("ankle_to_toe" if segment == "foot_length" else segment, ())
    seen = [a for a, b in pairs if a in centres and b in centres]
    return seen[0].partition("_")[0] if len(seen) == 1 < len(pairs) else None


def suggested_stature(lengths: Mapping[str, float]) -> float | None:
    """Return the stature estimated from the long segments, in the unit of the lengths.

    It is None if none of them was measured. The sum of the segments is used and not each one,
    because the sum does not depend on where a skeleton puts the joints between them.
    """
    for chain in _TELLING:
        if present := [segment for segment in chain if segment in lengths]:
            return sum(lengths[segment] for segment in present) / sum(
                FRACTIONS[segment] for segment in present
            )
    return None


def measured_person(lengths: Mapping[str, float], stature: float) -> tuple[Body, list[str]]:
    """Return the body with the measured lengths that are within a person's range.

    The names of the segments that keep average proportions are returned too.

    Args:
        lengths: segment -> length [m]; ``ankle_to_toe`` is converted to the foot length that puts
            the body's toe joint there.
        stature: stature estimated from the long segments [m].

    Raises:
        InputError: if the stature is not that of a person.
    """
    lengths = dict(lengths)
    if ankle_to_toe := lengths.pop("ankle_to_toe", None):
        forward, _, down = Body.of_stature(stature).model.site("right_toe").pos
        toe_forward = math.sqrt(max(ankle_to_toe**2 - down**2, 0.0))
        lengths["foot_length"] = FRACTIONS["foot_length"] * stature * toe_forward / forward
    believed = {}
    for segment, length in lengths.items():
        # With a length outside this range, the file's joint is not the anatomical one.
        low, high = believable(segment, stature)
        if low <= length <= high:
            believed[segment] = length
    return Body(stature, believed), sorted(set(lengths) - set(believed))


def _between(centres: Mapping[str, np.ndarray], joint: str) -> np.ndarray | None:
    right, left = centres.get(f"right_{joint}"), centres.get(f"left_{joint}")
    return None if right is None or left is None else (right + left) / 2


def _median_distance(a: np.ndarray, b: np.ndarray) -> float:
    return _median(np.linalg.norm(a - b, axis=1))


def _median(values: np.ndarray) -> float:
    values = values[np.isfinite(values)]
    return float(np.median(values)) if len(values) else 0.0


_MEASURED: Final = tuple(
    centre for centre in CENTRES if not centre.endswith(("nose", "knuckles", "thumb"))
)
"""Centres with an anatomical position; the others only define a direction."""
_BLOCK: Final = 4096


def placed(names: Iterable[str]) -> list[str]:
    """Return those of some centres that have an anatomical position."""
    return [name for name in names if name in _MEASURED]


def centres_of(body: Body, pelvis: np.ndarray, postures: np.ndarray) -> dict[str, np.ndarray]:
    """Return the body's joint centres that have an anatomical position.

    Args:
        body: the person.
        pelvis: x, y, z [m] and yaw [rad] (n, 4).
        postures: joint angles (n, 32) [rad].

    Returns:
        Centre -> positions (n, 3) [m].

    Example:
        >>> import numpy as np
        >>> from ergoqp.human import Body
        >>> from ergoqp.mocap.fitting.person import centres_of
        >>> pelvis = np.array([[0.0, 0.0, 0.9, 0.0]])
        >>> centres = centres_of(Body(), pelvis, np.zeros((1, 32)))
        >>> float(centres["left_wrist"][0, 1].round(3))
        0.184
    """
    z, function, growth = np.hstack([pelvis, postures]), _function(), growth_of(body)
    parts = [np.array(function(z[at : at + _BLOCK].T, growth)) for at in range(0, len(z), _BLOCK)]
    places = np.hstack(parts).reshape(len(_MEASURED), 3, -1)
    return {centre: place.T for centre, place in zip(_MEASURED, places, strict=True)}


def growth_of(body: Body) -> np.ndarray:
    """Return a body's growth over the nominal body (14,), in the order of `GROWTH`."""
    nominal = Body()
    whole = body.stature / nominal.stature
    growth = [whole - 1]
    growth += [body.lengths[name] / nominal.lengths[name] - whole for name in FRACTIONS]
    return np.array(growth)


@cache
def _function() -> ca.Function:
    """Return a function: pelvis and posture (36,), growth (14,) -> positions of `_MEASURED`."""
    z, growth = ca.SX.sym("z", 4 + len(JOINTS)), ca.SX.sym("growth", len(GROWTH))
    kinematics = Kinematics(Body(), growth)
    cos, sin = ca.cos(z[3]), ca.sin(z[3])
    yaw = ca.blockcat([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    places = [z[:3] + yaw @ kinematics.at(centre, z[4:])[0] for centre in _MEASURED]
    return ca.Function("centres", [z, growth], [ca.densify(ca.cse(ca.vertcat(*places)))])
