"""Check that left and right are named correctly, by the direction in which a body faces.

The left and the right hip (or shoulder) define the forward direction. If toes, nose, knees or hands
show the opposite, the names are exchanged or an axis is mirrored, and the angles of both shoulders
would be wrong.

One sign alone may be a habit of the work or a wrong name: hands reach behind to pull a trolley, and
a "nose" may be any point of the head. So a recording is refused only by two signs that agree, or by
one that no body can show: feet that point backward, or knees that bend backward, nearly always.
Sides that are exchanged for a part of a take are exchanged back.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.joints import SIDES
from ergoqp.mocap.fitting.neutral import first_middle
from ergoqp.mocap.fitting.posture import every_centre

_HIPS: Final = ("right_hip", "left_hip")
_SHOULDERS: Final = ("right_shoulder", "left_shoulder")
_FEW: Final = 5
"""Fewer frames than this are chance."""
_CLEAR: Final = 0.8
"""Share of frames that have to show the same direction."""
_NEARLY_ALWAYS: Final = 0.95
"""Share of frames from which feet or knees count as two signs."""
_BENT: Final = np.cos(np.radians(15))
"""Cosine between the bones of a leg above which the knee shows no direction: some knees extend
beyond straight by 10 degrees, and joint centres are off by a few."""
_AHEAD: Final = 0.5
"""Least share of a knee's distance from the line of the leg that is ahead or behind: knees that are
bent to the side show no direction."""
_REACHES: Final = 0.5
"""Least distance of hands in front of or behind the shoulders that counts [length of the trunk]."""


_TURNS: Final = 0.15
"""Time in which nobody turns half around [s]."""


def exchanged_back(
    places: Mapping[str, np.ndarray], time: np.ndarray
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Return the centres with the sides that they have most of the time, and a sentence if changed.

    A depth camera may take a back for a front for a while. Then hips and shoulders change places
    from one frame to the next, which are two signs.

    Args:
        places: centre -> positions (n, 3), any unit, NaN where not seen.
        time: times of the frames (n,) [s].
    """
    found = dict(places)
    if not {*_HIPS, *_SHOULDERS} <= set(places):
        return found, []
    frames = np.flatnonzero(np.isfinite(sum(places[n][:, 0] for n in (*_HIPS, *_SHOULDERS))))
    changes = np.diff(time[frames]) < _TURNS
    for pair in (_HIPS, _SHOULDERS):
        right, left = (places[name][frames].astype(float) for name in pair)
        kept = _apart(right[1:], right[:-1]) + _apart(left[1:], left[:-1])
        changed = _apart(right[1:], left[:-1]) + _apart(left[1:], right[:-1])
        changes &= (changed < kept / 2) & (kept > _apart(right, left)[:-1])
    if not changes.any():
        return found, []
    sides = np.concatenate([[0], np.cumsum(changes)]) % 2
    sides = 1 - sides if sides.mean() > 0.5 else sides
    at = np.searchsorted(frames, np.arange(len(time)), side="right") - 1
    rows = sides[np.maximum(at, 0)] == 1
    for name in places:
        side, _, centre = name.partition("_")
        if side in SIDES:
            other = places.get(f"{SIDES[1 - SIDES.index(side)]}_{centre}")
            found[name] = places[name].copy()
            found[name][rows] = np.nan if other is None else other[rows]
    return found, [
        f"Left and right are exchanged in {int(rows.sum())} frames, before and after which hips and"
        " shoulders change places at once: there they are exchanged back."
    ]


