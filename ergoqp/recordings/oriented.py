"""Points from the orientations of segments, such as the nose and the thumb.

In a skeleton whose axes are known (`ergoqp.recordings.namings.toml`, ``turned``) they determine the
turn of the head, the hands and the forearms. If the axes are unknown, the head is assumed to face
ahead of the trunk in the median over the recording.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from ergoqp.recordings.motion import JointMotion
from ergoqp.recordings.naming import Naming

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
    from scipy.spatial.transform import Rotation

    result = np.full((len(turns), 3), np.nan)
    vectors = np.broadcast_to(vectors, result.shape)
    seen = np.isfinite(turns).all(axis=1) & (np.abs(turns) > _NONE).any(axis=1)
    if seen.any():
        result[seen] = Rotation.from_quat(turns[seen]).apply(vectors[seen], inverse=back)
    return result
