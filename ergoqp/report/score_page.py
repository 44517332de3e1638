"""The page of a scored recording: replay, score over time, and share of time per risk level.

It also gives the reasons of the worst moment.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ergoqp.joints import spoken
from ergoqp.mocap import Recording
from ergoqp.report import palette
from ergoqp.report.between import (
    around,
    between,
    is_exact,
    levels_between,
    of_summary,
    others_may_reach,
    risk_between,
    segments_table,
    shares_of,
    worst_in_words,
)
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
    write_page,
)
from ergoqp.report.scores import summary_of
from ergoqp.report.seen import shown_scores
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
    summary = summary_of(recording, assessment)
    shown, most = shown_scores(recording, assessment, palette.SEGMENTS)
    movement = Movement(
        recording.person,
        recording.time,
        recording.postures,
        recording.base_poses,
        assessment.final,
        shown,
        recording.object_poses,
        is_seated(assessment),
        ends=None if is_exact(summary) else (assessment.final_low, assessment.final_high),
    )
    timing = timing_of(recording.time)
    page = Page(
        title=title,
        subtitle="REBA of a recorded movement.",
        headlines=_headlines(summary),
        facts=_facts(summary),
        replay=scene_html(movement, timing),
        replay_note=timing.note,
        figures=_figures(movement, assessment, summary),
        sections=[
            _over_time(movement, most, summary),
            _worst(recording, assessment, summary),
            _fit(recording, summary),
            *_read(recording),
            *closing_sections(recording.assumptions, options),
        ],
        grey="not seen" if any((each < 0).any() for each in shown.values()) else "not scored",
    )
    write_page(page, path)


def _headlines(summary: dict[str, Any]) -> list[Headline]:
    worst = summary["worst"]
    if worst is None:
        return [Headline("score", "–", -1, "no frame could be scored")]
    mean = [summary[f"mean{end}"] for end in ("_low", "", "_high")]
    scores = [worst[f"reba{end}"] for end in ("_low", "", "_high")]
    high = [100 * _alarming(summary[f"share{end}"]) for end in ("_low", "", "_high")]
    words = [f"{each:.0f}" for each in high]
    likeliest = f", likeliest {words[1]} %" if words[1] not in (words[0], words[2]) else ""
    return [
        _headline("mean", mean, ".1f"),
        _headline(
            f"worst, at {worst['time_s']:.1f} s",
            scores,
            "d",
            others_may_reach(summary),
            summary["max_high"],
        ),
        Headline(
            "time at high risk or above",
            f"{between(words[0], words[2])} %",
            -1,
            f"REBA 8 and more{likeliest}",
        ),
    ]


def _headline(
    label: str,
    scores: Sequence[float],
    form: str,
    notes: Sequence[str] = (),
    most: float = 0,
) -> Headline:
    """Return lowest, likeliest and highest of a score, or of a mean of scores, as a headline.

    Args:
        label: what it is.
        scores: lowest, likeliest and highest.
        form: how they are written.
        notes: what is added to the words.
        most: a higher score that the notes name.
    """
    low, best, high = scores
    words = [format(each, form) for each in scores]
    levels = levels_between(low, max(high, most))
    risk = f"{risk_between(round(low), round(high))} risk"
    likeliest = f", likeliest {words[1]}" if low < best < high else ""
    said = "; ".join([f"{risk}{likeliest}", *notes])
    value = between(words[0], words[2])
    if len(levels) == 1:
        return Headline(label, value, levels[0], said)
    # No colour of one level: the score may be of another.
    return Headline(label, value, -1, said, levels=levels)


def _alarming(share: dict[str, float]) -> float:
    return sum(share[name] for name in reba.ACTION_LEVELS[3:])


def _facts(summary: dict[str, Any]) -> list[tuple[str, str]]:
    facts = [
        ("duration", f"{summary['duration_s']:.1f} s"),
        ("frames", f"{summary['valid_frames']} of {summary['frames']} scored"),
    ]
    if summary["worst"] is not None:
        if not is_exact(summary):
            single = f"{summary['exact_frames']} of {summary['valid_frames']} frames"
            facts.append(("one score, no range", single))
        facts.append(("median", of_summary(summary, "median")))
        facts.append(("95th percentile", of_summary(summary, "p95")))
    facts.append(("stature", f"{summary['stature_m']:.2f} m"))
    if summary["fit_error_mm"] is not None:
        facts.append(("fit error", f"median {summary['fit_error_mm']['median']:.1f} mm"))
    return facts


def _figures(movement: Movement, assessment: Assessment, summary: dict[str, Any]) -> list[Picture]:
    if summary["worst"] is None:
        return []
    worst = summary["worst"]["frame"]
    # Of the frames with the lowest score, one that may not be much higher.
    rank = 100 * assessment.final + assessment.final_high
    lowest = int(np.argmin(np.where(assessment.valid, rank, np.iinfo(np.int64).max)))
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
        scores = (assessment.final, assessment.final_low, assessment.final_high)
        best, low, high = (int(each[i]) for each in scores)
        said = f"REBA {around(best, low, high)}, {risk_between(low, high)}"
        pictures.append(Picture(svg, f"{name}, {movement.time[i]:.1f} s: {said}"))
    return pictures


def _over_time(
    movement: Movement, most: Mapping[str, NDArray[np.int8]], summary: dict[str, Any]
) -> Section:
    """Return the section of the score over time.

    Args:
        movement: the scored movement.
        most: segment -> highest score where it has a range, else 0, shape (n,).
        summary: its summary.
    """
    worst = summary["worst"]
    marks = (
        [] if worst is None else [(float(movement.time[worst["frame"]]), worst["reba"], "worst")]
    )
    shares = {
        f"{name} scores": {f"{risk} risk": share for risk, share in each.items()}
        for name, each in shares_of(summary).items()
    }
    score = partial(score_chart, movement.time, movement.final, marks=marks, ends=movement.ends)
    share = partial(
        shares_chart, "Share of time per risk level", shares, range(len(reba.ACTION_LEVELS))
    )
    open_ = movement.ends is not None
    strips = partial(
        segments_strips,
        movement.time,
        movement.segments,
        most if open_ else None,
        _notes(summary) if open_ else None,
    )
    strips_words = "Segment scores, in the colours of the body."
    if open_:
        strips_words += (
            " Grey: not seen. A thin line below: the score has a range, and the line has the colour"
            " of its upper end."
        )
    return Section(
        "Score",
        _what_is_open(summary),
        pictures=[
            Picture.of(score, "Score over time, with the risk levels."),
            Picture.of(share, _shares_words(summary)),
            Picture.of(strips, strips_words),
        ],
    )


def _what_is_open(summary: dict[str, Any]) -> str:
    """Return why scores have two ends, in words; empty if none has."""
    if is_exact(summary):
        return ""
    scored, single = summary["valid_frames"], summary["exact_frames"]
    words = (
        f"{single} of {scored} scored frames have one score. The others have a range"
        if single
        else "Every scored frame has a range of scores"
    )
    words += (
        ": from the lowest to the highest score of all postures between the ends of the joint"
        " angles. In the likeliest posture, joints that are never seen are at zero."
    )
    never, partly, doubtful = [], [], []
    for name, each in summary["segments"].items():
        said = name.replace("_", " ")
        if each["mean_low"] == each["mean_high"]:
            continue
        if not each["observed"]:
            never.append(said)
        elif each["observed"] < 1:
            partly.append(said)
        else:
            doubtful.append(said)
    if never:
        words += f" Not seen: {', '.join(never)}."
    if partly:
        words += f" Seen in part, or for a part of the time: {', '.join(partly)}."
    if doubtful:
        words += f" Seen, but with a range: {', '.join(doubtful)}."
    return words


def _shares_words(summary: dict[str, Any]) -> str:
    if is_exact(summary) or summary["worst"] is None:
        return "Share of the scored time."
    ends = []
    for name, share in shares_of(summary).items():
        risks = [f"{risk} {100 * each:.0f} %" for risk, each in share.items() if each]
        ends.append(f"{name.capitalize()} scores: {', '.join(risks)}.")
    return f"Share of the scored time. {' '.join(ends)}"


def _notes(summary: dict[str, Any]) -> dict[str, str]:
    """Return what stands at the end of each segment's row."""
    notes = {}
    for name, each in summary["segments"].items():
        if each["mean"] is None:
            notes[name] = "not scored"
        elif not each["observed"] and each["mean_low"] < each["mean_high"]:
            ends = between(str(each["max_low"]), str(each["max_high"]))
            notes[name] = f"not seen, {ends}"
        else:
            mean = between(*(f"{each[f'mean{end}']:.1f}" for end in ("_low", "_high")))
            notes[name] = f"mean {mean} of {palette.segment_highest(name)}"
    return notes


