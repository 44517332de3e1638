"""The page of a closed loop: before and after, replay, charts over time, reasons, options."""

from __future__ import annotations

from dataclasses import replace
from itertools import zip_longest
from pathlib import Path
from typing import Final

import numpy as np

from ergoqp.joints import spoken
from ergoqp.report import palette
from ergoqp.report.body.figure import posture_figure
from ergoqp.report.body.person import Movement, timing_of
from ergoqp.report.body.scene import scene_html
from ergoqp.report.charts.over_time import lines_chart, score_chart, timing_chart
from ergoqp.report.charts.strips import Strip, segments_chart, segments_strips, strips_chart
from ergoqp.report.page import (
    Headline,
    Page,
    PageTable,
    Picture,
    Section,
    is_seated,
    plain,
    scored_alike,
    write_page,
)
from ergoqp.report.run_facts import (
    RunFacts,
    facts_of,
    hint_of,
    reasons_of,
    segments_at,
    told_of,
    violation_rows,
)
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
    missing = len(names) - len(shown)
    intro = "When a limit held the object back." if names else "No limit held the object back."
    if missing:
        intro += f" {missing} more were active for a smaller share."
    pictures = (
        [
            Picture.of(
                lambda width: strips_chart("Active limits over time", run.time, strips, width=width)
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
    return Section(
        "Control steps",
        pictures=[
            Picture.of(
                lambda width: strips_chart(
                    "Status of each step over time", run.time, strips, width=width
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


def write_run_page(run: Run, path: Path) -> None:
    """Write the report of a run as one self-contained HTML file.

    Args:
        run: the run.
        path: path of the file; its folder exists.

    Raises:
        MissingExtraError: if viser or jinja2 is not installed.
        OSError: if the file cannot be written.
    """
    facts = facts_of(run)
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
    page = Page(
        title=run.title[:1].upper() + run.title[1:],
        subtitle=_subtitle(run),
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
            segments(run, facts),
            motion(run),
            *_tries(run),
            limits(run),
            steps(run, facts),
            Section("Assumptions", sentences=run.assumptions or ["None."]),
            Section(
                "Options",
                tables=[PageTable(("what", "value"), _options(run))],
                folded=True,
            ),
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
    return [
        Section(
            "Places tried",
            intro="The object goes to each place, and the person's mean posture over one second at"
            " rest is scored there. The object ends at the place with the lowest measured score.",
            tables=[
                PageTable(
                    ("place", "when", "measured score", "result"),
                    rows,
                    numeric=(2,),
                    marked=tuple(i for i, each in enumerate(run.tries) if each.score == lowest),
                )
            ],
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
    found = [_headline("before", facts.before)]
    if facts.standing_still:
        found.append(_headline("had the object stayed", facts.standing_still))
    found.append(replace(_headline("after", facts.after), arrow=True))
    if facts.best < facts.after:
        found.append(_headline(f"best, at {facts.best_at:.1f} s", facts.best))
    return found


def _headline(label: str, score: int) -> Headline:
    level = int(palette.level_of_score(score))
    words = f"{palette.risk_of_level(level)} risk" if score else "not scored"
    return Headline(label, str(score) if score else "–", level, words)


def _options(run: Run) -> list[tuple[str, str]]:
    return [
        *run.options,
        ("control period", f"{plain(1e3 * run.dt)} ms"),
        ("seed", str(run.seed)),
    ]


def _subtitle(run: Run) -> str:
    start = "" if run.recording is None else f", starting from the recording {run.recording}"
    return f"REBA of a simulated person who follows the object. Problem {run.problem}{start}."


def _facts(run: Run, facts: RunFacts) -> list[tuple[str, str]]:
    let_go = [] if run.let_go is None else [("the person let go", f"at {run.let_go:.1f} s")]
    broken = sum(run.violations.values())
    return [
        (
            "duration",
            f"{run.time[-1] - run.time[0]:.1f} s, {len(run.time)} steps of"
            f" {plain(1e3 * run.dt)} ms",
        ),
        ("rest", facts.settling),
        ("limits broken", "none" if not broken else f"{broken} times, see the limits"),
        ("person", f"{run.follower.replace('_', ' ')}, {run.body.stature:.2f} m"),
        *let_go,
        *_out_of_balance(run),
        *_felt(run),
    ]


def _out_of_balance(run: Run) -> list[tuple[str, str]]:
    """Return the share of time in which the person would have had to step or to hold on."""
    if not run.unbalanced:
        return []
    return [("centre of mass beyond the feet", f"{100 * run.unbalanced:.1f} % of the time")]


def _felt(run: Run) -> list[tuple[str, str]]:
    """Return forces, slips and falls of a person with mass."""
    forces = np.linalg.norm(run.forces[:, :3], axis=1)
    forces = forces[np.isfinite(forces)]
    if not forces.size:
        return []
    fell = "no" if run.fell is None else f"at {run.fell:.1f} s"
    return [
        ("force on the hands", f"median {np.median(forces):.0f} N, at most {forces.max():.0f} N"),
        ("slips of a hand", str(run.slips)),
        ("fell", fell),
    ]


def _figure(run: Run, row: int, name: str) -> Picture:
    score = int(run.reba[row])
    svg = posture_figure(
        run.body,
        run.postures[row],
        run.base_poses[row],
        segments_at(run, row),
        f"Posture {name}",
        run.poses[row],
    )
    return Picture(
        svg, f"{name}: REBA {score}, {palette.risk_of_level(int(palette.level_of_score(score)))}"
    )
