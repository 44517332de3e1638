"""Plain tables for the terminal."""

from __future__ import annotations

import math

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from ergoqp.mocap import Recording
from ergoqp.report import palette
from ergoqp.report.run_facts import facts_of, hint_of, told_of, violation_rows
from ergoqp.report.scores import summary_of, worst_in_words
from ergoqp.sheets.reba import Assessment
from ergoqp.simulation.run import Run


def run_table(run: Run) -> RenderableType:
    """Return the summary of a run for the terminal.

    It contains scores, segments, statuses, timing and broken limits.

    Args:
        run: the run.
    """
    facts = facts_of(run)
    scores = _plain(Text(run.title), ("", "before", "after", "best"), numeric=(1, 2, 3))
    scores.add_row(
        "REBA",
        _score(facts.before),
        _score(facts.after),
        f"{_score(facts.best)} at {facts.best_at:.1f} s",
    )
    for name in palette.SEGMENTS:
        before, after = facts.segments_before[name], facts.segments_after[name]
        style = "" if before == after else "bold"
        scores.add_row(
            Text(name.replace("_", " "), style=style),
            Text(str(before)),
            Text(str(after), style=style),
            "",
        )
    rest = _plain(None, ("", ""))
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
    for name, words in rows:
        rest.add_row(name, Text(words))
    return Group(scores, rest)


def score_table(recording: Recording, assessment: Assessment) -> RenderableType:
    """Return the summary of a scored recording for the terminal.

    Args:
        recording: the movement.
        assessment: assessment of its n postures.
    """
    summary = summary_of(recording, assessment)
    table = _plain(None, ("", ""))
    table.add_row(
        "frames",
        f"{summary['valid_frames']} of {summary['frames']} scored, {summary['duration_s']:.1f} s",
    )
    if summary["not_scored"]:
        causes = [f"{cause} {count}" for cause, count in summary["not_scored"].items()]
        table.add_row("not scored", Text(", ".join(causes)))
    worst = summary["worst"]
    if worst is None:
        return table
    table.add_row(
        "REBA",
        f"mean {summary['mean']:.2f}, median {summary['median']:g}, p95 {summary['p95']:g}, max"
        f" {summary['max']}",
    )
    table.add_row(
        "time at risk",
        ", ".join(f"{name} {100 * share:.0f} %" for name, share in summary["share"].items()),
    )
    if summary["fit_error_mm"] is not None:
        error = summary["fit_error_mm"]
        table.add_row("fit error", f"median {error['median']:.1f} mm, max {error['max']:.1f} mm")
    table.add_row("worst", worst_in_words(worst))
    reasons = _plain(None, ("why",))
    for sentence in worst["reasons"]:
        reasons.add_row(Text(sentence))
    segments = _plain(None, ("segment", "mean", "highest"), numeric=(1, 2))
    for name, each in summary["segments"].items():
        segments.add_row(name.replace("_", " "), f"{each['mean']:.2f}", str(each["max"]))
    return Group(table, reasons, segments)


def _plain(title: Text | None, head: tuple[str, ...], numeric: tuple[int, ...] = ()) -> Table:
    """Return a table without lines, readable in a pipe; without a head if no column has a name."""
    table = Table(
        title=title, box=None, show_header=any(head), title_justify="left", pad_edge=False
    )
    for i, name in enumerate(head):
        table.add_column(name, justify="right" if i in numeric else "left", overflow="fold")
    return table


def _score(score: int) -> str:
    return f"{score} {palette.risk_of_score(score)}" if score else "not scored"
