"""Reasons for the score of a segment, in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ergoqp.joints import JOINTS, LOWER, SIDES, UPPER, spoken
from ergoqp.sheets.description import TIE, Segment, StepFunction
from ergoqp.sheets.options import Task

_NARROW: Final = float(np.radians(0.5))
"""Ends that are at most this far apart are not told: the angle is as good as known [rad]."""


@dataclass(frozen=True)
class _Reading:
    """What a step reads: the angle of a joint, and the ends between which it is [rad]."""

    step: StepFunction
    joint: int
    low: float
    high: float

    @classmethod
    def of(
        cls,
        segment: Segment,
        step: StepFunction,
        side: str,
        posture: NDArray[np.float64],
        ends: NDArray[np.float64],
    ) -> _Reading:
        joint = segment.joint(step, side)
        low, high = (float(each) for each in ends[:, joint])
        if high - low <= _NARROW:
            low = high = float(posture[joint])
        return cls(step, joint, low, high)

    @property
    def points(self) -> tuple[int, int]:
        """Lowest and highest points."""
        ends = np.array([self.low, self.high])
        return int(self.step.lowest(ends)), int(self.step.highest(ends))

    @property
    def open_words(self) -> str:
        """The joint and its ends, for points that are not the same at both."""
        ends = np.array([self.low, self.high])
        return f"{spoken(JOINTS[self.joint])} {_known_to(ends, self.joint)}"


def explain_segment(
    segment: Segment,
    posture: NDArray[np.float64],
    ends: NDArray[np.float64],
    task: Task,
    side: str,
    score: int,
) -> str:
    """Return a sentence that explains the score of a segment that is the same between two postures.

    An example is ``"neck 24 deg flexion, over 20: 2; twisted left 15 to 30 deg: +1"``.

    Args:
        segment: the segment.
        posture: one posture, shape (32,) [rad].
        ends: lower and upper ends of its joint angles (2, 32) [rad].
        task: options of this posture, single values.
        side: ``"right"``, ``"left"`` or ``""``.
        score: the exact score. It is named at the end if a clamp changed the sum.
    """
    joint_side = _worse_side(segment, posture, ends) if segment.worse_side else side
    base = _Reading.of(segment, segment.base, joint_side, posture, ends)
    if segment.skipped_by is not None and task.flag(segment.skipped_by, side):
        parts = [f"{segment.label(side)} {segment.skipped_by}: {segment.start}"]
        total = np.full(2, segment.start)
    else:
        total = segment.start + np.array(base.points)
        if total[0] == total[1]:
            name = segment.label(side) + (f", {joint_side} knee" if segment.worse_side else "")
            words = f"{name} {_amount(base)}, {_band(segment.base, base.low)}"
        else:
            words = f"{segment.label(side)}, {base.open_words}"
        parts = [f"{words}: {_between(*(str(each) for each in total))}"]
    for modifier in segment.modifiers:
        readings = [_Reading.of(segment, step, side, posture, ends) for step in modifier.conditions]
        met = [_condition(each) for each in readings if each.points == (1, 1)]
        unsure = [each.open_words for each in readings if each.points == (0, 1)]
        if not modifier.additive:
            unsure = [] if met else unsure
            met, unsure = _joined(" and ", met), _joined(" or ", unsure)
        parts += [f"{one}: +1" for one in met] + [f"{one}: +0 to +1" for one in unsure]
        total += [len(met), len(met) + len(unsure)]
    for option in segment.options:
        blocked = option.not_with is not None and bool(task.flag(option.not_with, side))
        if task.flag(option.option, side) and not blocked:
            parts.append(f"{option.words}: {option.points:+d}")
            total += option.points
    low, high = (int(each) for each in total)
    if low != score or high != score:
        change = f": {score - low:+d}" if low == high else ""
        parts.append(f"{'at least' if low < score else 'at most'} {score}{change}")
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
    low, high = (round(each) for each in np.degrees(ends).tolist())
    return f"{low} to {high} deg"


def _worse_side(segment: Segment, posture: NDArray[np.float64], ends: NDArray[np.float64]) -> str:
    """Return the side that decides: with the highest lowest points, then those of the posture."""

    def points(side: str) -> tuple[int, int]:
        joint = segment.joint(segment.base, side)
        return int(segment.base.lowest(ends[:, joint])), int(segment.base.score(posture[joint]))

    return max(SIDES, key=points)


def _joined(word: str, parts: list[str]) -> list[str]:
    return [word.join(parts)] if parts else []


def _between(low: str, high: str) -> str:
    return low if low == high else f"{low} to {high}"


def _amount(reading: _Reading) -> str:
    """Return an angle in words, as ``"30 to 47 deg flexion"``."""
    (low, from_), (high, to) = _ends_in_words(reading)
    if from_ == to:
        return f"{_between(low, high)} deg {to}"
    return f"{low} deg {from_} to {high} deg {to}"


def _condition(reading: _Reading) -> str:
    """Return the angle of a condition in words, as ``"twisted left 15 to 30 deg"``."""
    (low, from_), (high, to) = _ends_in_words(reading)
    if from_ == to:
        return f"{to} {_between(low, high)} deg"
    return f"{from_} {low} deg to {to} {high} deg"


def _ends_in_words(reading: _Reading) -> list[tuple[str, str]]:
    """Return the size and the word of both ends; of negative angles the smaller size is first."""
    step, ends = reading.step, [reading.low, reading.high]
    if reading.high < 0:
        ends.reverse()
    return [(_magnitude(step, end), step.words[end >= 0]) for end in ends]


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
