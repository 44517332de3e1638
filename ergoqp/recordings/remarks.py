"""What the user of a fitted recording should be told, one sentence each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from ergoqp.joints import INDEX, JOINTS, SIDES, spoken
from ergoqp.recordings.fitting.posture_fit import Fit
from ergoqp.recordings.fitting.validity import BRIDGED, NEEDED

_POOR: Final = 0.06  # m
_FASTEST: Final = 12.0  # m/s: above what a hand reaches in work


def remarks(time: np.ndarray, targets: Mapping[str, np.ndarray], result: Fit) -> list[str]:
    """Return what stands out about a fitted recording.

    Args:
        time: time stamps, shape (n,) [s].
        targets: centre -> positions (n, 3) [m] that the body was fitted to.
        result: what came of it.
    """
    told = np.any(result.observed, axis=0)
    return [
        *_poor(result.error),
        *_leaps(time, targets),
        *_not_scored(result.not_scored),
        *_bridged(result),
        *_unobserved(told),
    ]


def _not_scored(causes: Mapping[str, np.ndarray]) -> list[str]:
    """Say which frames show no posture."""
    if not causes:
        return []
    lacking = np.logical_or.reduce(list(causes.values()))
    counted = ", ".join(f"{cause} {int(frames.sum())}" for cause, frames in causes.items())
    return [f"{int(lacking.sum())} of {len(lacking)} frames are not scored: {counted}."]


def _bridged(result: Fit) -> list[str]:
    """Say where what was lost for a moment is taken from what is around it."""
    lacking = np.logical_or.reduce([np.zeros(len(result.error), bool), *result.not_scored.values()])
    needed = [INDEX[joint] for _, joint, *_ in NEEDED if result.observed[:, INDEX[joint]].any()]
    count = int((~result.observed[:, needed].all(axis=1) & ~lacking).sum())
    if not count:
        return []
    return [
        f"In {count} frames a joint is lost for less than {BRIDGED:g} s: it is taken from what is"
        " around."
    ]


def _poor(error: np.ndarray) -> list[str]:
    """Say when the body looks nothing like the recording, as with a wrong axis or mapping."""
    seen = error[np.isfinite(error)]
    median = float(np.median(seen)) if len(seen) else 0.0
    if median <= _POOR:
        return []
    how = f"The body fits poorly, by {1000 * median:.0f} mm in the median frame"
    return [f"{how}; check the vertical axis, the person and the mapping."]


def _leaps(time: np.ndarray, targets: Mapping[str, np.ndarray]) -> list[str]:
    """Say when frames are too far apart for the stated frame time: calibration poses, keyframes."""
    moved = np.full(len(time) - 1, np.nan)
    for path in targets.values():
        moved = np.fmax(moved, np.linalg.norm(np.diff(path, axis=0), axis=1))
    places = np.flatnonzero(moved > _FASTEST * np.diff(time))
    if not len(places):
        return []
    first = places[0]
    more = f" and at {len(places) - 1} more places" if len(places) > 1 else ""
    return [
        f"Between the frames {first + 1} and {first + 2}{more} a joint moves by"
        f" {moved[places].max():.2f} m at once: a calibration pose, or frames that are not uniform"
        " in time."
    ]


def _unobserved(told: np.ndarray) -> list[str]:
    """List joints held at zero because no centre tells them, and what that means for the wrist."""
    never = [
        spoken(name) for name, is_told in zip(JOINTS, told.tolist(), strict=True) if not is_told
    ]
    if not never:
        return []
    sentences = [f"Not told by the recording and held at zero: {', '.join(never)}."]
    arms = [side for side in SIDES if told[INDEX[f"{side}_shoulder_flexion"]]]
    if len(arms) == 1:
        lost = next(side for side in SIDES if side not in arms)
        sentences.append(
            f"The {lost} arm is scored as if it were hanging: only the other one counts."
        )
    if any(
        told[INDEX[f"{side}_wrist_flexion"]] and not told[INDEX[f"{side}_forearm_pronation"]]
        for side in SIDES
    ):
        sentences.append(
            "The bend of the wrist is shared out between flexion and deviation as if the forearm"
            " were not turned."
        )
    return sentences
