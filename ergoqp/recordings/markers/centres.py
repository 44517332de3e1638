"""Joint centres from landmarks: what lies how far below the skin.

Hips are where Harrington et al. (2007) found them in the pelvis; knee, elbow and ankle lie half
their width inside of the marker on their outside, across the bone above ("chord", Davis et al.
1991), or between the markers on both sides. The elbow bends, so its axis is across the arm; the
knee's is where the marker on the thigh shows it.

All lengths are in metres; NaN is what is not seen. No vertical is needed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from ergoqp.joints import SIDES
from ergoqp.recordings.fitting.limbs import THUMB
from ergoqp.recordings.markers.vectors import across, dot, either, inside, unit

_BENT: Final = (np.sin(np.radians(10)), np.sin(np.radians(25)))
"""A limb that is bent by less does not show its axis, one by more shows it well."""
_ROUNDS: Final = 5
_OUTSIDE: Final = 0.01
"""A marker that is nearer to the line of a bone does not show how the bone is turned [m]."""


@dataclass(frozen=True)
class Widths:
    """How far inside of their markers joints are [m]; markers are 14 mm wide.

    The defaults are adult averages. What a recording says was measured takes their place.

    Attributes:
        knee: half the knee's width and half a marker.
        ankle: likewise.
        elbow: likewise.
        shoulder: from the acromion's marker down to the joint.
        hand: half the hand's thickness and half a marker.
    """

    knee: float = 0.057
    ankle: float = 0.043
    elbow: float = 0.044
    shoulder: float = 0.047
    hand: float = 0.020

    @classmethod
    def of(cls, measures: Mapping[str, float]) -> Widths:
        """Return the widths that Vicon's programs wrote into a file, by their names."""
        half, found = 0.007, {}
        for name, share in (("knee", 0.5), ("ankle", 0.5), ("elbow", 0.5), ("hand", 0.5)):
            what = "thickness" if name == "hand" else "width"
            sides = [measures.get(f"{side[0]}{name}{what}", 0.0) for side in ("left", "right")]
            if min(sides) > 0:
                found[name] = share * float(np.mean(sides)) + half
        sides = [measures.get(f"{side}shoulderoffset", 0.0) for side in "lr"]
        if min(sides) > 0:
            found["shoulder"] = float(np.mean(sides)) + half
        # What is not a person's is a mistake of whoever typed it.
        return cls(**{name: w for name, w in found.items() if 0.5 < w / getattr(cls, name) < 2.0})


def centres_of_landmarks(
    at: Mapping[str, np.ndarray], widths: Widths, size: tuple[float, float]
) -> dict[str, np.ndarray]:
    """Return joint centre -> positions (n, 3) [m], for those that can be told.

    Args:
        at: landmark of `ergoqp.recordings.markers.landmarks.LANDMARKS` -> positions (n, 3) [m].
        widths: of the person.
        size: width between the ASIS and depth from them to the PSIS [m]; NaN if not known.
    """
    place = _Landmarks(at)
    level, hips = _hips(place, size)
    trunk, down, left = _trunk(place, hips)
    left = either(left, level)
    centres = {**hips, **trunk, **_shoulders(place, down, widths)}
    for side in SIDES:
        out = -1.0 if side == "right" else 1.0
        shoulder = centres[f"{side}_shoulder"]
        centres |= _arm(side, out, place, shoulder, (left, down), widths)
        centres |= _leg(side, out, place, centres[f"{side}_hip"], level, widths)
    centres |= _head(place)
    return {name: path for name, path in centres.items() if np.isfinite(path[:, 0]).any()}


def roots_of(
    at: Mapping[str, np.ndarray], widths: Widths, size: tuple[float, float]
) -> dict[str, np.ndarray]:
    """Return the centres from which limbs hang (n, 3) [m]: they are told without their markers.

    Args:
        at: as in `centres_of_landmarks`.
        widths: likewise.
        size: likewise.
    """
    place = _Landmarks(at)
    _, hips = _hips(place, size)
    _, down, _ = _trunk(place, hips)
    return hips | _shoulders(place, down, widths)


