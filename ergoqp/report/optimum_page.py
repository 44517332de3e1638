"""The page of an offline optimum: before and after, and maps of the score around the place.

It also shows all starts and the bound.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ergoqp.placing.optimise import begin_from
from ergoqp.placing.optimum import Optimum
from ergoqp.placing.place import PoseParametrization, Slice, slices_through
from ergoqp.problem.problem import Problem
from ergoqp.report import palette
from ergoqp.report.body.figure import posture_figure
from ergoqp.report.charts.strips import AXES, COLOURS, Spot, score_map
from ergoqp.report.page import (
    Page,
    PageTable,
    Picture,
    Section,
    closing_sections,
    plain,
    score_headline,
    segments_section,
    write_page,
)
from ergoqp.rest.model_person import ModelPerson
from ergoqp.simulation.description import options_of


def change_of(before: int, after: int) -> str:
    """Return the difference of two scores in words."""
    points = abs(after - before)
    if not points:
        return "The score does not change."
    return f"{points} point{'s' if points > 1 else ''} {'better' if after < before else 'worse'}."


def place_words(pose: np.ndarray) -> str:
    """Return the position of a pose [m] in words, with non-breaking spaces."""
    return (
        ", ".join(
            f"{axis}\u00a0{_signed(value)}" for axis, value in zip("xyz", pose[:3, 3], strict=True)
        )
        + "\u00a0m"
    )


def tilt_words(problem: Problem, pose: np.ndarray) -> str:
    """Return the tilt of a pose from the middle of the tool's cone [deg] in words."""
    turns = PoseParametrization.of(problem).point(pose)[3:]
    up, left = (AXES[3 + i][1] * turns[i] for i in (0, 1))
    return (
        f"{abs(up):.0f} deg {'up' if up >= 0 else 'down'}, {abs(left):.0f} deg to the"
        f" {'left' if left >= 0 else 'right'}"
    )


def slice_words(slice_: Slice) -> str:
    """Return the two axes of a map and the fixed coordinates in words."""
    fixed = {
        i: value for i, value in enumerate(slice_.point) if i not in (slice_.across, slice_.up)
    }
    words = [f"{'xyz'[i]} = {_signed(value)} m" for i, value in fixed.items() if i < 3]
    names = [AXES[i][0].split(",")[0] for i in (slice_.up, slice_.across)]
    return (
        f"{names[0]} by {names[1]}, at {', '.join(words)}" if words else f"{names[0]} by {names[1]}"
    )


def _signed(value: float) -> str:
    return f"{float(value):z.2f}".replace("-", "−")


def task_options(problem: Problem) -> list[tuple[str, str]]:
    """Return the terms of a problem in words, without those of the control loop."""
    loop = ("control: ", "QP solver", "twist limit", "joint limit")
    terms = [(what, value) for what, value in options_of(problem, "") if not what.startswith(loop)]
    return [
        ("person of the problem" if what == "person in the controller" else what, value)
        for what, value in terms
    ]


MODES = {
    "stackelberg": "the person comes to rest by their own comfort",
    "cooperative": "the posture is chosen with the place",
}
"""The modes of an optimum in words."""


def write_optimum_page(
    optimum: Optimum,
    problem: Problem,
    path: Path,
    *,
    cooperative: Optimum | None = None,
    person: ModelPerson | None = None,
    jobs: int = 1,
) -> None:
    """Write the report of an optimum as one self-contained HTML file.

    Args:
        optimum: the optimum.
        problem: the problem of the search; the map is computed here.
        path: path of the file; its folder exists.
        cooperative: the optimum of the same problem and person with the posture chosen too;
            None: unknown.
        person: who held the object in the search; None: built again.
        jobs: number of processes for the map.

    Raises:
        MissingExtraError: if jinja2 is not installed.
        OSError: if the file cannot be written.
    """
    follower, stature = person or ModelPerson(optimum.response), optimum.response.body.stature
    ends = (optimum.posture_before, optimum.pose_before), (optimum.posture, optimum.pose)
    assessed = [problem.assess(posture) for posture, _ in ends]
    before, after = segments = [palette.segments_at(each, 0) for each in assessed]
    scores = f"REBA {optimum.reba_before}", f"REBA {optimum.reba_after}"
    captions = f"before: {scores[0]}", f"at the best place: {scores[1]}"
    assumptions, options = closing_sections(optimum.assumptions, _options(optimum, problem))
    both = [optimum] if cooperative is None else [optimum, cooperative]
    page = Page(
        title=f"Best place: {optimum.title}",
        subtitle=(
            f"REBA of a person of {stature:.2f} m. Problem {optimum.problem};"
            f" {MODES[optimum.mode]}."
        ),
        headlines=[
            score_headline("before", optimum.reba_before),
            replace(score_headline("at the best place", optimum.reba_after), arrow=True),
        ],
        change=change_of(optimum.reba_before, optimum.reba_after),
        facts=_facts(optimum),
        figures=[
            _figure(follower, *end, own, caption)
            for end, own, caption in zip(ends, segments, captions, strict=True)
        ],
        sections=[
            _map(optimum, problem, follower, jobs),
            segments_section(
                (captions[0], f"best place: {scores[1]}"),
                before,
                after,
                (assessed[0].reasons(0), assessed[1].reasons(0)),
            ),
            *([_bound(both)] if len(both) > 1 else []),
            assumptions,
            _starts(both),
            options,
        ],
    )
    write_page(page, path)


