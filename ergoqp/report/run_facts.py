"""The summary of a run: figures for the table in the terminal and for the page."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from typing import Final

import numpy as np

from ergoqp.report import palette
from ergoqp.report.page import plain
from ergoqp.simulation.run import Run

_MOST_REASONS: Final = 25

STATUSES: Final = ("optimal", "settled", "relaxed", "recovering", "braking", "invalid")
"""All statuses of a step, best first."""


class RunFacts:
    """Figures of a run.

    Args:
        run: the run.

    Attributes:
        before: score of the first sample.
        after: score of the last sample.
        stays: segments of the last posture that still score above their lowest, and why.
        standing_still: score of the person's rest if the object had not moved, 0 if unknown.
        best: lowest score of the run.
        best_at: time at which it first occurred [s].
        segments_before: segment -> score.
        segments_after: segment -> score.
        status_counts: status -> number of steps, only those that occurred, best first.
        settled_after: start of the settled stretch at the end [s], None if the run does not
            end settled.
        step_us: median, 99th percentile and maximum of the duration of a step [µs].
    """

    def __init__(self, run: Run) -> None:
        """Compute the figures."""
        self.before, self.after = int(run.reba[0]), int(run.reba[-1])
        self.stays = tuple(run.assessment.costly(-1))
        self.standing_still = run.reba_standing_still
        best = int(np.argmin(np.where(run.reba > 0, run.reba, np.iinfo(np.int64).max)))
        self.best, self.best_at = int(run.reba[best]), float(run.time[best] - run.time[0])
        self.segments_before, self.segments_after = (
            palette.segments_at(run.assessment, row) for row in (0, -1)
        )
        counts = Counter(run.statuses)
        order = (*STATUSES, *sorted(set(counts) - set(STATUSES)))
        self.status_counts = {status: counts[status] for status in order if counts[status]}
        unsettled = [i for i, status in enumerate(run.statuses) if status != "settled"]
        rest = unsettled[-1] + 1 if unsettled else 0
        settles = rest < len(run.statuses)
        self.settled_after = float(run.time[rest] - run.time[0]) if settles else None
        known = 1e6 * run.step_time[np.isfinite(run.step_time)]
        us = known if known.size else np.zeros(1)
        self.step_us = float(np.median(us)), float(np.percentile(us, 99)), float(us.max())

    @property
    def change(self) -> str:
        """What the motion of the robot gained over the person's rest without it, in words."""
        if not self.standing_still:
            return f"{self.before} to {self.after}."
        gained = f"{self.standing_still} to {self.after} by moving the object"
        if self.before == self.standing_still:
            return f"{gained} ({self.before} had it stayed)."
        return (
            f"{gained}: {self.before} at the start, {self.standing_still} had the object stayed"
            " where it was."
        )

    @property
    def added(self) -> str:
        """What the robot added to the person's rest without it, in one sentence."""
        gain = self.standing_still - self.after
        if not (self.standing_still and self.after):
            return f"{self.before} at the start, {self.after or 'not scored'} at the end."
        points = f"{abs(gain)} point{'' if abs(gain) == 1 else 's'}"
        if not gain:
            return "The robot changed nothing: the score would be the same had the object stayed."
        return f"The robot {'took' if gain > 0 else 'added'} {points}{' off' if gain > 0 else ''}."

    @property
    def costs(self) -> str:
        """What still costs points at the end, and why, in words.

        The sentence of a segment may contain semicolons itself.
        """
        return "nothing" if not self.stays else " · ".join(self.stays)

    @property
    def settling(self) -> str:
        """Whether and when the object came to rest for good, in words."""
        return (
            "not settled at the end"
            if self.settled_after is None
            else f"settled after {self.settled_after:.1f} s"
        )

    @property
    def timing(self) -> str:
        """The duration of the steps, in words."""
        median, p99, highest = self.step_us
        return f"median {plain(median)} µs, p99 {plain(p99)} µs, max {plain(highest)} µs"


def violation_rows(run: Run) -> list[tuple[str, str, str]]:
    """Return per limit its name, the number of steps that broke it, and the worst with its unit."""
    rows = []
    for name, count in run.violations.items():
        unit = run.units.get(name, "").removeprefix("1")
        worst = f"{plain(run.max_violation.get(name, 0.0))} {unit}".rstrip() if count else "–"
        rows.append((name, str(count), worst))
    return rows


def reasons_of(run: Run) -> list[tuple[str, str, str, str, str]]:
    """Return per reason: status, number of steps, first and last time [s], and sentence.

    The most frequent comes first. Reasons that differ only in their numbers (``by 0.137``,
    ``by 0.136``) are one reason, with the last numbers.
    """
    kinds: dict[tuple[str, str], list[int]] = {}
    for i, (status, reason) in enumerate(zip(run.statuses, run.reasons, strict=True)):
        if reason:
            kinds.setdefault((status, re.sub(r"\d[\d.e+-]*", "#", reason)), []).append(i)
    most = sorted(kinds.values(), key=lambda steps: (-len(steps), steps[0]))[:_MOST_REASONS]
    return [
        (
            run.statuses[at[0]],
            str(len(at)),
            f"{run.time[at[0]]:.2f}",
            f"{run.time[at[-1]]:.2f}",
            run.reasons[at[-1]],
        )
        for at in most
    ]


def hint_of(said: Sequence[str]) -> str:
    """Return what can be done about the result of `told_of`; empty if nothing is known."""
    if not any(sentence.startswith("robot:") for sentence in said):
        return ""
    return "delays and errors of a robot can be declared under [robot] in the problem file"


def told_of(run: Run, most: int = 3) -> list[str]:
    """Return what the steps reported of robot and sensors and for how long, most frequent first."""
    said: dict[str, tuple[int, str]] = {}
    for reason in run.reasons:
        for part in reason.split("; "):
            if part.startswith("robot:") or ", held at the " in part or "given up" in part:
                kind = re.sub(r"\d[\d.e+-]*", "#", part)
                said[kind] = (said.get(kind, (0, ""))[0] + 1, part)
    chosen = sorted(said.values(), key=lambda each: -each[0])[:most]
    return [f"{sentence} ({_seconds(count * run.dt)} s)" for count, sentence in chosen]


def _seconds(duration: float) -> str:
    return f"{duration:.1f}" if duration >= 0.05 else "< 0.1"