class _Landmarks:
    """Landmarks, those that are not there too."""

    def __init__(self, at: Mapping[str, np.ndarray]) -> None:
        self._at, self._lost = at, np.full_like(next(iter(at.values())), np.nan)

    def __getitem__(self, name: str) -> np.ndarray:
        return self._at.get(name, self._lost)

    def __contains__(self, name: str) -> bool:
        return name in self._at

    def middle(self, name: str) -> np.ndarray:
        """Return the middle between both sides."""
        return (self[f"right_{name}"] + self[f"left_{name}"]) / 2


def _hips(place: _Landmarks, size: tuple[float, float]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return where left is (n, 3), and the hip centres."""
    width, depth = size
    front = place.middle("asis")
    back = either(place.middle("psis"), place["sacrum"], place["right_psis"], place["left_psis"])
    left = unit(place["left_asis"] - place["right_asis"])
    ahead = front - back
    ahead = unit(across(ahead, left))
    up = np.cross(ahead, left)
    middle = front - (0.24 * depth + 0.0099) * ahead - (0.30 * width + 0.0109) * up
    aside = (0.33 * width + 0.0073) * left
    return left, {"right_hip": middle - aside, "left_hip": middle + aside}


def _trunk(
    place: _Landmarks, hips: Mapping[str, np.ndarray]
) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
    """Return the base of the neck, and where down and left are in the trunk (n, 3)."""
    shoulders = place.middle("acromion")
    neck = either((place["c7"] + place["notch"]) / 2, shoulders)
    low = either((place["back"] + place["xiphoid"]) / 2, place["back"], place["xiphoid"])
    pelvis = (hips["right_hip"] + hips["left_hip"]) / 2
    down = either(unit(low - neck), unit(pelvis - neck))
    left = place["left_acromion"] - place["right_acromion"]
    left = unit(across(left, down))
    ahead = place["notch"] - place["c7"]
    left = either(left, unit(np.cross(ahead, down)))
    return {"neck": neck}, down, left


def _shoulders(place: _Landmarks, down: np.ndarray, widths: Widths) -> dict[str, np.ndarray]:
    return {
        f"{side}_shoulder": place[f"{side}_acromion"] + widths.shoulder * down for side in SIDES
    }


def _head(place: _Landmarks) -> dict[str, np.ndarray]:
    """Return base and top of the head, and where the nose points."""
    front, back = place.middle("head_front"), place.middle("head_back")
    ahead = unit(front - back)
    left = place["left_head_front"] + place["left_head_back"]
    left = left - place["right_head_front"] - place["right_head_back"]
    up = np.cross(ahead, unit(across(left, ahead)))
    middle = (front + back) / 2
    base = middle - 0.09 * up - 0.01 * ahead
    return {"head": base, "head_top": middle + 0.10 * up, "nose": base + 0.12 * ahead}


def _arm(
    side: str,
    out: float,
    place: _Landmarks,
    shoulder: np.ndarray,
    trunk: tuple[np.ndarray, np.ndarray],
    widths: Widths,
) -> dict[str, np.ndarray]:
    left, down = trunk
    pair = (f"{side}_wrist_thumb", f"{side}_wrist_small")
    thumb, small = (place[name] for name in pair)
    # While one of two is lost, the other is 3 cm beside the joint, and it is not known where.
    wrist = (thumb + small) / 2 if all(name in place for name in pair) else either(thumb, small)
    outer, inner = place[f"{side}_outer_elbow"], place[f"{side}_inner_elbow"]
    # The forearm bends to the front of the arm: across both is the axis. It is taken by the marker
    # and not by the joint below it, as Plug-in Gait does; that is off where the arm is straighter.
    upper, fore = unit(outer - shoulder), unit(wrist - outer)
    aside = _axis(-out * np.cross(upper, fore), _carried(out * left, down, upper), upper)
    elbow = either((outer + inner) / 2, inside(shoulder, outer, aside, widths.elbow))
    # Hands: the marker is on their back.
    radial = thumb - small
    hand = place[f"{side}_hand"]
    dorsal = unit(np.cross(hand - wrist, radial)) * -out
    knuckles = hand - widths.hand * dorsal
    along = unit(either(knuckles - wrist, wrist - elbow))
    radial = unit(across(radial, along))
    turned = np.cos(THUMB) * radial + out * np.sin(THUMB) * np.cross(along, radial)
    return {
        f"{side}_elbow": elbow,
        f"{side}_wrist": wrist,
        f"{side}_knuckles": either(knuckles, wrist + 0.08 * along),
        f"{side}_thumb": wrist + 0.05 * turned,
    }


def _leg(
    side: str,
    out: float,
    place: _Landmarks,
    hip: np.ndarray,
    left: np.ndarray,
    widths: Widths,
) -> dict[str, np.ndarray]:
    knee, ankle = place[f"{side}_outer_knee"], place[f"{side}_outer_ankle"]
    # The shank bends to the back of the thigh.
    both = (ankle + place[f"{side}_inner_ankle"]) / 2
    bent, aside = _knee(hip, knee, (ankle, both), out * left, widths, out)
    shown = _shown(hip, knee, place[f"{side}_thigh"])
    inner = place[f"{side}_inner_knee"]
    middle = either((knee + inner) / 2, inside(hip, knee, shown, widths.knee), bent)
    aside = either(shown, aside)
    aside = either(knee - middle, aside)
    aside = either(_shown(middle, ankle, place[f"{side}_shank"]), aside)
    low = either(both, inside(middle, ankle, aside, widths.ankle))
    return {
        f"{side}_knee": middle,
        f"{side}_ankle": low,
        f"{side}_toe": place[f"{side}_forefoot"],
    }


def _knee(
    hip: np.ndarray,
    marker: np.ndarray,
    ankle: tuple[np.ndarray, np.ndarray],
    usual: np.ndarray,
    widths: Widths,
    out: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the knee by its marker and its bend (n, 3), and where its outside is.

    The axis is across both bones, and these end in the knee: a few rounds find both.

    Args:
        hip: where the thigh begins (n, 3).
        marker: on the outside of the knee.
        ankle: marker on its outside, and the joint where both its sides have one.
        usual: the outside while the leg is straight and does not show it.
        widths: of the person.
        out: sign of the outside along the cross product of both bones.
    """
    aside, knee = usual, marker
    for _ in range(_ROUNDS):
        knee = inside(hip, marker, aside, widths.knee)
        end = either(ankle[1], inside(knee, ankle[0], aside, widths.ankle))
        thigh, shank = unit(knee - hip), unit(end - knee)
        aside = _axis(out * np.cross(thigh, shank), usual, thigh)
    return knee, aside


def _axis(shown: np.ndarray, usual: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Return where the outside is (n, 3): as the bend shows it, the usual one while it is straight.

    Args:
        shown: across both bones, as long as the bend shows.
        usual: the outside of the trunk.
        along: the bone.
    """
    size = np.linalg.norm(shown, axis=1, keepdims=True)
    share = np.clip((size - _BENT[0]) / (_BENT[1] - _BENT[0]), 0, 1)
    usual = unit(across(usual, along))
    both = share * shown / np.where(size > 0, size, 1) + (1 - share) * usual
    return either(unit(both), usual)


def _carried(aside: np.ndarray, down: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Return where the outside of a hanging bone is when it is raised, not turned about itself."""
    below = np.maximum(1 + dot(down, along), 0.1)
    raised = aside - dot(aside, along) / below * (down + along)
    return either(raised, aside)


def _shown(origin: np.ndarray, end: np.ndarray, beside: np.ndarray) -> np.ndarray:
    """Return where the outside is by a marker beside a bone (n, 3); NaN if it is too near."""
    along = unit(end - origin)
    away = beside - origin
    away = across(away, along)
    far = np.linalg.norm(away, axis=1, keepdims=True) > _OUTSIDE
    return np.where(far, unit(away), np.nan)
