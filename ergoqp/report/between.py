"""Scores that are known between two ends, in words: ``4``, ``4 to 7``, ``5 (4 to 7)``.

The summaries are those of `ergoqp.report.scores.summary_of`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ergoqp.report import palette


def between(low: str, high: str) -> str:
    """Return two ends in words, as one if they are equal."""
    return low if low == high else f"{low} to {high}"


def around(best: float, low: float, high: float, form: Callable[[float], str] = str) -> str:
    """Return a value with its ends.

    The value itself is left out if it is the lower end: what is not seen is taken as zero, which
    often scores lowest, and such a score is no estimate.

    Args:
        best: the value of the likeliest postures.
        low: its lower end.
        high: its upper end.
        form: how a number is written.
    """
    words = between(form(low), form(high))
    return words if form(best) == form(low) else f"{form(best)} ({words})"


def risk_between(low: int, high: int) -> str:
    """Return the words of the risk of two final scores, ``"low"`` or ``"low to high"``."""
    return between(palette.risk_of_score(low), palette.risk_of_score(high))


def levels_between(low: float, high: float) -> tuple[int, ...]:
    """Return the action levels from that of one final score, or mean of them, to that of another.

    Args:
        low: the lower score, 1 to 15.
        high: the higher one.
    """
    ends: NDArray[np.int64] = palette.level_of_score([round(low), round(high)])
    return tuple(range(int(ends[0]), int(ends[1]) + 1))


def of_summary(summary: Mapping[str, Any], name: str, form: str = "g") -> str:
    """Return a statistic of a summary, or of one of its segments, with its ends.

    Args:
        summary: the summary.
        name: name of the statistic, such as ``"mean"``.
        form: how a number is written.
    """
    best, low, high = (summary[f"{name}{end}"] for end in ("", "_low", "_high"))
    return around(best, low, high, lambda value: format(value, form))


def is_exact(summary: Mapping[str, Any]) -> bool:
    """Return whether every scored frame of a summary has one score, so that no range is shown."""
    return summary["exact_frames"] == summary["valid_frames"]


def shares_of(summary: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    """Return the shares of time per action level of the lowest to highest scores, by their name.

    Those of the likeliest scores are left out if they are those of the lowest, as in `around`.
    """
    low, best, high = (summary[f"share{end}"] for end in ("_low", "", "_high"))
    if low == best == high:
        return {"all": best}
    if best == low:
        return {"lowest": low, "highest": high}
    return {"lowest": low, "likeliest": best, "highest": high}


def worst_in_words(summary: Mapping[str, Any]) -> str:
    """Return the worst frame of a summary, how many more have its score, and what others may."""
    worst = summary["worst"]
    more = f" and {worst['others']} more" if worst["others"] else ""
    where = f"frame {worst['frame']} at {worst['time_s']:.2f} s{more}"
    score = around(worst["reba"], worst["reba_low"], worst["reba_high"])
    risk = risk_between(worst["reba_low"], worst["reba_high"])
    return "; ".join([f"{where}: REBA {score}, {risk}", *others_may_reach(summary)])


def others_may_reach(summary: Mapping[str, Any]) -> list[str]:
    """Return in words what frames may reach that is above the worst one of a summary, or nothing.

    The worst frame is that of the highest likeliest score, so another may reach more.
    """
    most = summary["max_high"]
    if most <= summary["worst"]["reba_high"]:
        return []
    return [f"other frames may reach {most}, {palette.risk_of_score(most)}"]


def segment_mean(segment: Mapping[str, Any], form: str) -> str:
    """Return the mean of a segment of a summary; without the likeliest if it is never seen."""
    if segment["observed"]:
        return of_summary(segment, "mean", form)
    return between(*(format(segment[f"mean{end}"], form) for end in ("_low", "_high")))


def segments_table(summary: Mapping[str, Any]) -> tuple[list[str], list[list[str]]]:
    """Return head and rows of the table of the segments of a summary with scored frames."""
    segments = summary["segments"].values()
    head = ["segment", "mean", "highest", "most often", "share of the time"]
    exact = all(_fixed(each) for each in segments)
    if not exact:
        head.insert(1, "seen")
    rows = []
    for name, each in summary["segments"].items():
        usual = each["usual"]
        rows.append(
            [
                name.replace("_", " "),
                *([] if exact else [seen_in_words(each)]),
                segment_mean(each, ".2f" if _fixed(each) else ".1f"),
                between(str(each["max_low"]), str(each["max_high"])),
                between(str(usual["low"]), str(usual["high"])),
                f"{100 * usual['share']:.0f} %",
            ]
        )
    return head, rows


def _fixed(segment: Mapping[str, Any]) -> bool:
    """Return whether every score of a segment of a summary has equal ends."""
    return segment["mean_low"] == segment["mean_high"]


def seen_in_words(segment: Mapping[str, Any]) -> str:
    """Return how much of a segment of a summary is seen, ``"not seen"`` or a share."""
    share = segment["observed"]
    # A single frame more or less must not look like all or nothing.
    return f"{min(max(100 * share, 1), 99 if share < 1 else 100):.0f} %" if share else "not seen"
