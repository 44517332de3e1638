"""Shoulders that were not tracked, from the elbows that circle about them.

Handling studies often track only a few rigid bodies (head, middle of the shoulders, elbows, hands,
belt). In the axes of the body between the shoulders an elbow moves on a sphere whose centre is the
shoulder. If an arm hardly moves, the sphere is hardly determined. The shoulder is then at the side
of that body, where an average person has it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from ergoqp.human import FRACTIONS
from ergoqp.joints import SIDES
from ergoqp.recordings.motion import JointMotion

_SAMPLE: Final = 3000
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
    from scipy.spatial.transform import Rotation

    at = {
        centre: motion.positions[:, list(found[centre])].astype(float).mean(axis=1)
        for centre in needed
    }
    quaternions, neck = motion.turns[name], at["neck"]
    seen = np.isfinite(quaternions).all(axis=1) & np.isfinite(neck).all(axis=1)
    if not seen.any():
        return {}, ()
    turn = Rotation.from_quat(quaternions[seen])
    every = max(1, int(seen.sum()) // _SAMPLE)
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
