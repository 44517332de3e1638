"""The page of a group's place: all members at it, and maps of the highest and the mean score.

It also shows what each member pays.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from ergoqp.lab.group import GroupOptimum, Member
from ergoqp.lab.group_search import GroupPerson
from ergoqp.placing.place import PoseParametrization, Slice, slices_through
from ergoqp.problem.problem import Problem
from ergoqp.report import palette
from ergoqp.report.body.figure import Drawing, Standing, lineup
from ergoqp.report.charts.strips import COLOURS, Spot, score_map
from ergoqp.report.optimum_page import (
    place_words,
    slice_words,
    task_options,
    tilt_words,
)
from ergoqp.report.page import (
    Page,
    PageTable,
    Picture,
    Section,
    closing_sections,
    score_headline,
    write_page,
)

OBJECTIVES = {"minimax": "the lowest highest score", "mean": "the lowest mean score"}
"""The objectives in words."""

_AXES = {
    "none": "nothing: one fixed place",
    "x": "the distance (x)",
    "y": "the side (y)",
    "z": "the height (z)",
    "tilt": "the tilt",
}
_HIGHEST = (
    "The highest score in the group if the object is moved along two axes from the group's place"
    " (the dot) and not turned. Grey: somebody cannot reach it. Point at a cell to read the score"
    " and whose it is."
)
_MEAN = "The mean score of the group at the same places. The colour is that of the rounded score."
_MOST_NAMES = 3


def write_group_page(
    found: GroupOptimum,
    problem: Problem,
    people: tuple[GroupPerson, ...],
    path: Path,
    *,
    jobs: int = 1,
) -> None:
    """Write the report of a group's place as one self-contained HTML file.

    Args:
        found: the place.
        problem: the problem of the search; the maps are computed here.
        people: the group, in the order of `found.members`.
        path: path of the file; its folder exists.
        jobs: number of processes for the maps.

    Raises:
        MissingExtraError: if jinja2 is not installed.
        OSError: if the file cannot be written.
    """
    page = Page(
        title=f"One place for {len(found.members)} people: {found.title}",
        subtitle=(
            "REBA of everybody at the same fixed place of the object, with"
            f" {OBJECTIVES[found.objective]}. Problem {found.problem}."
        ),
        headlines=[
            score_headline("highest of the group", found.maximum),
            score_headline("mean of the group", found.mean),
            score_headline("mean, each at their own best", found.own_mean),
        ],
        facts=_facts(found, problem),
        figures=[
            Picture.of(
                partial(_row, found),
                "Everybody at the group's place, drawn to one scale. The dashed line is the height"
                " of the object.",
            )
        ],
        sections=[
            _people(found),
            _adjustable(found),
            *_maps(found, problem, people, jobs),
            Section("Reasons", tables=[_reasons(found)]),
            *closing_sections(found.assumptions, _options(found, problem)),
        ],
    )
    write_page(page, path)


def _facts(found: GroupOptimum, problem: Problem) -> list[tuple[str, str]]:
    paying = [member for member in found.members if member.pays]
    return [
        ("place of the object", place_words(found.pose)),
        ("tilt from the middle", tilt_words(problem, found.pose)),
        ("worse than at their own best", f"{len(paying)} of {len(found.members)} people"),
        ("points above everybody's own best", f"{sum(member.pays for member in found.members)}"),
        ("everybody reaches", f"{100 * found.grid.reached_by_all.mean():.0f} % of the grid"),
        (
            "best place of the grid",
            f"highest {found.grid_reba.max()}, mean {found.grid_reba.mean():.2f}",
        ),
    ]


def _row(found: GroupOptimum, *, width: float) -> str:
    standing = [
        Standing(m.label, m.reba, Drawing(m.body, m.posture, m.base_pose, m.segments, found.pose))
        for m in found.members
    ]
    return lineup(standing, "Everybody at the group's place", width=width)


def _people(found: GroupOptimum) -> Section:
    rows = [
        (
            member.label,
            str(member.reba),
            palette.risk_of_score(member.reba),
            str(member.own_reba),
            f"+{member.pays}" if member.pays else "0",
            f"{100 * member.reach:.0f}",
            place_words(member.own_pose),
        )
        for member in found.members
    ]
    paying = [i for i, member in enumerate(found.members) if member.pays]
    head = ("person", "REBA", "risk", "alone", "pays", "reaches, %", "own best place")
    return Section(
        "People",
        "Alone: score at the best place for this person only. Pays: additional points at the shared"
        " place. Reaches: share of the grid's places that the person reaches.",
        tables=[PageTable(head, rows, marked=paying, numeric=(1, 3, 4, 5))],
    )


def _adjustable(found: GroupOptimum) -> Section:
    rows = [
        (_AXES[axis], str(highest), f"{mean:.2f}") for axis, (highest, mean) in found.free.items()
    ]
    return Section(
        "What could be made adjustable",
        "Scores if everybody could adjust one thing and the rest stayed fixed: the better one of a"
        f" search from the group's place and of the grid of {100 * found.spacing:.0f} cm.",
        tables=[PageTable(("to be set", "highest", "mean"), rows, numeric=(1, 2))],
    )


def _maps(
    found: GroupOptimum, problem: Problem, people: tuple[GroupPerson, ...], jobs: int
) -> list[Section]:
    slices = slices_through(problem, [person.follower for person in people], found.pose, jobs=jobs)
    place = [Spot(PoseParametrization.of(problem).point(found.pose))]
    sections = []
    for title, take, intro in (
        ("Map of the highest score", np.max, _HIGHEST),
        ("Map of the mean score", np.mean, _MEAN),
    ):
        pictures = [
            Picture(
                score_map(
                    each,
                    _together(each, take),
                    f"{title}, {slice_words(each)}",
                    place,
                    _missing(each, found.members),
                ),
                slice_words(each),
            )
            for each in slices
        ]
        sections.append(Section(title, intro, pictures, columns=True, chips=COLOURS))
    return sections


def _together(slice_: Slice, take: Callable[..., np.ndarray]) -> np.ndarray:
    """Return one value per place (v, h) from the scores of all people.

    It is 0 if somebody does not reach, -1 if the object may not be there.
    """
    lowest = slice_.scores.min(axis=0)
    return np.where(lowest > 0, take(slice_.scores, axis=0), lowest).astype(float)


def _missing(slice_: Slice, members: tuple[Member, ...]) -> Callable[[int, int], str]:
    def who(row: int, column: int) -> str:
        names = [
            member.label
            for member, scores in zip(members, slice_.scores, strict=True)
            if scores[row, column] == 0
        ]
        more = len(names) - _MOST_NAMES
        return ", ".join(names[:_MOST_NAMES]) + (f" and {more} more" if more > 0 else "")

    return who


def _reasons(found: GroupOptimum) -> PageTable:
    """Return the segments with more than one point of each person, and their reasons.

    The first sentences of the reasons are those of the segments.
    """
    rows = []
    for member in found.members:
        whys = zip(palette.SEGMENTS, member.reasons, strict=False)
        costly = [why for name, why in whys if member.segments[name] > 1]
        rows.append((member.label, "; ".join(costly) or "none"))
    return PageTable(("person", "segments with more than one point"), rows)


def _options(found: GroupOptimum, problem: Problem) -> list[tuple[str, str]]:
    return [
        (
            "looked for",
            f"{OBJECTIVES[found.objective]} ({found.objective}), ties by the smooth cost",
        ),
        (
            "grid",
            (
                f"{found.grid.scores.shape[1]} poses, {100 * found.spacing:.0f} cm apart, for"
                " everybody"
            ),
        ),
        ("placements beyond the grid", str(found.placements)),
        ("time", f"{found.seconds:.1f} s"),
        *task_options(problem),
    ]
