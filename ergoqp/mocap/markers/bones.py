"""Landmarks, widths of joints, and bones with one marker beside them.

Of such a bone: its lower joint, and the axis about which that bends.

All directions are unit vectors (n, 3), and NaN means not seen.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from ergoqp.mocap.fitting.posture import unit
from ergoqp.mocap.fitting.standins import either

BENT: Final = (np.sin(np.radians(10)), np.sin(np.radians(25)))
"""Sines of the bends up to which a limb does not show its axis, and from which it does fully."""
WORN: Final = (np.sin(np.radians(15)), np.sin(np.radians(30)))
"""The same where a marker beside the bone shows it better than the trunk does. The marker outside a
straight elbow shows a bend of up to 17 deg."""
_OUTSIDE: Final = 0.01
"""Least distance from a bone's line at which a marker shows the bone's rotation [m]."""
_FEW: Final = 10
"""Least number of frames in which an elbow is bent enough to show its axis."""


@dataclass(frozen=True)
class Widths:
    """Distances of joints from their markers [m]; markers are 14 mm wide.

    The defaults are adult averages. Measures in the recording replace them.

    Attributes:
        knee: half the knee's width and half a marker.
        ankle: half the ankle's width and half a marker.
        elbow: half the elbow's width and half a marker.
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
        """Return the widths from the measures that Vicon's programs write into a file.

        Args:
            measures: name of a measure, in small letters -> its value [m].
        """
        half, found = 0.007, {}
        for name in ("knee", "ankle", "elbow", "hand"):
            what = "thickness" if name == "hand" else "width"
            sides = [measures.get(f"{side[0]}{name}{what}", 0.0) for side in ("left", "right")]
            if min(sides) > 0:
                found[name] = 0.5 * float(np.mean(sides)) + half
        sides = [measures.get(f"{side}shoulderoffset", 0.0) for side in "lr"]
        if min(sides) > 0:
            found["shoulder"] = float(np.mean(sides)) + half
        # Widths that cannot be those of a person are typing errors.
        return cls(**{name: w for name, w in found.items() if 0.5 < w / getattr(cls, name) < 2.0})


class Landmarks(dict[str, np.ndarray]):
    """Landmarks; a missing one is NaN everywhere."""

    def __missing__(self, name: str) -> np.ndarray:
        """Return NaN for each frame (n, 3)."""
        return np.full_like(next(iter(self.values())), np.nan)

    def middle(self, name: str) -> np.ndarray:
        """Return the middle between both sides."""
        return (self[f"right_{name}"] + self[f"left_{name}"]) / 2


def inside(origin: np.ndarray, marker: np.ndarray, aside: np.ndarray, by: float) -> np.ndarray:
    """Return the joint below a marker (n, 3), perpendicular to the bone from `origin` to it.

    Args:
        origin: start of the bone (n, 3).
        marker: marker on the outside of the joint (n, 3).
        aside: outward direction (n, 3).
        by: distance of the joint inside the marker.
    """
    length = np.linalg.norm(marker - origin, axis=1, keepdims=True)
    along = unit(marker - origin)
    aside = unit(across(aside, along))
    sine = np.where(length > by, by / np.where(length > 0, length, 1), np.nan)
    cosine = np.sqrt(1 - sine**2)
    return origin + length * cosine * (cosine * along - sine * aside)


def across(vectors: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Return the components of vectors perpendicular to unit axes (n, 3)."""
    return vectors - dot(vectors, axes) * axes


def dot(vectors: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Return the components of vectors along unit axes (n, 1)."""
    return (vectors * axes).sum(axis=1, keepdims=True)


def axis_of(
    shown: np.ndarray, usual: np.ndarray, along: np.ndarray, bent: tuple[float, float]
) -> np.ndarray:
    """Return the outward direction (n, 3): from the bend, or the usual one while it is straight.

    Args:
        shown: cross product of both bones, whose length is the sine of the bend.
        usual: usual outward direction.
        along: direction of the bone.
        bent: sines between which the bend is used more and more.
    """
    size = np.linalg.norm(shown, axis=1, keepdims=True)
    share = np.clip((size - bent[0]) / (bent[1] - bent[0]), 0, 1)
    usual = unit(across(usual, along))
    both = share * shown / np.where(size > 0, size, 1) + (1 - share) * usual
    return either(unit(both), usual)


def carried(aside: np.ndarray, down: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Return the outward direction of a hanging bone after it is raised without axial rotation."""
    below = np.maximum(1 + dot(down, along), 0.1)
    raised = aside - dot(aside, along) / below * (down + along)
    return either(raised, aside)


def aside_of(origin: np.ndarray, end: np.ndarray, beside: np.ndarray) -> np.ndarray:
    """Return the outward direction by a marker beside a bone (n, 3); NaN if it is too near."""
    along = unit(end - origin)
    away = beside - origin
    away = across(away, along)
    far = np.linalg.norm(away, axis=1, keepdims=True) > _OUTSIDE
    return np.where(far, unit(away), np.nan)


def turn_of(bend: np.ndarray, beside: np.ndarray, along: np.ndarray) -> float | None:
    """Return the angle about an upper arm from a marker beside it to the axis of the elbow [rad].

    Both turn with the bone, so the angle is the same in every frame. It is None if the elbow is
    bent in too few.

    Args:
        bend: outward cross product of both bones, as long as the sine of the bend (n, 3).
        beside: outward direction by the marker (n, 3).
        along: direction of the upper arm (n, 3).
    """
    size = np.linalg.norm(bend, axis=1)
    rows = np.isfinite(beside[:, 0]) & (size > WORN[1])
    if rows.sum() < _FEW:
        return None
    # A carrying angle turns the axis that the bend shows the less, the larger its sine is.
    weighted, beside = size[rows, None] * bend[rows], beside[rows]
    sine, cosine = (np.cross(beside, weighted) * along[rows]).sum(), (beside * weighted).sum()
    return float(np.arctan2(sine, cosine))


def turned_about(along: np.ndarray, aside: np.ndarray, turn: float) -> np.ndarray:
    """Return directions perpendicular to a bone (n, 3), turned about it by an angle [rad]."""
    return np.cos(turn) * aside + np.sin(turn) * np.cross(along, aside)
