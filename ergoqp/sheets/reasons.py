"""Reasons for the score of a segment, in words."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ergoqp.joints import JOINTS, LOWER, SIDES, UPPER, spoken
from ergoqp.sheets.description import TIE, Segment, StepFunction
from ergoqp.sheets.options import Task


def explain_segment(
    segment: Segment, posture: NDArray[np.float64], task: Task, side: str, score: int
) -> str:
    """Return a sentence that explains the score of a segment.

    An example is ``"neck 24 deg flexion, over 20: 2; twisted left 15 deg: +1"``.

    Args:
        segment: the segment.
        posture: one posture, shape (32,) [rad].
        task: options of this posture, single values.
        side: ``"right"``, ``"left"`` or ``""``.
        score: the exact score. It is named at the end if a clamp changed the sum.
    """
    joint_side = _worse_side(segment, posture) if segment.worse_side else side
    angle = float(posture[segment.joint(segment.base, joint_side)])
    base = segment.base.scores[segment.base.band(angle)]
    if segment.skipped_by is not None and task.flag(segment.skipped_by, side):
        parts = [f"{segment.label(side)} {segment.skipped_by}: {segment.start}"]
        total = segment.start
    else:
        total = segment.start + base
        name = segment.label(side) + (f", {joint_side} knee" if segment.worse_side else "")
        parts = [f"{name} {_amount(segment.base, angle)}, {_band(segment.base, angle)}: {total}"]
    for modifier in segment.modifiers:
        met = []
        for step in modifier.conditions:
            value = float(posture[segment.joint(step, side)])
            if step.scores[step.band(value)]:
                met.append(f"{_word(step, value)} {_magnitude(step, value)} deg")
        if met and not modifier.additive:
            met = [" and ".join(met)]
        parts += [f"{one}: +1" for one in met]
        total += len(met)
    for option in segment.options:
        blocked = option.not_with is not None and bool(task.flag(option.not_with, side))
        if task.flag(option.option, side) and not blocked:
            parts.append(f"{option.words}: {option.points:+d}")
            total += option.points
    if total != score:
        parts.append(f"{'at least' if total < score else 'at most'} {score}: {score - total:+d}")
    return "; ".join(parts).replace("_", " ")


def explain_span(
    segment: Segment, ends: NDArray[np.float64], side: str, low: int, high: int
) -> str:
    """Return a sentence that explains the lowest and the highest score of a segment.

    An example is ``"legs 1 to 3: right knee flexion not known"``.

    Args:
        segment: the segment.
        ends: lower and upper ends of the joint angles (2, 32) [rad].
        side: ``"right"``, ``"left"`` or ``""``.
        low: lowest score.
        high: highest score.
    """
    causes = {}
    for step in segment.steps:
        for each in SIDES if segment.worse_side and step is segment.base else (side,):
            joint = segment.joint(step, each)
            least, most = (int(end(ends[:, joint])) for end in (step.lowest, step.highest))
            if least < most:
                causes[joint] = f"{spoken(JOINTS[joint])} {_known_to(ends[:, joint], joint)}"
    return f"{segment.label(side)} {low} to {high}: {', '.join(causes.values())}".replace("_", " ")


def _known_to(ends: NDArray[np.float64], joint: int) -> str:
    """Return in words what is known of an angle between two ends (2,) [rad]."""
    if ends[0] <= LOWER[joint] + TIE and ends[1] >= UPPER[joint] - TIE:
        return "not known"
    low, high = np.degrees(ends)
    return f"{low:.0f} to {high:.0f} deg"


def _worse_side(segment: Segment, posture: NDArray[np.float64]) -> str:
    def score(side: str) -> int:
        return segment.base.scores[
            segment.base.band(float(posture[segment.joint(segment.base, side)]))
        ]

    return max(SIDES, key=score)


def _amount(step: StepFunction, angle: float) -> str:
    return f"{_magnitude(step, angle)} deg {_word(step, angle)}"


def _word(step: StepFunction, angle: float) -> str:
    return step.words[angle >= 0]


def _magnitude(step: StepFunction, angle: float) -> str:
    """Return the size of an angle with the fewest decimals that keep it in its band.

    This avoids sentences such as "20, over 20".
    """
    degrees = float(np.degrees(angle))
    for decimals in range(9):
        shown = round(degrees, decimals)
        if step.band(float(np.radians(shown))) == step.band(angle):
            return f"{abs(shown):.{decimals}f}"
    return f"{abs(degrees):.9f}"


def _band(step: StepFunction, angle: float) -> str:
    """Return the band of an angle by its ends, in the direction of the angle."""
    band = step.band(angle)
    ends = [-np.inf, *np.degrees(step.edges), np.inf]
    low, high = ends[band], ends[band + 1]
    if high == np.inf:
        return f"over {low:.4g}"
    if low == -np.inf:
        return f"over {-high:.4g}" if high <= 0 else f"under {high:.4g}"
    if high <= 0:
        return f"{-high:.4g} to {-low:.4g}"
    if low < 0:
        both = f"{-low:.4g} {step.words[0]} to {high:.4g} {step.words[1]}"
        return f"within {high:.4g}" if low == -high else both
    return f"{low:.4g} to {high:.4g}"