def _figure(
    follower: ModelPerson,
    posture: np.ndarray,
    pose: np.ndarray,
    segments: dict[str, int],
    caption: str,
) -> Picture:
    base = follower.contact(posture)[1]
    return Picture(
        posture_figure(follower.response.body, posture, base, segments, f"Posture {caption}", pose),
        caption,
    )


def _facts(optimum: Optimum) -> list[tuple[str, str]]:
    ends = [trial.reba for trial in optimum.trials]
    seconds = [trial.seconds for trial in optimum.trials]
    moved = 100 * float(np.linalg.norm(optimum.pose[:3, 3] - optimum.pose_before[:3, 3]))
    facts = [
        ("best place", place_words(optimum.pose)),
        ("moved by", f"{moved:.0f} cm"),
        ("smooth cost", f"{optimum.cost_before:.2f} → {optimum.cost_after:.2f} points"),
    ]
    if ends:
        facts.append(
            ("starts that end at this score", f"{ends.count(optimum.reba_after)} of {len(ends)}")
        )
        facts.append(("time per start", f"median {1e3 * float(np.median(seconds)):.0f} ms"))
    return facts


def _map(optimum: Optimum, problem: Problem, follower: ModelPerson, jobs: int) -> Section:
    held = begin_from(follower, optimum.posture_before, optimum.pose_before)
    start = replace(held, posture=optimum.posture, pose=optimum.pose)
    slices = slices_through(problem, [follower], optimum.pose, starts=[start], jobs=jobs)
    placing = PoseParametrization.of(problem)
    spots = [
        Spot(placing.point(optimum.pose_before), "before", "spot other"),
        Spot(placing.point(optimum.pose), "best"),
    ]
    pictures = [
        Picture(
            score_map(each, each.scores[0].astype(float), f"Map {slice_words(each)}", spots),
            slice_words(each),
        )
        for each in slices
    ]
    intro = (
        "Exact score of the person at rest if the object is moved along two axes from the best"
        " place and not turned. The place before is projected onto the map, so its own score may"
        " differ from the map's. Point at a cell to read it."
    )
    return Section("Map", intro, pictures, columns=True, chips=COLOURS)


def _bound(found: Sequence[Optimum]) -> Section:
    rows = [
        (
            MODES[each.mode],
            str(each.reba_after),
            f"{each.cost_after:.3f}",
            place_words(each.pose),
        )
        for each in found
    ]
    return Section(
        "At rest, and with the posture chosen",
        "The posture that the person takes at the best place, and the best posture that would be"
        " possible: an optimistic bound, because people do not choose their posture by its score.",
        tables=[
            PageTable(("posture", "REBA", "smooth cost, points", "place"), rows, numeric=(1, 2))
        ],
    )


def _starts(found: Sequence[Optimum]) -> Section:
    optimum = found[0]
    rows = [
        (
            str(trial.number),
            str(trial.reba) if trial.reba else "–",
            f"{trial.cost:.3f}",
            plain(trial.kkt_residual, 2),
            f"{np.degrees(trial.apart):.2f}",
            f"{1e3 * trial.seconds:.0f}",
            trial.note or place_words(trial.pose),
        )
        for trial in optimum.trials
    ]
    best = [i for i, trial in enumerate(optimum.trials) if np.array_equal(trial.pose, optimum.pose)]
    residuals = " and ".join(
        f"{plain(each.kkt_residual, 2)} where {MODES[each.mode]}" for each in found
    )
    head = (
        "start",
        "REBA",
        "smooth cost, points",
        "KKT residual",
        "apart, deg",
        "time, ms",
        "where it ended, or why it does not count",
    )
    return Section(
        "Starts",
        "REBA: exact score of the person at rest where the start ended. Apart: largest difference"
        " between that posture and the one in the nonlinear program. Largest KKT residual:"
        f" {residuals} (dimensionless).",
        tables=[PageTable(head, rows, marked=best, numeric=(0, 1, 2, 3, 4, 5))] if rows else [],
        folded=True,
    )


def _options(optimum: Optimum, problem: Problem) -> list[tuple[str, str]]:
    own = [
        ("mode", f"{optimum.mode}: {MODES[optimum.mode]}"),
        ("solver", optimum.solver),
        ("starts", str(len(optimum.trials))),
        ("seed", str(optimum.seed)),
    ]
    if optimum.tau_deg is not None:
        own.append(("tau of the last stage", f"{optimum.tau_deg:g} deg"))
    return [*own, *task_options(problem)]
