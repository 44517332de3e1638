"""Angles that are seen, but from a part of the body whose own angle is not known.

An arm and a neck are measured from the trunk. If only one shoulder is seen, the trunk may be
twisted against what is read, and they are others. Without hips, the shoulders show the heading, and
the lean of the trunk is shared between flexion and side bend by the twist. A straight arm shows the
sum of the upper arm's rotation and the forearm's pronation. Without a thumb, a bent wrist shows the
root of flexion and deviation.

Every such angle is computed for some values of the unknown one, from its lowest to its highest.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np

from ergoqp.joints import INDEX, LOWER, SIDES, UPPER

Part = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Some frames (k,), and the lower and upper ends of an angle there (k,) [rad]."""

TWIST: Final = INDEX["trunk_twist"]
TURNS: Final = {
    INDEX[f"{side}_shoulder_rotation"]: INDEX[f"{side}_forearm_pronation"] for side in SIDES
}
"""Rotation of an upper arm -> pronation of its forearm."""
_TRIED: Final = 9
"""Number of values of an unknown twist that are tried."""
_PRONATIONS: Final = 36
"""Number of pronations that are tried."""


def by_pronation(postures: np.ndarray, observed: np.ndarray) -> dict[int, Part]:
    """Return the ends of the angles of wrists where the forearm's pronation is not known.

    Args:
        postures: joint angles (n, 32) [rad].
        observed: which of them are seen (n, 32) bool.
    """
    found: dict[int, Part] = {}
    for side in SIDES:
        pronation, flexion, deviation = (
            INDEX[f"{side}_{joint}"]
            for joint in ("forearm_pronation", "wrist_flexion", "wrist_deviation")
        )
        rows = np.flatnonzero(observed[:, flexion] & ~observed[:, pronation])
        if not len(rows):
            continue
        bent, out = postures[rows, flexion], postures[rows, deviation]
        down = np.cos(bent) * np.cos(out)
        ahead, aside = np.sin(bent) * np.cos(out), np.sin(out)
        tried = []
        for turn in np.linspace(LOWER[pronation], UPPER[pronation], _PRONATIONS):
            other = np.arcsin(np.clip(aside * np.cos(turn) - ahead * np.sin(turn), -1, 1))
            both = np.arctan2(ahead * np.cos(turn) + aside * np.sin(turn), down), other
            # Nobody bends a wrist to the side by more than its range.
            can = (other >= LOWER[deviation]) & (other <= UPPER[deviation])
            tried.append([np.where(can, each, np.nan) for each in both])
        for k, joint in enumerate((flexion, deviation)):
            found[joint] = _ends(joint, rows, postures, (each[k] for each in tried))
    return found


def by_rotation(
    rotation: int, span: Part, postures: np.ndarray, observed: np.ndarray
) -> dict[int, Part]:
    """Return the ends of a forearm's pronation where the rotation of the upper arm is not known.

    Args:
        rotation: number of that joint.
        span: its ends.
        postures: joint angles (n, 32) [rad].
        observed: which of them are seen (n, 32) bool.
    """
    pronation, (frames, low, high) = TURNS[rotation], span
    straight = observed[frames, pronation] & ~observed[frames, rotation]
    rows = frames[straight]
    both = postures[rows, rotation] + postures[rows, pronation]
    tried = (both - high[straight], both - low[straight])
    return {pronation: _ends(pronation, rows, postures, tried)}


def by_twist(
    ends: tuple[np.ndarray, np.ndarray],
    postures: np.ndarray,
    observed: np.ndarray,
    pairs: tuple[np.ndarray, np.ndarray],
    turned: np.ndarray,
) -> dict[int, Part]:
    """Return the ends of what depends on the twist of the trunk where that is not known.

    Args:
        ends: its lower and upper ends (n,) [rad].
        postures: joint angles (n, 32) [rad].
        observed: which of them are seen (n, 32) bool.
        pairs: frames in which both hips are seen, and those with both shoulders, each (n,) bool.
        turned: frames in which the whole body may have turned, unseen (n,) bool.
    """
    frames = np.flatnonzero(~observed[:, TWIST] & ((ends[0] < ends[1]) | turned))
    read, free = postures[frames, TWIST], turned[frames]
    low = np.where(free, read - np.pi, ends[0][frames])
    high = np.where(free, read + np.pi, ends[1][frames])
    headed, held = (each[frames] for each in pairs)
    found: dict[int, Part] = {}
    # Without hips, the heading is off by as much as the twist.
    part = ~headed
    rows, turns = frames[part], _tried(read[part] - high[part], read[part] - low[part])
    flexion, bend = (INDEX[f"trunk_{name}"] for name in ("flexion", "side_bend"))
    lean = _leans(postures[rows, flexion], postures[rows, bend], turns)
    for joint, tried in zip((flexion, bend), zip(*lean, strict=True), strict=True):
        found[joint] = _ends(joint, rows, postures, tried)
    # Both shoulders show the axes of the trunk, whatever its heading.
    part = headed | ~held
    rows, turns = frames[part], _tried(low[part] - read[part], high[part] - read[part])
    flexion, bend, twist = (INDEX[f"neck_{name}"] for name in ("flexion", "side_bend", "twist"))
    lean = _leans(postures[rows, flexion], postures[rows, bend], turns)
    for joint, tried in zip((flexion, bend), zip(*lean, strict=True), strict=True):
        found[joint] = _ends(joint, rows, postures, tried)
    found[twist] = _ends(twist, rows, postures, (postures[rows, twist] - turn for turn in turns))
    for side, out in zip(SIDES, (-1.0, 1.0), strict=True):
        joints = [INDEX[f"{side}_shoulder_{name}"] for name in ("flexion", "abduction", "rotation")]
        arms = _turned_arms(postures[rows][:, joints], turns, out)
        for k, joint in enumerate(joints):
            found[joint] = _ends(joint, rows, postures, (each[:, k] for each in arms))
    return {joint: part for joint, part in found.items() if len(part[0])}


