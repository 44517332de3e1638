"""Sentences for the user about a fitted recording."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from ergoqp.joints import INDEX, JOINTS, SIDES, spoken
from ergoqp.recordings.fitting.posture_fit import Fit
from ergoqp.recordings.fitting.validity import BRIDGED, NEEDED

_POOR: Final = 0.06  # m
_FASTEST: Final = 12.0  # m/s: faster than a hand at work


def remarks(time: np.ndarray, targets: Mapping[str, np.ndarray], result: Fit) -> list[str]:
    """Return sentences about what is unusual in a fitted recording.

    Args:
        time: time stamps, shape (n,) [s].
        targets: centre -> positions (n, 3) [m] that the body was fitted to.
        result: result of the fit.
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
    """Return a sentence with the numbers of frames that are not scored, per cause."""
    if not causes:
        return []
    lacking = np.logical_or.reduce(list(causes.values()))
    counted = ", ".join(f"{cause} {int(frames.sum())}" for cause, frames in causes.items())
    return [f"{int(lacking.sum())} of {len(lacking)} frames are not scored: {counted}."]


def _bridged(result: Fit) -> list[str]:
    """Return a sentence with the number of scored frames that have an interpolated joint."""
    lacking = np.logical_or.reduce([np.zeros(len(result.error), bool), *result.not_scored.values()])
    needed = [INDEX[joint] for _, joint, *_ in NEEDED if result.observed[:, INDEX[joint]].any()]
    count = int((~result.observed[:, needed].all(axis=1) & ~lacking).sum())
    if not count:
        return []
    return [
        f"In {count} frames a joint is lost for less than {BRIDGED:g} s: it is interpolated from"
        " the frames around."
    ]


def _poor(error: np.ndarray) -> list[str]:
    """Return a sentence if the body is far from the recording, as with a wrong axis or mapping."""
    seen = error[np.isfinite(error)]
    median = float(np.median(seen)) if len(seen) else 0.0
    if median <= _POOR:
        return []
    how = f"The body fits poorly, with an error of {1000 * median:.0f} mm in the median frame"
    return [f"{how}; check the vertical axis, the person and the mapping."]


def _leaps(time: np.ndarray, targets: Mapping[str, np.ndarray]) -> list[str]:
    """Return a sentence if a centre moves too fast for the frame time (calibration, keyframes)."""
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
        f" {moved[places].max():.2f} m at once: this is a calibration pose, or the frames are not"
        " uniform in time."
    ]


def _unobserved(told: np.ndarray) -> list[str]:
    """Return sentences about joints that no centre determines, and what follows for the score."""
    never = [
        spoken(name) for name, is_told in zip(JOINTS, told.tolist(), strict=True) if not is_told
    ]
    if not never:
        return []
    sentences = [f"Not determined by the recording and set to zero: {', '.join(never)}."]
    arms = [side for side in SIDES if told[INDEX[f"{side}_shoulder_flexion"]]]
    if len(arms) == 1:
        lost = next(side for side in SIDES if side not in arms)
        sentences.append(
            f"The {lost} arm is not seen and is scored as hanging, so only the other arm counts."
        )
    if any(
        told[INDEX[f"{side}_wrist_flexion"]] and not told[INDEX[f"{side}_forearm_pronation"]]
        for side in SIDES
    ):
        sentences.append(
            "The bend of the wrist is split into flexion and deviation as if the forearm were not"
            " rotated."
        )
    return sentences