def _apart(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return np.linalg.norm(one - other, axis=1)


@dataclass(frozen=True)
class _Sign:
    """One sign of the direction in which a person faces.

    Attributes:
        what: the sign in words.
        ways: how far it points forward (n,); NaN where it is unknown.
        firm: whether no body can show the opposite.
    """

    what: str
    ways: np.ndarray
    firm: bool = False

    @property
    def weight(self) -> int:
        """Number of signs that it counts as, negative if it points backward; 0 if unclear."""
        ways = self.ways[np.isfinite(self.ways)]
        if len(ways) < _FEW:
            return 0
        forward, backward = (ways > 0).mean(), (ways < 0).mean()
        if (share := max(forward, backward)) < _CLEAR:
            return 0
        size = 2 if self.firm and share >= _NEARLY_ALWAYS else 1
        return size if forward > backward else -size


def check_sides(where: str, places: Mapping[str, np.ndarray], *, trusted: bool = False) -> str:
    """Raise if the person faces backward; return a sentence if that is not clear.

    Args:
        where: the recording's name, for messages.
        places: centre -> positions (n, 3), any unit, along our axes.
        trusted: whether left and right are right, whatever the body shows.

    Returns:
        A sentence that states the assumption, or an empty text.

    Raises:
        RecordingError: if left and right are exchanged, or an axis is mirrored.
    """
    top = first_middle(places, _SHOULDERS, ("neck",))
    hips = first_middle(places, _HIPS, ("pelvis",))
    pair = next((p for p in (_HIPS, _SHOULDERS) if all(name in places for name in p)), None)
    if top is None or hips is None or pair is None:
        return ""
    left, trunk = places[pair[1]] - places[pair[0]], top - hips
    ahead = np.stack([left[:, 1], -left[:, 0], 0 * left[:, 0]], axis=1).astype(float)
    # A trunk that is level or upside down does not show left and right.
    ahead[~(trunk[:, 2] > 0.5 * np.linalg.norm(trunk, axis=1))] = np.nan
    ahead /= np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-12)
    weights = {sign.what: sign.weight for sign in _signs(every_centre(places), ahead, trunk)}
    against = [what for what, weight in weights.items() if weight < 0]
    if not against:
        return "" if any(weights.values()) else _UNKNOWN
    said = " and ".join(against)
    size = -sum(weights[what] for what in against)
    agreeing = [what for what, weight in weights.items() if weight > 0]
    if not trusted and size > max(1, sum(weights[what] for what in agreeing)):
        raise RecordingError(
            f"{where}: {said} backward: left and right are exchanged, or an axis is mirrored;"
            " exchange the names (mapping) or reverse the axis, or state that the sides are right"
            " (trust sides)"
        )
    named = "as named, as stated" if trusted else "as named"
    forward = f", and {' and '.join(agreeing)} forward" if agreeing else ""
    return f"Left and right are taken {named}, although {said} backward{forward}."


_UNKNOWN: Final = (
    "Left and right are taken as named, because no toe, nose, bent knee or reaching hand shows"
    " which way the person faces."
)


def _signs(
    place: Mapping[str, np.ndarray], ahead: np.ndarray, trunk: np.ndarray
) -> Iterator[_Sign]:
    """Yield the signs of the direction in which a person faces.

    Args:
        place: every centre -> positions (n, 3).
        ahead: the horizontal forward direction (n, 3); NaN while the trunk is not upright.
        trunk: vector from the hips to the top of the trunk (n, 3).
    """
    legs = [[place[f"{s}_{name}"] for name in ("hip", "knee", "ankle", "toe")] for s in SIDES]
    yield _Sign(
        "the feet point", np.concatenate([_toes(ahead, *leg[1:]) for leg in legs]), firm=True
    )
    yield _Sign("the nose points", _along(ahead, place["nose"] - place["head"]))
    yield _Sign(
        "the knees bend", np.concatenate([_knees(ahead, *leg[:3]) for leg in legs]), firm=True
    )
    # Forward here is perpendicular to the trunk, not along the floor, so a tilt does not matter.
    size = np.linalg.norm(trunk, axis=1, keepdims=True)
    left = np.stack([-ahead[:, 1], ahead[:, 0], 0 * ahead[:, 0]], axis=1)
    before = np.cross(left, trunk / np.maximum(size, 1e-12))
    reaches = [_along(before, place[f"{s}_wrist"] - place[f"{s}_shoulder"]) for s in SIDES]
    far = [np.where(np.abs(reach) > _REACHES * size[:, 0], reach, np.nan) for reach in reaches]
    yield _Sign("the hands reach", np.concatenate(far))


def _toes(ahead: np.ndarray, knee: np.ndarray, ankle: np.ndarray, toe: np.ndarray) -> np.ndarray:
    # A person who kneels has the toes behind.
    shank = knee - ankle
    stands = shank[:, 2] > 0.7 * np.linalg.norm(shank, axis=1)
    return np.where(stands, _along(ahead, toe - ankle), np.nan)


def _knees(ahead: np.ndarray, hip: np.ndarray, knee: np.ndarray, ankle: np.ndarray) -> np.ndarray:
    thigh, shank = knee - hip, ankle - knee
    size = np.linalg.norm(thigh, axis=1) * np.linalg.norm(shank, axis=1)
    bent = (thigh * shank).sum(axis=1) < _BENT * size
    away = knee - (hip + ankle) / 2
    forward = _along(ahead, away)
    shown = bent & (np.abs(forward) > _AHEAD * np.linalg.norm(away, axis=1))
    return np.where(shown, forward, np.nan)


def _along(ahead: np.ndarray, vector: np.ndarray) -> np.ndarray:
    return (ahead * vector).sum(axis=1)
