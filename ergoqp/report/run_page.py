"""The page of a closed loop: before and after, replay, charts over time, reasons, options."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ergoqp.report import palette
from ergoqp.report.body.figure import posture_figure
from ergoqp.report.body.replay import Movement, timing_of
from ergoqp.report.body.scene import scene_html
from ergoqp.report.numbers import plain
from ergoqp.report.page import Headline, Page, PageTable, Picture, Section, write_page
from ergoqp.report.run_facts import RunFacts, facts_of, hint_of, segments_at, told_of
from ergoqp.report.run_sections import limits, motion, over_time, segments, steps
from ergoqp.report.task import is_seated, scored_alike
from ergoqp.simulation.run import Run


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
