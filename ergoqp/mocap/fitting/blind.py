"""Joints whose angle a file of joint angles does not have in some of its frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ergoqp.joints import INDEX, LOWER, UPPER
from ergoqp.mocap.fitting.posture import Fit


def blinded(result: Fit, blind: Mapping[str, np.ndarray]) -> Fit:
    """Return a fit in which some joints are not seen in some frames.

    Args:
        result: the fit, whose angles stay the likeliest ones.
        blind: joint -> the frames in which it is not seen (n,) bool.
    """
    hidden = {INDEX[joint]: frames for joint, frames in blind.items() if frames.any()}
    if not hidden:
        return result
    observed, spans = result.observed.copy(), dict(result.spans)
    for joint, frames in hidden.items():
        observed[frames, joint] = False
        rows = np.flatnonzero(frames).astype(np.int32)
        free = (np.full(len(rows), end[joint], dtype=np.float32) for end in (LOWER, UPPER))
        others = [each[~frames[spans[joint][0]]] for each in spans.get(joint, ())] or [rows[:0]] * 3
        at, low, high = map(np.concatenate, zip((rows, *free), others, strict=True))
        order = np.argsort(at)
        spans[joint] = at[order], low[order], high[order]
    found = replace(result, observed=observed, spans=spans)
    trunk = hidden.get(INDEX["trunk_flexion"])
    if trunk is None:
        return found
    return replace(found, not_scored={"trunk not seen": trunk, **result.not_scored})
