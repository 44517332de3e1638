"""Angles of arms and legs from the directions of their bones, in closed form.

A limb's first bone gives flexion and abduction of the joint that it hangs from. The next bone gives
the rotation about the first and the bend between both. Directions are given in the axes of the
segment that the limb hangs from: x forward, y left, z up. A hanging limb points down.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from ergoqp.joints import INDEX, LOWER, UPPER
from ergoqp.recordings.fitting.branches import both_ways, chosen, near
from ergoqp.recordings.fitting.steady import filled, steady

Angles = dict[str, np.ndarray]
"""Joint, without its side -> angles (n,) [rad], or whether they are determined (n,) bool."""

_TOE: Final = 0.01
"""Weight of the foot in the thigh's rotation, relative to a knee that is bent by 90 degrees."""
THUMB: Final = np.arctan2(0.02, 0.05)
"""Angle by which the thumb of `models/human.xml` is turned inward about the hand [rad]."""


def arm_angles(
    side: str,
    upper_arm: np.ndarray,
    forearm: np.ndarray,
    hand: np.ndarray,
    thumb: np.ndarray,
    time: np.ndarray,
    begin: bool | None = None,
) -> tuple[Angles, Angles, np.ndarray]:
    """Return the angles of an arm, which of them are determined, and which triple is chosen.

    The latter two are (n,) bool; for the last see `ergoqp.recordings.fitting.branches`.

    Args:
        side: ``right`` or ``left``.
        upper_arm: from shoulder to elbow in the axes of the trunk (n, 3); NaN where not seen, here
            and below.
        forearm: from elbow to wrist (n, 3).
        hand: from wrist to knuckles (n, 3).
        thumb: from wrist to thumb (n, 3).
        time: times of the frames (n,) [s].
        begin: whether the second triple is chosen at first; None: unknown.
    """
    out, upper_arm = _out(side), _unit(upper_arm)
    forearm = _beyond(upper_arm, forearm)
    hand = _beyond(forearm, hand)
    lower, upper = _range(side, "shoulder_flexion", "shoulder_abduction", "shoulder_rotation")
    forward, aside, up = upper_arm.T
    bend = _between(upper_arm, forearm)

    held = np.stack([np.arctan2(forward, -up), np.arcsin(np.clip(out * aside, -1, 1))], axis=1)
    turn = _turn(forearm, held, out)
    shows = np.stack([np.hypot(forward, up), np.ones_like(up), np.sin(bend)], axis=1)
    ways = both_ways(np.column_stack([held, turn]), lower, upper)
    second = chosen(ways, np.nan_to_num(shows), lower, upper, time, begin)
    flexion = np.where(second, ways[1][:, 0], ways[0][:, 0])
    # The angle jumps where the other triple is chosen, or where it wraps by a whole turn.
    leaps = np.diff(second) | (np.abs(np.diff(flexion)) > 1.2 * np.pi)
    flexion = steady(flexion, shows[:, 0], time, leaps)
    flexion = np.clip(flexion, lower[0], upper[0])
    # Abduction and rotation are recomputed for this flexion, so that the arm's direction is kept.
    along = np.sin(flexion) * forward - np.cos(flexion) * up
    abduction = near(np.arctan2(out * aside, along), lower[1], upper[1])
    held = np.stack([flexion, np.clip(filled(abduction, time), lower[1], upper[1])], axis=1)
    turn = near(_turn(forearm, held, out), lower[2], upper[2])
    turn = steady(turn, shows[:, 2], time, leaps)
    rotation = np.clip(turn, lower[2], upper[2])
    elbow = np.clip(filled(bend, time), *_range(side, "elbow_flexion"))

    axes = _hanging(held, out) * Rotation.from_euler("ZY", np.stack([-out * rotation, -elbow], 1))
    wrist, told = _wrist_angles(side, axes.inv().apply(hand), axes.inv().apply(thumb), time)
    arm, fore = np.isfinite(up), np.isfinite(bend)
    return (
        {
            "shoulder_flexion": flexion,
            "shoulder_abduction": held[:, 1],
            "shoulder_rotation": rotation,
            "elbow_flexion": elbow,
        }
        | wrist,
        {
            "shoulder_flexion": arm,
            "shoulder_abduction": arm,
            "shoulder_rotation": fore,
            "elbow_flexion": fore,
        }
        | told,
        second,
    )


