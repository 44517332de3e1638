"""The page of a scored recording: replay, score over time, and share of time per risk level.

It also gives the reasons of the worst moment.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ergoqp.joints import JOINTS, spoken
from ergoqp.mocap import Recording
from ergoqp.report import palette
from ergoqp.report.body.figure import posture_figure
from ergoqp.report.body.person import Movement, timing_of
from ergoqp.report.body.scene import scene_html
from ergoqp.report.charts.over_time import lines_chart, score_chart, shares_chart
from ergoqp.report.charts.strips import segments_strips
from ergoqp.report.page import (
    Headline,
    Page,
    PageTable,
    Picture,
    Section,
    closing_sections,
    is_seated,
    score_headline,
    write_page,
)
from ergoqp.report.scores import summary_of, worst_in_words
from ergoqp.sheets import reba
from ergoqp.sheets.reba import Assessment


def write_score_page(
    recording: Recording,
    assessment: Assessment,
    path: Path,
    options: Sequence[tuple[str, str]],
    title: str = "Recording",
) -> None:
    """Write the report of a scored recording as one self-contained HTML file.

    Args:
        recording: the movement.
        assessment: assessment of its n postures.
        path: path of the file; its folder exists.
        options: options of the scoring as text: (what, value).
        title: name of the recording, for the heading.

    Raises:
        MissingExtraError: if viser or jinja2 is not installed.
        OSError: if the file cannot be written.
    """
    movement = Movement(
        recording.person,
        recording.time,
        recording.postures,
        recording.base_poses,
        assessment.final,
        assessment.segments,
        recording.object_poses,
        is_seated(assessment),
    )
    timing = timing_of(recording.time)
    summary = summary_of(recording, assessment)
    page = Page(
        title=title,
        subtitle="REBA of a recorded movement.",
        headlines=_headlines(summary),
        facts=_facts(summary),
        replay=scene_html(movement, timing),
        replay_note=timing.note,
        figures=_figures(movement, assessment, summary),
        sections=[
            _over_time(recording, assessment, summary),
            _worst(recording, assessment, summary),
            _fit(recording, summary),
            *_read(recording),
            *closing_sections(recording.assumptions, options),
        ],
    )
    write_page(page, path)


def _headlines(summary: dict[str, Any]) -> list[Headline]:
    worst = summary["worst"]
    if worst is None:
        return [Headline("score", "–", -1, "no frame could be scored")]
    alarming = sum(summary["share"][name] for name in reba.ACTION_LEVELS[3:])
    return [
        replace(score_headline("mean", summary["mean"]), value=f"{summary['mean']:.1f}"),
        score_headline(f"worst, at {worst['time_s']:.1f} s", worst["reba"]),
        Headline("time at high risk or above", f"{100 * alarming:.0f} %", -1, "REBA 8 and more"),
    ]


def _facts(summary: dict[str, Any]) -> list[tuple[str, str]]:
    facts = [
        ("duration", f"{summary['duration_s']:.1f} s"),
        ("frames", f"{summary['valid_frames']} of {summary['frames']} scored"),
    ]
    if summary["worst"] is not None:
        facts += [("median", f"{summary['median']:g}"), ("95th percentile", f"{summary['p95']:g}")]
    facts.append(("stature", f"{summary['stature_m']:.2f} m"))
    if summary["fit_error_mm"] is not None:
        facts.append(("fit error", f"median {summary['fit_error_mm']['median']:.1f} mm"))
    return facts


def _figures(movement: Movement, assessment: Assessment, summary: dict[str, Any]) -> list[Picture]:
    if summary["worst"] is None:
        return []
    worst = summary["worst"]["frame"]
    lowest = int(np.argmin(np.where(assessment.valid, assessment.final, np.iinfo(np.int64).max)))
    pictures = []
    for name, i in (("worst moment", worst), ("best moment", lowest)):
        posture = movement.at(np.array([i]))
        segments = {segment: int(scores[0]) for segment, scores in posture.segments.items()}
        contact = None if posture.object_poses is None else posture.object_poses[0]
        svg = posture_figure(
            movement.body,
            posture.postures[0],
            posture.base_poses[0],
            segments,
            name.capitalize(),
            contact,
        )
        risk = palette.risk_of_level(int(assessment.band[i]))
        pictures.append(
            Picture(svg, f"{name}, {movement.time[i]:.1f} s: REBA {assessment.final[i]}, {risk}")
        )
    return pictures


def _over_time(recording: Recording, assessment: Assessment, summary: dict[str, Any]) -> Section:
    worst = summary["worst"]
    marks = (
        [] if worst is None else [(float(recording.time[worst["frame"]]), worst["reba"], "worst")]
    )
    shares = {f"{name} risk": summary["share"][name] for name in reba.ACTION_LEVELS}
    missing = [j for j in range(len(JOINTS)) if not recording.observed[:, j].any()]
    intro = ""
    if missing:
        joints = ", ".join(spoken(JOINTS[j]) for j in missing)
        intro = f"Not determined by the recording and set to zero: {joints}."
    return Section(
        "Score",
        intro,
        pictures=[
            Picture.of(
                partial(score_chart, recording.time, assessment.final, marks=marks),
                "Score over time, with the risk levels.",
            ),
            Picture.of(
                partial(shares_chart, "Share of time per risk level", shares, range(len(shares))),
                "Share of the scored time.",
            ),
            Picture.of(
                partial(segments_strips, recording.time, assessment.segments),
                "Segment scores, in the colours of the body.",
            ),
        ],
    )


def _worst(recording: Recording, assessment: Assessment, summary: dict[str, Any]) -> Section:
    worst = summary["worst"]
    if worst is None:
        causes = recording.causes(0) or assessment.reasons(0)
        return Section("Worst moment", "No frame could be scored.", sentences=causes)
    words = worst_in_words(worst)
    intro = f"{words[0].upper()}{words[1:]}."
    segments = [
        (
            name.replace("_", " "),
            f"{each['mean']:.2f}",
            str(each["max"]),
            *_highest_share(each["share"]),
        )
        for name, each in summary["segments"].items()
    ]
    head = ("segment", "mean", "highest", "most often", "share of the time")
    return Section(
        "Worst moment and segments",
        intro,
        tables=[
            PageTable(("reasons",), [(sentence,) for sentence in worst["reasons"]]),
            PageTable(head, segments, numeric=(1, 2, 3, 4)),
        ],
    )


def _highest_share(share: dict[str, float]) -> tuple[str, str]:
    score = max(share, key=lambda name: share[name])
    return score, f"{100 * share[score]:.0f} %"


def _read(recording: Recording) -> list[Section]:
    """Return the section with what was read, folded; none for a recording without names."""
    rows = [(name, use or "not read") for name, use in recording.read.items()]
    head = ("name in the file", "used as")
    return [Section("What was read", tables=[PageTable(head, rows)], folded=True)] if rows else []


def _fit(recording: Recording, summary: dict[str, Any]) -> Section:
    error = {"fit error": 1e3 * recording.fit_error}
    outside = [(spoken(name), str(frames)) for name, frames in summary["outside"].items()]
    causes = [(cause, str(frames)) for cause, frames in summary["not_scored"].items()]
    centres = [
        (spoken(centre), f"{each['median']:.0f}", f"{each['max']:.0f}")
        for centre, each in summary["centre_error_mm"].items()
    ]
    markers = [
        (
            name,
            spoken(each["frame"]),
            "never seen" if each["residual_mm"] is None else f"{each['residual_mm']:.0f}",
        )
        for name, each in summary["markers"].items()
    ]
    tables = [
        PageTable(("not scored", "frames"), causes, numeric=(1,)),
        PageTable(("joint beyond its range", "frames"), outside, numeric=(1,)),
        PageTable(("joint centre", "median, mm", "highest, mm"), centres, numeric=(1, 2)),
        PageTable(("marker", "moves with", "residual, RMS, mm"), markers, numeric=(2,)),
    ]
    return Section(
        "Fit",
        "Distance between the joint centres of the recording and those of the fitted body (RMS over"
        " the centres). The angles are those of the recording's own bones.",
        pictures=[
            Picture.of(
                partial(lines_chart, "Fit error", recording.time, error, "mm", from_zero=True)
            )
        ],
        tables=[table for table in tables if table.rows],
    )