def _tried(low: np.ndarray, high: np.ndarray) -> list[np.ndarray]:
    """Return some angles from lower to upper ends, each (k,) [rad]."""
    return [low + share * (high - low) for share in np.linspace(0, 1, _TRIED)]


def _ends(joint: int, rows: np.ndarray, postures: np.ndarray, tried: Iterable[np.ndarray]) -> Part:
    """Return the ends of what is read of an angle and of other values (k,), within its range."""
    low = high = postures[rows, joint]
    for other in tried:
        low, high = np.fmin(low, other), np.fmax(high, other)
    low, high = (np.clip(end, LOWER[joint], UPPER[joint]) for end in (low, high))
    return rows, low, high


def _leans(
    flexion: np.ndarray, bend: np.ndarray, turns: Iterable[np.ndarray]
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return flexion and side bend of a bone in axes that are turned about the vertical [rad]."""
    ahead, aside = np.sin(flexion) * np.cos(bend), np.sin(bend)
    up = np.cos(flexion) * np.cos(bend)
    found = []
    for turn in turns:
        left = np.clip(np.cos(turn) * aside - np.sin(turn) * ahead, -1, 1)
        found.append((np.arctan2(np.cos(turn) * ahead + np.sin(turn) * aside, up), np.arcsin(left)))
    return found


def _turned_arms(read: np.ndarray, turns: Iterable[np.ndarray], out: float) -> list[np.ndarray]:
    """Return flexion, abduction and rotation (k, 3) [rad] in axes of the trunk that are turned.

    Args:
        read: what is read of them (k, 3) [rad].
        turns: angles about the trunk, each (k,) [rad].
        out: sign of the outside along y.
    """
    flexion, abduction, rotation = read.T
    ahead, aside = _axes(flexion, abduction, out)
    arm = np.cross(aside, ahead)
    bent = np.cos(rotation)[:, None] * ahead - out * np.sin(rotation)[:, None] * aside
    found = []
    for turn in turns:
        x, y, z = about_up(arm, turn).T
        swung, raised = np.arctan2(x, -z), np.arcsin(np.clip(out * y, -1, 1))
        ahead, aside = _axes(swung, raised, out)
        beyond = about_up(bent, turn)
        across, along = ((beyond * axis).sum(axis=1) for axis in (aside, ahead))
        one = np.stack([swung, raised, np.arctan2(-out * across, along)], axis=1)
        # Of the two triples that give the same arm, the one that is nearer to what is read.
        near = [
            (each - read + np.pi) % (2 * np.pi) - np.pi
            for each in (one, np.pi + one * [1.0, -1.0, 1.0])
        ]
        second = np.abs(near[1]).sum(axis=1) < np.abs(near[0]).sum(axis=1)
        found.append(read + np.where(second[:, None], near[1], near[0]))
    return found


def _axes(flexion: np.ndarray, abduction: np.ndarray, out: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the forward and the left axis of an arm without rotation (k, 3)."""
    aside = out * abduction
    forward = np.stack([np.cos(flexion), 0 * flexion, np.sin(flexion)], axis=1)
    left = [-np.sin(flexion) * np.sin(aside), np.cos(aside), np.cos(flexion) * np.sin(aside)]
    return forward, np.stack(left, axis=1)


def about_up(vectors: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Return vectors (k, 3) in axes that are turned about z (k,) [rad]."""
    x, y, z = vectors.T
    return np.stack(
        [np.cos(turn) * x + np.sin(turn) * y, np.cos(turn) * y - np.sin(turn) * x, z], 1
    )
