"""Sections of the page of a closed loop: score, segments, object, limits, control steps."""

from __future__ import annotations

from itertools import zip_longest
from typing import Final

import numpy as np

from ergoqp.joints import spoken
from ergoqp.report import palette
from ergoqp.report.charts.over_time import lines_chart, score_chart, timing_chart
from ergoqp.report.charts.strips import Strip, segments_chart, segments_strips, strips_chart
from ergoqp.report.page import PageTable, Picture, Section
from ergoqp.report.run_facts import RunFacts, reasons_of, violation_rows
from ergoqp.sheets.reba import Assessment
from ergoqp.simulation.run import Run

_STATUS_STYLE: Final = {
    "optimal": "level0",
    "settled": "level1",
    "relaxed": "level2",
    "recovering": "level3",
    "braking": "level4",
    "invalid": "level4",
}
_MOST_LIMITS: Final = 16


def over_time(run: Run, facts: RunFacts, scores: Assessment) -> Section:
    """Return the section of the score and the segments over time."""
    start = float(run.time[0])
    marks = [(start, facts.before, "before"), (float(run.time[-1]), facts.after, "after")]
    if facts.best < min(facts.before, facts.after):
        marks.insert(1, (start + facts.best_at, facts.best, "best"))
    return Section(
        "Score",
        pictures=[
            Picture.of(
                lambda width: score_chart(run.time, run.reba, run.cost, marks, width=width),
                "Exact score of the true posture over time, with the risk levels.",
            ),
            Picture.of(
                lambda width: segments_strips(run.time, scores.segments, width=width),
                "Segment scores, in the colours of the body.",
            ),
        ],
    )


def segments(run: Run, facts: RunFacts) -> Section:
    """Return the section of the segments before and after, with their reasons."""
    before, after = run.assessment.reasons(0), run.assessment.reasons(-1)
    rows = list(zip_longest(before, after, fillvalue=""))
    changed = [
        i
        for i, name in enumerate(palette.SEGMENTS)
        if facts.segments_before[name] != facts.segments_after[name]
    ]  # the first sentences are those of the segments, in this order
    return Section(
        "Segments and reasons",
        pictures=[
            Picture.of(
                lambda width: segments_chart(
                    facts.segments_before, facts.segments_after, width=width
                )
            )
        ],
        tables=[
            PageTable(
                (f"before: REBA {facts.before}", f"after: REBA {facts.after}"),
                rows,
                marked=changed,
                even=True,
            )
        ],
    )


def motion(run: Run) -> Section:
    """Return the section of the object's motion."""
    linear = {f"v{axis}": 1e3 * run.twists[:, i] for i, axis in enumerate("xyz")}
    angular = {f"ω{axis}": np.degrees(run.twists[:, 3 + i]) for i, axis in enumerate("xyz")}
    way = np.linalg.norm(np.diff(run.poses[:, :3, 3], axis=0), axis=1).sum()
    apart = np.linalg.norm(run.poses[-1, :3, 3] - run.poses[0, :3, 3])
    return Section(
        "Object",
        "Sent twist at the contact frame, along the axes of the world (x forward, y left, z up)."
        f" The path of the object is {100 * way:.1f} cm long and ends {100 * apart:.1f} cm from its"
        " start.",
        pictures=[
            _velocity(run, "Linear", linear, "mm/s"),
            _velocity(run, "Angular", angular, "deg/s"),
        ],
    )


def _velocity(run: Run, which: str, series: dict[str, np.ndarray], unit: str) -> Picture:
    title = f"{which} velocity of the object"
    return Picture.of(
        lambda width: lines_chart(title, run.time, series, unit, width=width),
        f"{which} velocity.",
    )


def limits(run: Run) -> Section:
    """Return the section of the limits that held the object back, and of those that were broken."""
    names = sorted({name for active in run.active for name in active})
    held = {
        name: np.array([name in active for active in run.active], dtype=np.int64) for name in names
    }
    shown = sorted(names, key=lambda name: -int(held[name].sum()))[:_MOST_LIMITS]
    styles = {1: ("active", "active")}
    strips = [Strip(spoken(name), held[name], styles, _share(held[name])) for name in shown]
    said = "; ".join(f"{strip.name} {strip.note}" for strip in strips)
    missing = len(names) - len(shown)
    intro = "When a limit held the object back." if names else "No limit held the object back."
    if missing:
        intro += f" {missing} more were active for a smaller share."
    pictures = (
        [
            Picture.of(
                lambda width: strips_chart(
                    "Active limits over time", f"{said}.", run.time, strips, width=width
                )
            )
        ]
        if strips
        else []
    )
    broken = [(spoken(name), *rest) for name, *rest in violation_rows(run)]
    tables = (
        [PageTable(("limit", "steps that broke it", "worst"), broken, numeric=(1, 2))]
        if broken
        else []
    )
    if broken:
        intro += " The steps that broke one were counted by an independent checker."
    sentences = [
        f"The simulated person's own {spoken(joint)} was beyond its range in {count} samples."
        for joint, count in run.person_outside.items()
        if count
    ]
    return Section("Limits", intro, pictures, tables, sentences)


def steps(run: Run, facts: RunFacts) -> Section:
    """Return the section of the statuses and durations of the control steps."""
    statuses = np.array(run.statuses)
    strips = []
    for status, count in facts.status_counts.items():
        here = (statuses == status).astype(np.int64)
        style = {1: (_STATUS_STYLE.get(status, "unscored"), status)}
        strips.append(Strip(status, here, style, f"{count} · {_share(here)}"))
    said = "; ".join(f"{strip.name} {strip.note}" for strip in strips)
    return Section(
        "Control steps",
        pictures=[
            Picture.of(
                lambda width: strips_chart(
                    "Status of each step over time", f"{said}.", run.time, strips, width=width
                ),
                "Status of each step.",
            ),
            Picture.of(
                lambda width: timing_chart(run.step_time, run.dt, width=width),
                f"Duration of a step: {facts.timing}.",
            ),
        ],
        tables=(
            [
                PageTable(
                    ("status", "steps", "first, s", "last, s", "reason"), rows, numeric=(1, 2, 3)
                )
            ]
            if (rows := reasons_of(run))
            else []
        ),
    )


def _share(here: np.ndarray) -> str:
    share = 100 * float(here.mean())
    return f"{share:.0f} %" if share >= 1 or share == 0 else "< 1 %"
