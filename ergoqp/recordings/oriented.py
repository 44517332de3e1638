"""Orientations of segments as points: where the nose points, and the thumb.

A skeleton whose axes are known (`ergoqp.recordings.namings.toml`, ``turned``) shows by them how the
head is turned, and hand and forearm. Of one whose axes are not known it is taken that the head
looks ahead of the trunk in the median over the take.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from ergoqp.recordings.motion import JointMotion
from ergoqp.recordings.names import squashed
from ergoqp.recordings.naming import Naming

_FAR: Final = 0.2
"""How far before the head the nose is put, as a share of the length of the trunk."""
_SAMPLE: Final = 2000
"""Frames by which lengths and medians are found."""
AHEAD: Final = (
    "The head is taken to look ahead of the trunk in the median over the recording: how its axes"
    " lie in it is not known."
)


def oriented(
    motion: JointMotion, naming: Naming, found: Mapping[str, tuple[int, ...]]
) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """Return our centre -> positions (n, 3) of what orientations show and no joint does.

    Sentences that its user should know come with them.

    Args:
        motion: with its orientations.
        naming: of its joints.
        found: our centre -> places of its joints.
    """
    added: dict[str, np.ndarray] = {}
    if not motion.turns:
        return added, ()
    long = _trunk(motion, found)
    names = {squashed(name): name for name in motion.turns}
    for centre, (segment, along) in naming.turned.items():
        name = names.get(squashed(segment))
        if name is not None and name in motion.names and centre not in found:
            added[centre] = motion.of(name) + long * _turned(motion.turns[name], np.array(along))
    sides = {"right_shoulder", "left_shoulder", "neck", "head"}
    if "nose" in added or "nose" in found or not sides <= set(found):
        return added, ()
    head = motion.names[found["head"][0]]
    if len(found["head"]) > 1 or head not in motion.turns:
        return added, ()
    right, left, neck, hips = (
        motion.positions[:, list(found[name])].mean(axis=1)
        for name in ("right_shoulder", "left_shoulder", "neck", _hips(found))
    )
    ahead = np.cross(left - right, neck - hips)
    every = max(1, len(ahead) // _SAMPLE)
    local = np.nanmedian(_turned(motion.turns[head][::every], ahead[::every], back=True), axis=0)
    if not np.isfinite(local).all() or not np.linalg.norm(local):
        return added, ()
    along = _FAR * local / np.linalg.norm(local)
    added["nose"] = motion.of(head) + long * _turned(motion.turns[head], along)
    return added, (AHEAD,)


def _trunk(motion: JointMotion, found: Mapping[str, tuple[int, ...]]) -> float:
    """Return how long the trunk is [file unit]."""
    upper = next(name for name in ("neck", "right_shoulder", "left_shoulder") if name in found)
    every = max(1, len(motion.time) // _SAMPLE)
    one, other = (
        motion.positions[::every, list(found[name])].mean(axis=1) for name in (upper, _hips(found))
    )
    length = np.linalg.norm(one - other, axis=1)
    return float(np.median(length[np.isfinite(length)])) if np.isfinite(length).any() else 1.0


def _hips(found: Mapping[str, tuple[int, ...]]) -> str:
    return next(name for name in ("pelvis", "right_hip", "left_hip") if name in found)


def _turned(turns: np.ndarray, vectors: np.ndarray, back: bool = False) -> np.ndarray:
    """Return vectors (3,) or (n, 3), turned by quaternions (n, 4) or back; NaN: one is lost."""
    from scipy.spatial.transform import Rotation

    result = np.full((len(turns), 3), np.nan)
    vectors = np.broadcast_to(vectors, result.shape)
    seen = np.isfinite(turns).all(axis=1)
    if seen.any():
        result[seen] = Rotation.from_quat(turns[seen]).apply(vectors[seen], inverse=back)
    return result
