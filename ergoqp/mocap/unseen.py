"""Points that a file does not give: from the orientations of segments, and shoulders from elbows.

Points from the orientations of segments, such as the nose and the thumb. In a skeleton whose axes
are known (``namings.toml``, ``turned``) they determine the turn of the head, the hands
and the forearms. If the axes are unknown, the head is assumed to face ahead of the trunk in the
median over the recording.

Shoulders that were not tracked, from the elbows that circle about them. Handling studies often
track only a few rigid bodies (head, middle of the shoulders, elbows, hands, belt). In the axes of
the body between the shoulders an elbow moves on a sphere whose centre is the shoulder. If an arm
hardly moves, the sphere is hardly determined. The shoulder is then at the side of that body, where
an average person has it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from ergoqp.human import FRACTIONS
from ergoqp.joints import SIDES
from ergoqp.mocap.naming import Naming
from ergoqp.mocap.recording import JointMotion

_FAR: Final = 0.2
"""Distance of the nose from the head [length of the trunk]."""
_SAMPLE: Final = 2000
"""Frames from which lengths and medians are computed, about."""
_NONE: Final = 1e-6
"""A quaternion with no component above this counts as not seen."""
AHEAD: Final = (
    "The head is assumed to face ahead of the trunk in the median over the recording, because the"
    " axes of the head segment are unknown."
)


def oriented(
    motion: JointMotion, naming: Naming, found: Mapping[str, tuple[int, ...]]
) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """Return our centre -> positions (n, 3), for centres that only orientations determine.

    Sentences for the user are returned with them.

    Args:
        motion: the motion with its orientations.
        naming: naming of its joints.
        found: our centre -> indices of its joints.
    """
    added: dict[str, np.ndarray] = {}
    if not motion.turns:
        return added, ()
    long = _trunk(motion, found)
    segments = {centre: (segment,) for centre, (segment, _) in naming.turned.items()}
    for centre, (place,) in Naming(naming.title, segments).found_in(motion.names).items():
        name = motion.names[place]
        if name in motion.turns and centre not in found:
            along = long * np.array(naming.turned[centre][1])
            added[centre] = motion.positions[:, place] + _turned(motion.turns[name], along)
    sides = {"right_shoulder", "left_shoulder", "neck", "head"}
    if "nose" in added or "nose" in found or not sides <= set(found):
        return added, ()
    head = motion.names[found["head"][0]]
    if len(found["head"]) > 1 or head not in motion.turns:
        return added, ()
    every = max(1, len(motion.time) // _SAMPLE)
    right, left, neck = (
        motion.positions[::every, list(found[name])].mean(axis=1)
        for name in ("right_shoulder", "left_shoulder", "neck")
    )
    ahead = np.cross(left - right, neck - _hips(motion, found, every))
    local = _turned(motion.turns[head][::every], ahead, back=True)
    local = local[np.isfinite(local).all(axis=1)]
    middle = np.median(local, axis=0) if len(local) else np.zeros(3)
    if not np.linalg.norm(middle):
        return added, ()
    along = _FAR * long * middle / np.linalg.norm(middle)
    added["nose"] = motion.of(head) + _turned(motion.turns[head], along)
    return added, (AHEAD,)


def _trunk(motion: JointMotion, found: Mapping[str, tuple[int, ...]]) -> float:
    """Return the length of the trunk [file unit]."""
    upper = next(name for name in ("neck", "right_shoulder", "left_shoulder") if name in found)
    every = max(1, len(motion.time) // _SAMPLE)
    one = motion.positions[::every, list(found[upper])].mean(axis=1)
    length = np.linalg.norm(one - _hips(motion, found, every), axis=1)
    return float(np.median(length[np.isfinite(length)])) if np.isfinite(length).any() else 1.0


def _hips(motion: JointMotion, found: Mapping[str, tuple[int, ...]], every: int) -> np.ndarray:
    """Return the pelvis, or the middle of the hips, in every `every`-th frame (n, 3)."""
    names = ("pelvis",) if "pelvis" in found else ("right_hip", "left_hip")
    paths = [
        motion.positions[::every, list(found[name])].mean(axis=1) for name in names if name in found
    ]
    return np.mean(paths, axis=0)


def _turned(turns: np.ndarray, vectors: np.ndarray, back: bool = False) -> np.ndarray:
    """Return vectors (3,) or (n, 3), rotated by quaternions (n, 4) or back.

    NaN where the quaternion is not seen or has no length.
    """
    result = np.full((len(turns), 3), np.nan)
    vectors = np.broadcast_to(vectors, result.shape)
    seen = np.isfinite(turns).all(axis=1) & (np.abs(turns) > _NONE).any(axis=1)
    if seen.any():
        result[seen] = Rotation.from_quat(turns[seen]).apply(vectors[seen], inverse=back)
    return result


_SPHERE_SAMPLE: Final = 3000
"""Frames from which a sphere is found, about."""
_TRUST: Final = 0.15
"""Weight of an average person in the fit of a sphere, relative to that of the frames."""
_ROUNDS: Final = 4
SAID: Final = (
    "The shoulders are not in the recording: each is taken as the centre of the sphere on which its"
    " elbow moves, in the axes of the body between the shoulders, and is the nearer to an average"
    " person's the less the arm moves."
)


def shoulders_of(
    motion: JointMotion, found: Mapping[str, tuple[int, ...]]
) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """Return both shoulders (n, 3), if elbows are tracked and shoulders are not, and a sentence.

    Args:
        motion: the motion with the orientation of the body between the shoulders.
        found: our centre -> indices of its joints.
    """
    needed = {"neck", *(f"{side}_{name}" for side in SIDES for name in ("elbow", "wrist"))}
    if not needed <= set(found) or {"right_shoulder", "left_shoulder"} & set(found):
        return {}, ()
    name = motion.names[found["neck"][0]]
    if len(found["neck"]) > 1 or name not in motion.turns:
        return {}, ()
    at = {
        centre: motion.positions[:, list(found[centre])].astype(float).mean(axis=1)
        for centre in needed
    }
    quaternions, neck = motion.turns[name], at["neck"]
    seen = np.isfinite(quaternions).all(axis=1) & np.isfinite(neck).all(axis=1)
    if not seen.any():
        return {}, ()
    turn = Rotation.from_quat(quaternions[seen])
    every = max(1, int(seen.sum()) // _SPHERE_SAMPLE)
    local = {
        side: turn.apply(at[f"{side}_elbow"][seen] - neck[seen], inverse=True)[::every]
        for side in SIDES
    }
    fore = np.nanmedian(
        [np.linalg.norm(at[f"{s}_wrist"] - at[f"{s}_elbow"], axis=1) for s in SIDES]
    )
    stature = float(fore) / FRACTIONS["forearm"]
    apart = np.nanmedian(local["left"] - local["right"], axis=0)
    left = apart / np.linalg.norm(apart)
    shoulders = {}
    for side, out in zip(SIDES, (-1.0, 1.0), strict=True):
        usual = out * FRACTIONS["shoulder_width"] * stature / 2 * left
        place = _middle(local[side], usual, FRACTIONS["upper_arm"] * stature)
        path = np.full_like(neck, np.nan)
        path[seen] = neck[seen] + turn.apply(place)
        shoulders[f"{side}_shoulder"] = path
    return shoulders, (SAID,)


def _middle(points: np.ndarray, usual: np.ndarray, length: float) -> np.ndarray:
    """Return the centre (3,) of the sphere through points (n, 3), with a pull to the usual one.

    Args:
        points: positions of the elbow, NaN where it is not seen.
        usual: centre in an average person (3,).
        length: length of an average upper arm.
    """
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return usual
    middle, radius = usual, length
    for _ in range(_ROUNDS):
        away = points - middle
        size = np.linalg.norm(away, axis=1, keepdims=True)
        slope = np.column_stack([-away / size, -np.ones(len(away))])
        # Gauss-Newton step on the distances from the sphere, and from an average person.
        weight = np.sqrt(len(points)) * _TRUST
        rows = np.vstack([slope, weight * np.eye(4)])
        miss = np.concatenate(
            [radius - size[:, 0], weight * np.append(usual - middle, length - radius)]
        )
        step = np.linalg.lstsq(rows, miss, rcond=None)[0]
        middle, radius = middle + step[:3], radius + step[3]
    return middle
