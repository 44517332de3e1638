"""Elbow and hand from the markers of an arm.

An elbow with two markers is between them. With one, it is beside that marker, in the direction of
the axis about which the elbow bends. The bend shows this axis, and while the arm is straighter, a
marker on the upper arm does: the angle about the bone between both is the same all the time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from ergoqp.mocap.fitting.posture import THUMB, unit
from ergoqp.mocap.fitting.standins import either
from ergoqp.mocap.markers.bones import (
    BENT,
    WORN,
    Landmarks,
    Widths,
    across,
    aside_of,
    axis_of,
    carried,
    dot,
    inside,
    turn_of,
    turned_about,
)

_BARE: Final = (
    "An elbow with one marker is taken to bend about the axis that this marker shows, as in"
    " Plug-in Gait"
)
_STRAIGHT: Final = (
    ": if the arm is bent by less than 25 deg, the elbow may be off by 12 deg and the upper arm's"
    " rotation by 15 deg."
)
_WORN: Final = "; if the arm is bent by less than 30 deg, about the axis by the upper arm's marker"
_AS_BENT: Final = f"{_WORN}, which is calibrated where the arm is bent more."
_OUTSIDE: Final = (
    f"{_WORN}, which is taken to be on the outside: the upper arm may be off by 6 deg."
)


def wrist_of(side: str, place: Landmarks) -> np.ndarray:
    """Return the wrist (n, 3)."""
    pair = (f"{side}_wrist_thumb", f"{side}_wrist_small")
    thumb, small = (place[name] for name in pair)
    # If one of two is lost, the wrist is lost: the other is 3 cm from it in an unknown direction.
    return (thumb + small) / 2 if all(name in place for name in pair) else either(thumb, small)


def bend_of(side: str, place: Landmarks, shoulder: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the outward cross product of upper arm and forearm, and the upper arm (n, 3).

    The axis is perpendicular to both. As in Plug-in Gait, the marker is used for it and not the
    joint below. With a carrying angle of 10 deg the marker is in the plane in which the wrist
    moves, and this is exact; with one of another size the axis is turned the more the straighter
    the arm is.
    """
    outer = place[f"{side}_outer_elbow"]
    upper, fore = unit(outer - shoulder), unit(wrist_of(side, place) - outer)
    return np.cross(upper, fore) * (1.0 if side == "right" else -1.0), upper


def arm_of(
    side: str,
    out: float,
    place: Landmarks,
    shoulder: np.ndarray,
    trunk: tuple[np.ndarray, np.ndarray],
    widths: Widths,
    turn: float | None,
) -> dict[str, np.ndarray]:
    """Return elbow and hand (n, 3)."""
    left, down = trunk
    thumb, small = place[f"{side}_wrist_thumb"], place[f"{side}_wrist_small"]
    wrist = wrist_of(side, place)
    outer, inner = place[f"{side}_outer_elbow"], place[f"{side}_inner_elbow"]
    bend, upper = bend_of(side, place, shoulder)
    beside = aside_of(shoulder, outer, place[f"{side}_upper_arm"])
    # Without bent frames the marker is taken to be on the outside.
    worn = axis_of(bend, turned_about(upper, beside, turn or 0.0), upper, WORN)
    aside = either(worn, axis_of(bend, carried(out * left, down, upper), upper, BENT))
    elbow = either((outer + inner) / 2, inside(shoulder, outer, aside, widths.elbow))
    # The marker of the hand is on its back.
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
        f"{side}_knuckles": knuckles,
        f"{side}_thumb": wrist + 0.05 * turned,
    }


def carrying_of(side: str, place: Landmarks, centres: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the angle about the upper arm from the elbow's bend to its axis (n,) [rad].

    The axis is that of two markers, and the bend is that of the bones. The angle is that by which a
    carrying angle feigns a rotation; zero if it is not shown.
    """
    shoulder, elbow = centres[f"{side}_shoulder"], centres[f"{side}_elbow"]
    upper, fore = unit(elbow - shoulder), unit(centres[f"{side}_wrist"] - elbow)
    bend = np.cross(upper, fore) * (1.0 if side == "right" else -1.0)
    axis = across(place[f"{side}_outer_elbow"] - place[f"{side}_inner_elbow"], upper)
    sine, cosine = dot(np.cross(bend, axis), upper), dot(bend, axis)
    return np.nan_to_num(np.arctan2(sine, cosine)[:, 0])


def turn_to_axis(side: str, place: Landmarks, shoulder: np.ndarray) -> float | None:
    """Return the angle about the upper arm from its marker to the elbow's axis [rad].

    It is None if the elbow is bent in too few frames.
    """
    bend, along = bend_of(side, place, shoulder)
    outer, marker = place[f"{side}_outer_elbow"], place[f"{side}_upper_arm"]
    return turn_of(bend, aside_of(shoulder, outer, marker), along)


def axes_said(
    bare: Sequence[str], seen: Mapping[str, np.ndarray], turns: Mapping[str, float]
) -> list[str]:
    """Return a sentence about the elbows with one marker; of both sides, the worse is said.

    Args:
        bare: their sides.
        seen: landmark -> positions (n, 3).
        turns: side -> known angle from the upper arm's marker to the axis.
    """
    if not bare:
        return []
    worn = [side for side in bare if f"{side}_upper_arm" in seen]
    if len(worn) < len(bare):
        return [_BARE + _STRAIGHT]
    return [_BARE + (_AS_BENT if all(side in turns for side in worn) else _OUTSIDE)]
