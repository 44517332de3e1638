"""Plain tables for the terminal."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from rich.console import Group, OverflowMethod, RenderableType
from rich.table import Table
from rich.text import Text

from ergoqp.report import palette
from ergoqp.report.between import (
    is_exact,
    of_summary,
    segments_table,
    shares_of,
    worst_in_words,
)
from ergoqp.report.run_facts import RunFacts, hint_of, told_of, violation_rows
from ergoqp.report.scores import summary_of
from ergoqp.sheets.reba import Assessment
from ergoqp.simulation.run import Run

if TYPE_CHECKING:
    from ergoqp.mocap import Recording


def run_table(run: Run) -> RenderableType:
    """Return the summary of a run for the terminal.

    It contains scores, segments, statuses, timing and broken limits.

    Args:
        run: the run.
    """
    facts = RunFacts(run)
    best = f"{_score(facts.best)} at {facts.best_at:.1f} s"
    scores: list[tuple[str | Text, ...]] = [
        ("REBA", _score(facts.before), _score(facts.after), best)
    ]
    for name in palette.SEGMENTS:
        before, after = facts.segments_before[name], facts.segments_after[name]
        style = "" if before == after else "bold"
        label = Text(name.replace("_", " "), style=style)
        scores.append((label, Text(str(before)), Text(str(after), style=style), ""))
    counts = ", ".join(f"{status} {count}" for status, count in facts.status_counts.items())
    rows = [
        ("change", facts.change),
        ("still costs points", facts.costs),
        ("steps", f"{len(run.statuses)}: {counts}"),
        ("rest", facts.settling),
        ("step time", facts.timing),
    ]
    if run.tries:
        tried = [
            f"{each.name} {each.score:.1f}" if math.isfinite(each.score) else f"{each.name} –"
            for each in run.tries
        ]
        rows.append(("places tried", ", ".join(tried)))
    if run.let_go is not None:
        rows.append(("let go", f"the person could not reach any more at {run.let_go:.1f} s"))
    broken = [
        f"{name} {count} steps, worst {worst}"
        for name, count, worst in violation_rows(run)
        if count != "0"
    ]
    rows.append(("limits broken", "; ".join(broken) or "none"))
    if said := told_of(run):
        rows.append(("messages", "; ".join(said)))
    if hint := hint_of(said):
        rows.append(("", hint))
    outside = [f"{joint} {count} samples" for joint, count in run.person_outside.items() if count]
    if outside:
        rows.append(("person beyond range", "; ".join(outside)))
    return Group(
        table_of(Text(run.title), ("", "before", "after", "best"), scores, overflow="fold"),
        _words_table(rows),
    )


def score_table(recording: Recording, assessment: Assessment) -> RenderableType:
    """Return the summary of a scored recording for the terminal.

    Args:
        recording: the movement.
        assessment: assessment of its n postures.
    """
    summary = summary_of(recording, assessment)
    scored = f"{summary['valid_frames']} of {summary['frames']} scored"
    rows = [("frames", f"{scored}, {summary['duration_s']:.1f} s")]
    if summary["not_scored"]:
        causes = [f"{cause} {count}" for cause, count in summary["not_scored"].items()]
        rows.append(("not scored", ", ".join(causes)))
    if summary["doubts"]:
        causes = [f"{cause} {count}" for cause, count in summary["doubts"].items()]
        rows.append(("in doubt", ", ".join(causes)))
    worst = summary["worst"]
    if worst is None:
        return _words_table(rows)
    if not is_exact(summary):
        single = f"{summary['exact_frames']} of {summary['valid_frames']} frames"
        rows.append(("one score, no range", single))
    reba = f"mean {of_summary(summary, 'mean', '.2f')}, median {of_summary(summary, 'median')}"
    reba += f", p95 {of_summary(summary, 'p95')}, max {of_summary(summary, 'max')}"
    rows.append(("REBA", reba))
    ends = shares_of(summary)
    for name, share in ends.items():
        shares = [f"{risk} {100 * each:.0f} %" for risk, each in share.items()]
        by = f", {name} scores" if len(ends) > 1 else ""
        rows.append((f"time at risk{by}", ", ".join(shares)))
    if summary["fit_error_mm"] is not None:
        error = summary["fit_error_mm"]
        rows.append(("fit error", f"median {error['median']:.1f} mm, max {error['max']:.1f} mm"))
    rows.append(("worst", worst_in_words(summary)))
    head, segments = segments_table(summary)
    return Group(
        _words_table(rows),
        table_of(None, ("why",), [(Text(why),) for why in worst["reasons"]], overflow="fold"),
        table_of(None, head, segments, overflow="fold"),
    )


def _words_table(rows: Iterable[tuple[str, str]]) -> Table:
    """Return a table of names and their words."""
    cells = [(name, Text(words)) for name, words in rows]
    return table_of(None, ("", ""), cells, words=(0, 1), overflow="fold")


def table_of(
    title: Text | str | None,
    head: Sequence[str],
    rows: Iterable[Sequence[RenderableType]],
    *,
    words: Sequence[int] = (0,),
    framed: bool = False,
    overflow: OverflowMethod = "ellipsis",
) -> Table:
    """Return a table for the terminal; without a head if no column has a name.

    Args:
        title: title above it.
        head: names of the columns.
        rows: cells.
        words: numbers of the columns with words; the others are numbers.
        framed: whether it has lines; without them it is readable in a pipe.
        overflow: what becomes of words that are too long for their column.
    """
    frame: dict[str, Any] = {} if framed else {"box": None, "pad_edge": False}
    table = Table(title=title, title_justify="left", show_header=any(head), **frame)
    for i, name in enumerate(head):
        table.add_column(name, justify="left" if i in words else "right", overflow=overflow)
    for row in rows:
        table.add_row(*row)
    return table


def _score(score: int) -> str:
    return f"{score} {palette.risk_of_score(score)}" if score else "not scored"