def _worst(recording: Recording, assessment: Assessment, summary: dict[str, Any]) -> Section:
    worst = summary["worst"]
    if worst is None:
        causes = recording.causes(0) or assessment.reasons(0)
        return Section("Worst moment", "No frame could be scored.", sentences=causes)
    words = worst_in_words(summary)
    intro = f"{words[0].upper()}{words[1:]}."
    head, segments = segments_table(summary)
    return Section(
        "Worst moment and segments",
        intro,
        tables=[
            PageTable(("reasons",), [(sentence,) for sentence in worst["reasons"]]),
            PageTable(head, segments, numeric=range(1, len(head))),
        ],
    )


def _read(recording: Recording) -> list[Section]:
    """Return the section with what was read, folded; none for a recording without names."""
    rows = [(name, use or "not read") for name, use in recording.read.items()]
    head = ("name in the file", "used as")
    return [Section("What was read", tables=[PageTable(head, rows)], folded=True)] if rows else []


def _fit(recording: Recording, summary: dict[str, Any]) -> Section:
    error = {"fit error": 1e3 * recording.fit_error}
    outside = [(spoken(name), str(frames)) for name, frames in summary["outside"].items()]
    causes = [(cause, str(frames)) for cause, frames in summary["not_scored"].items()]
    doubts = [(cause, str(frames)) for cause, frames in summary["doubts"].items()]
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
        PageTable(("in doubt, and taken as not seen", "frames"), doubts, numeric=(1,)),
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
