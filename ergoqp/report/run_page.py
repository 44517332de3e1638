"""The page of a closed loop: before and after, replay, charts over time, reasons, options."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from ergoqp.joints import spoken
from ergoqp.report import palette
from ergoqp.report.body.figure import posture_figure
from ergoqp.report.body.person import Movement, timing_of
from ergoqp.report.body.scene import scene_html
from ergoqp.report.charts.over_time import lines_chart, score_chart, timing_chart
from ergoqp.report.charts.strips import Strip, segments_strips, strips_chart
from ergoqp.report.page import (
    Headline,
    Page,
    PageTable,
    Picture,
    Section,
    closing_sections,
    is_seated,
    plain,
    score_headline,
    scored_alike,
    segments_section,
    write_page,
)
from ergoqp.report.run_facts import (
    RunFacts,
    hint_of,
    reasons_of,
    told_of,
    violation_rows,
)
from ergoqp.sheets.reba import Assessment
from ergoqp.simulation.run import Run, hand_forces

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
                partial(score_chart, run.time, run.reba, run.cost, marks),
                "Exact score of the true posture over time, with the risk levels.",
            ),
            Picture.of(
                partial(segments_strips, run.time, scores.segments),
                "Segment scores, in the colours of the body.",
            ),
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
            Picture.of(
                partial(lines_chart, f"{which} velocity of the object", run.time, series, unit),
                f"{which} velocity.",
            )
            for which, series, unit in (
                ("Linear", linear, "mm/s"),
                ("Angular", angular, "deg/s"),
            )
        ],
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
    missing = len(names) - len(shown)
    intro = "When a limit held the object back." if names else "No limit held the object back."
    if missing:
        intro += f" {missing} more were active for a smaller share."
    chart = partial(strips_chart, "Active limits over time", run.time, strips)
    broken = [(spoken(name), *rest) for name, *rest in violation_rows(run)]
    tables = []
    if broken:
        intro += " The steps that broke one were counted by an independent checker."
        tables = [PageTable(("limit", "steps that broke it", "worst"), broken, numeric=(1, 2))]
    sentences = [
        f"The simulated person's own {spoken(joint)} was beyond its range in {count} samples."
        for joint, count in run.person_outside.items()
        if count
    ]
    return Section("Limits", intro, [Picture.of(chart)] if strips else [], tables, sentences)


def steps(run: Run, facts: RunFacts) -> Section:
    """Return the section of the statuses and durations of the control steps."""
    statuses = np.array(run.statuses)
    strips = []
    for status, count in facts.status_counts.items():
        here = (statuses == status).astype(np.int64)
        style = {1: (_STATUS_STYLE.get(status, "unscored"), status)}
        strips.append(Strip(status, here, style, f"{count} · {_share(here)}"))
    head, reasons = ("status", "steps", "first, s", "last, s", "reason"), reasons_of(run)
    return Section(
        "Control steps",
        pictures=[
            Picture.of(
                partial(strips_chart, "Status of each step over time", run.time, strips),
                "Status of each step.",
            ),
            Picture.of(
                partial(timing_chart, run.step_time, run.dt),
                f"Duration of a step: {facts.timing}.",
            ),
        ],
        tables=[PageTable(head, reasons, numeric=(1, 2, 3))] if reasons else [],
    )


def _share(here: np.ndarray) -> str:
    share = 100 * float(here.mean())
    return f"{share:.0f} %" if share >= 1 or share == 0 else "< 1 %"


def write_run_page(run: Run, path: Path) -> None:
    """Write the report of a run as one self-contained HTML file.

    Args:
        run: the run.
        path: path of the file; its folder exists.

    Raises:
        MissingExtraError: if viser or jinja2 is not installed.
        OSError: if the file cannot be written.
    """
    facts = RunFacts(run)
    scores = scored_alike(run.assessment, run.postures)
    seated = is_seated(run.assessment)
    movement = Movement(
        run.body,
        run.time,
        run.postures,
        run.base_poses,
        run.reba,
        scores.segments,
        run.poses,
        seated,
        held=True,
        forces=run.forces if np.isfinite(run.forces).any() else None,
    )
    timing = timing_of(run.time)
    options = [*run.options, ("control period", f"{plain(1e3 * run.dt)} ms")]
    options.append(("seed", str(run.seed)))
    begins = "" if run.recording is None else f", starting from the recording {run.recording}"
    page = Page(
        title=run.title[:1].upper() + run.title[1:],
        subtitle="REBA of a simulated person who follows the object. Problem"
        f" {run.problem}{begins}.",
        headlines=_headlines(facts),
        change=facts.added,
        stays=facts.stays,
        notes=_notes(run, facts),
        facts=_facts(run, facts),
        replay=scene_html(movement, timing),
        replay_note=timing.note,
        figures=[_figure(run, 0, "before"), _figure(run, -1, "after")],
        sections=[
            over_time(run, facts, scores),
            segments_section(
                (f"before: REBA {facts.before}", f"after: REBA {facts.after}"),
                facts.segments_before,
                facts.segments_after,
                (run.assessment.reasons(0), run.assessment.reasons(-1)),
            ),
            motion(run),
            *_tries(run),
            limits(run),
            steps(run, facts),
            *closing_sections(run.assumptions, options),
        ],
    )
    write_page(page, path)


def _tries(run: Run) -> list[Section]:
    """Return the places that a loop tried, with the scores that it measured there."""
    if not run.tries:
        return []
    lowest = min((each.score for each in run.tries if np.isfinite(each.score)), default=np.nan)
    rows = [
        (
            f"{each.name} ({each.why})",
            f"{each.begun:.1f} to {each.ended:.1f} s",
            f"{each.score:.1f}" if np.isfinite(each.score) else "–",
            each.note,
        )
        for each in run.tries
    ]
    best = [i for i, each in enumerate(run.tries) if each.score == lowest]
    head = ("place", "when", "measured score", "result")
    return [
        Section(
            "Places tried",
            intro="The object goes to each place, and the person's mean posture over one second at"
            " rest is scored there. The object ends at the place with the lowest measured score.",
            tables=[PageTable(head, rows, marked=best, numeric=(2,))],
        )
    ]


def _notes(run: Run, facts: RunFacts) -> list[str]:
    """Return what is not well at the end, and what the steps reported of robot and sensors."""
    notes = [] if facts.stays or not facts.after else ["Nothing costs points at the end."]
    if said := told_of(run):
        hint = hint_of(said)
        notes.append(
            "Messages during the run:"
            f" {'; '.join(said)}.{f' {hint[:1].upper()}{hint[1:]}.' if hint else ''}"
        )
    return notes


def _headlines(facts: RunFacts) -> list[Headline]:
    """Return the scores before, without moving the object, and after; and the best if lower."""
    found = [score_headline("before", facts.before)]
    if facts.standing_still:
        found.append(score_headline("had the object stayed", facts.standing_still))
    found.append(replace(score_headline("after", facts.after), arrow=True))
    if facts.best < facts.after:
        found.append(score_headline(f"best, at {facts.best_at:.1f} s", facts.best))
    return found


def _facts(run: Run, facts: RunFacts) -> list[tuple[str, str]]:
    steps = f"{len(run.time)} steps of {plain(1e3 * run.dt)} ms"
    broken = sum(run.violations.values())
    found = [
        ("duration", f"{run.time[-1] - run.time[0]:.1f} s, {steps}"),
        ("rest", facts.settling),
        ("limits broken", "none" if not broken else f"{broken} times, see the limits"),
        ("person", f"{run.follower.replace('_', ' ')}, {run.body.stature:.2f} m"),
    ]
    if run.let_go is not None:
        found.append(("the person let go", f"at {run.let_go:.1f} s"))
    if run.unbalanced:
        share = f"{100 * run.unbalanced:.1f} % of the time"
        found.append(("centre of mass beyond the feet", share))
    return found + _felt(run)


def _felt(run: Run) -> list[tuple[str, str]]:
    """Return forces, slips and falls of a person with mass."""
    felt = hand_forces(run.forces)
    if felt is None:
        return []
    fell = "no" if run.fell is None else f"at {run.fell:.1f} s"
    return [
        ("force on the hands", f"median {felt['median']:.0f} N, at most {felt['peak']:.0f} N"),
        ("slips of a hand", str(run.slips)),
        ("fell", fell),
    ]


def _figure(run: Run, row: int, name: str) -> Picture:
    score = int(run.reba[row])
    svg = posture_figure(
        run.body,
        run.postures[row],
        run.base_poses[row],
        palette.segments_at(run.assessment, row),
        f"Posture {name}",
        run.poses[row],
    )
    return Picture(svg, f"{name}: REBA {score}, {palette.risk_of_score(score)}")
