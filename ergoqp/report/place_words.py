"""Texts that the pages of places share: scores, places, tilts and terms in words."""

from __future__ import annotations

import numpy as np

from ergoqp.placing.place import Placing
from ergoqp.placing.slices import Slice
from ergoqp.problem.problem import Problem
from ergoqp.report import palette
from ergoqp.report.charts.score_map import AXES
from ergoqp.report.page import Headline
from ergoqp.simulation.description import options_of


def score_headline(label: str, score: float) -> Headline:
    """Return a score or a mean of scores as a headline, in the colour of its action level."""
    level = int(palette.level_of_score(round(score)))
    words = f"{palette.risk_of_level(level)} risk" if score else "not scored"
    return Headline(label, f"{score:.2f}".rstrip("0").rstrip(".") if score else "–", level, words)


def change_of(before: int, after: int) -> str:
    """Return the difference of two scores in words."""
    points = abs(after - before)
    if not points:
        return "The score does not change."
    return f"{points} point{'s' if points > 1 else ''} {'better' if after < before else 'worse'}."


def place_words(pose: np.ndarray) -> str:
    """Return the position of a pose [m] in words, with non-breaking spaces."""
    return (
        ", ".join(
            f"{axis}\u00a0{_signed(value)}" for axis, value in zip("xyz", pose[:3, 3], strict=True)
        )
        + "\u00a0m"
    )


def tilt_words(problem: Problem, pose: np.ndarray) -> str:
    """Return the tilt of a pose from the middle of the tool's cone [deg] in words."""
    turns = Placing.of(problem).point(pose)[3:]
    up, left = (AXES[3 + i][1] * turns[i] for i in (0, 1))
    return (
        f"{abs(up):.0f} deg {'up' if up >= 0 else 'down'}, {abs(left):.0f} deg to the"
        f" {'left' if left >= 0 else 'right'}"
    )


def slice_words(slice_: Slice) -> str:
    """Return the two axes of a map and the fixed coordinates in words."""
    fixed = {
        i: value for i, value in enumerate(slice_.point) if i not in (slice_.across, slice_.up)
    }
    words = [f"{'xyz'[i]} = {_signed(value)} m" for i, value in fixed.items() if i < 3]
    names = [AXES[i][0].split(",")[0] for i in (slice_.up, slice_.across)]
    return (
        f"{names[0]} by {names[1]}, at {', '.join(words)}" if words else f"{names[0]} by {names[1]}"
    )


def _signed(value: float) -> str:
    return f"{float(value):z.2f}".replace("-", "−")


def task_options(problem: Problem) -> list[tuple[str, str]]:
    """Return the terms of a problem in words, without those of the control loop."""
    loop = ("control: ", "QP solver", "twist limit", "joint limit")
    terms = [(what, value) for what, value in options_of(problem, "") if not what.startswith(loop)]
    return [
        ("person of the problem" if what == "person in the controller" else what, value)
        for what, value in terms
    ]