def leg_angles(
    side: str,
    thigh: np.ndarray,
    shank: np.ndarray,
    foot: np.ndarray,
    sole: np.ndarray,
    time: np.ndarray,
) -> tuple[Angles, Angles]:
    """Return the angles of a leg, and which of them the recording determines (n,) bool.

    Args:
        side: ``right`` or ``left``.
        thigh: from hip to knee in the upright axes of the pelvis (n, 3); NaN where not seen, here
            and below.
        shank: from knee to ankle (n, 3).
        foot: from ankle to toe (n, 3).
        sole: from ankle to toe of the person's own foot, in its axes (3,).
        time: times of the frames (n,) [s].
    """
    out, thigh = _out(side), _unit(thigh)
    shank = _beyond(thigh, shank)
    foot = _beyond(shank, foot)
    lower, upper = _range(side, "hip_flexion", "hip_abduction", "hip_rotation")
    forward, aside, up = thigh.T
    bend = _between(thigh, shank)
    flexion = steady(np.arctan2(forward, -up), np.hypot(forward, up), time)
    held = np.stack([flexion, filled(np.arcsin(np.clip(out * aside, -1, 1)), time)], axis=1)
    held = np.clip(held, lower[:2], upper[:2])
    # The shank determines the rotation of a bent leg, the foot that of a straight one.
    back, toes = _hanging(held, out).inv().apply(shank), _hanging(held, out).inv().apply(foot)
    ahead = -np.sin(bend)[:, None] * back[:, :2]
    ahead += np.nan_to_num(_TOE * np.maximum(np.cos(bend), 0)[:, None] * toes[:, :2])
    turn = np.arctan2(-out * ahead[:, 1], ahead[:, 0])
    turn = steady(turn, np.sqrt(np.linalg.norm(ahead, axis=1)), time)
    rotation = np.clip(turn, lower[2], upper[2])
    knee = np.clip(filled(bend, time), *_range(side, "knee_flexion"))

    axes = _hanging(held, out) * Rotation.from_euler("ZY", np.stack([-out * rotation, knee], 1))
    toes, (length, _, drop) = axes.inv().apply(foot), sole / np.linalg.norm(sole)
    roll = np.arcsin(np.clip(toes[:, 1] / -drop, -1, 1))
    pitch = np.arctan2(toes[:, 2], toes[:, 0]) - np.arctan2(drop * np.cos(roll), length)
    ankle = {"ankle_flexion": pitch, "ankle_inversion": -out * roll}
    leg, fore = np.isfinite(up), np.isfinite(bend)
    toe = np.isfinite(pitch)
    return (
        {
            "hip_flexion": held[:, 0],
            "hip_abduction": held[:, 1],
            "hip_rotation": rotation,
            "knee_flexion": knee,
        }
        | {name: _inside(side, name, each, time) for name, each in ankle.items()},
        {
            "hip_flexion": leg,
            "hip_abduction": leg,
            "hip_rotation": fore,
            "knee_flexion": fore,
            "ankle_flexion": toe,
            "ankle_inversion": toe,
        },
    )


def _wrist_angles(
    side: str, hand: np.ndarray, thumb: np.ndarray, time: np.ndarray
) -> tuple[Angles, Angles]:
    """Return the angles of forearm and wrist; hand and thumb in the axes of the elbow (n, 3)."""
    out = _out(side)
    up = -hand
    beside = _unit(thumb - (thumb * up).sum(axis=1, keepdims=True) * up)
    across = np.cross(up, beside)
    ahead = np.cos(THUMB) * beside + out * np.sin(THUMB) * across
    # The hand's left axis is the axis of deviation, so deviation does not change it.
    left = np.cross(up, ahead)
    pronation = _inside(side, "forearm_pronation", out * np.arctan2(left[:, 0], left[:, 1]), time)
    turned = Rotation.from_euler("Z", -out * pronation[:, None]).inv().apply(hand)
    wrist = {
        "wrist_flexion": -out * np.arctan2(turned[:, 1], -turned[:, 2]),
        "wrist_deviation": -np.arcsin(np.clip(turned[:, 0], -1, 1)),
    }
    seen = np.isfinite(turned[:, 0])
    return (
        {"forearm_pronation": pronation}
        | {name: _inside(side, name, each, time) for name, each in wrist.items()},
        {
            "forearm_pronation": np.isfinite(left[:, 0]),
            "wrist_flexion": seen,
            "wrist_deviation": seen,
        },
    )


def _turn(bone: np.ndarray, held: np.ndarray, out: float) -> np.ndarray:
    """Return the inward rotation of a limb (n,) [rad], from the bone beyond its bend.

    Args:
        bone: direction of that bone (n, 3).
        held: flexion and abduction of the limb (n, 2) [rad].
        out: sign of the outside along y.
    """
    beyond = _hanging(held, out).inv().apply(bone)
    return np.arctan2(-out * beyond[:, 1], beyond[:, 0])


def _hanging(held: np.ndarray, out: float) -> Rotation:
    """Return the axes of a limb with some flexion and abduction (n, 2) [rad]."""
    return Rotation.from_euler("YX", np.nan_to_num(held) * np.array([-1.0, out]))


def _out(side: str) -> float:
    """Return the sign of a side's outside along y."""
    return -1.0 if side == "right" else 1.0


def _range(side: str, *joints: str) -> np.ndarray:
    """Return the ends of the ranges (2, len(joints)) [rad]."""
    numbers = [INDEX[f"{side}_{joint}"] for joint in joints]
    return np.stack([LOWER[numbers], UPPER[numbers]])


def _inside(side: str, joint: str, angles: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return angles with gaps filled and clipped to the range (n,) [rad]."""
    lower, upper = _range(side, joint).ravel()
    return np.clip(filled(near(angles, lower, upper), time), lower, upper)


def _between(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the angle between unit vectors (n, 3), exact also near 0 and pi (n,) [rad]."""
    return np.arctan2(np.linalg.norm(np.cross(one, other), axis=1), (one * other).sum(axis=1))


def _beyond(bone: np.ndarray, following: np.ndarray) -> np.ndarray:
    """Return the directions of the next bone (n, 3); NaN where the first bone is not seen."""
    return np.where(np.isfinite(bone), _unit(following), np.nan)


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Return unit vectors (n, 3); NaN for those without a direction."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(length > 0, length, np.nan)
