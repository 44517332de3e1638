"""One self-contained page: its parts, how it is rendered, and numbers for people.

Everything except pictures is escaped.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import resources
from itertools import zip_longest
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ergoqp._version import __version__
from ergoqp.errors import MissingExtraError
from ergoqp.files.atomic import write_text_atomic
from ergoqp.report import palette
from ergoqp.report.charts.axes import NARROW, WIDTH
from ergoqp.report.charts.strips import segments_chart
from ergoqp.sheets.angles import read_postures
from ergoqp.sheets.assessment import Assessment, assess_rows


@dataclass(frozen=True)
class Headline:
    """A score at the top of the page.

    Attributes:
        label: what it is, for example ``"before"``.
        value: the score as text.
        level: action level 0 to 4, -1 without a colour.
        words: text below it.
        arrow: whether an arrow leads to it from the one before.
        levels: action levels from the lowest to the highest that the score may have; empty if
            there is one.
    """

    label: str
    value: str
    level: int
    words: str
    arrow: bool = False
    levels: Sequence[int] = ()


@dataclass(frozen=True)
class Picture:
    """A drawing with its caption. `svg` is trusted markup that this package made.

    Attributes:
        svg: the drawing.
        caption: text below it, may be empty.
        narrow: the same drawing for a telephone; empty: `svg` is narrow enough.
    """

    svg: str
    caption: str = ""
    narrow: str = ""

    @classmethod
    def of(cls, draw: Callable[..., str], caption: str = "") -> Picture:
        """Return a drawing at both widths of the page; `draw` has the keyword `width` [px]."""
        return cls(draw(width=WIDTH), caption, draw(width=NARROW))


@dataclass(frozen=True)
class PageTable:
    """A table of texts.

    Attributes:
        head: column titles, may be empty.
        rows: cells as text.
        marked: numbers of the highlighted rows.
        numeric: numbers of the columns with numbers.
        even: whether all columns have the same width.
    """

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    marked: Sequence[int] = ()
    numeric: Sequence[int] = ()
    even: bool = False


@dataclass(frozen=True)
class Section:
    """A part of the page under a heading.

    Attributes:
        title: the heading.
        intro: one or two sentences, may be empty.
        pictures: charts, one below the other.
        tables: tables below the charts.
        sentences: a list of sentences at the end.
        columns: pictures are side by side instead.
        chips: meanings of colours above the pictures: class and words.
        links: a list of pages beside this one: file name and words.
        folded: only the heading is visible until it is clicked; everything is printed.
    """

    title: str
    intro: str = ""
    pictures: Sequence[Picture] = ()
    tables: Sequence[PageTable] = ()
    sentences: Sequence[str] = ()
    columns: bool = False
    chips: Sequence[tuple[str, str]] = ()
    links: Sequence[tuple[str, str]] = ()
    folded: bool = False


@dataclass(frozen=True)
class Page:
    """A whole report.

    Attributes:
        title: heading, and title of the window.
        subtitle: text below it.
        headlines: the important scores, large.
        facts: names and values of further numbers.
        figures: flat figures of the important postures.
        sections: charts and tables.
        change: difference between before and after, in words; may be empty.
        replay: the replay as a page of its own; empty without one.
        replay_note: how the replay differs from real time.
        notes: further problems, one sentence each.
        stays: segments that still cost points, each with its reason, below `change`.
        grey: meaning of grey on the body.
    """

    title: str
    subtitle: str
    headlines: Sequence[Headline]
    facts: Sequence[tuple[str, str]]
    figures: Sequence[Picture]
    sections: Sequence[Section] = ()
    change: str = ""
    replay: str = ""
    replay_note: str = ""
    notes: Sequence[str] = ()
    stays: Sequence[str] = ()
    grey: str = "not scored"


def score_headline(label: str, score: float) -> Headline:
    """Return a score or a mean of scores as a headline, in the colour of its action level."""
    level = int(palette.level_of_score(round(score)))
    words = f"{palette.risk_of_level(level)} risk" if score else "not scored"
    return Headline(label, f"{score:.2f}".rstrip("0").rstrip(".") if score else "–", level, words)


def segments_section(
    head: tuple[str, str],
    before: Mapping[str, int],
    after: Mapping[str, int],
    reasons: tuple[Sequence[str], Sequence[str]],
) -> Section:
    """Return the section of the segments before and after, with their reasons.

    Args:
        head: the two postures, above their reasons.
        before: segment -> score.
        after: segment -> score.
        reasons: sentences on each posture; the first are those of the segments, in their order.
    """
    changed = [i for i, name in enumerate(palette.SEGMENTS) if before[name] != after[name]]
    rows = list(zip_longest(*reasons, fillvalue=""))
    return Section(
        "Segments and reasons",
        pictures=[Picture.of(partial(segments_chart, before, after))],
        tables=[PageTable(head, rows, marked=changed, even=True)],
    )


def closing_sections(
    assumptions: Sequence[str], options: Sequence[tuple[str, str]]
) -> tuple[Section, Section]:
    """Return the last sections: what was assumed, and the options as (what, value)."""
    return (
        Section("Assumptions", sentences=assumptions or ["None."]),
        Section(
            "Options",
            tables=[PageTable(("what", "value"), options)] if options else [],
            intro="" if options else "None.",
            folded=True,
        ),
    )


def write_page(page: Page, path: Path) -> None:
    """Render a page and write it.

    Args:
        page: the parts of the page.
        path: path of the HTML file; its folder exists.

    Raises:
        MissingExtraError: if jinja2 is not installed.
        OSError: if the file cannot be written.
    """
    write_text_atomic(path, render(page))


def render(page: Page) -> str:
    """Return a page as HTML.

    Raises:
        MissingExtraError: if jinja2 is not installed.
    """
    try:
        from jinja2 import Environment, StrictUndefined
    except ImportError:
        raise MissingExtraError("the report page", "report", "jinja2") from None
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    template = environment.from_string(
        resources.files("ergoqp.report").joinpath("page.html.j2").read_text(encoding="utf-8")
    )
    return template.render(
        page=page,
        version=__version__,
        colours=list(zip(palette.COLOURS, palette.INKS, strict=True)),
        unscored=palette.UNSCORED,
        points=palette.POINTS,
    )


_LEAST: Final = 1e-6
"""Smaller numbers are written as smaller than this."""


def plain(value: float, digits: int = 3) -> str:
    """Return a number with some significant digits, such as ``4420``, ``0.0312``, ``< 0.000001``.

    Args:
        value: any number; a number that is not finite gives a dash.
        digits: number of significant digits, without zeros at the end.
    """
    value = float(value)
    if not np.isfinite(value):
        return "–"
    if 0 < abs(value) < _LEAST:
        return f"< {np.format_float_positional(_LEAST)}" if value > 0 else "0"
    text = np.format_float_positional(value, digits, unique=False, fractional=False, trim="-")
    return text.replace("-", "−")


def microseconds(value: float) -> str:
    """Return a duration [µs] as text, in µs or ms."""
    return f"{plain(value)} µs" if value < 1e4 else f"{plain(value / 1e3)} ms"


def scored_alike(assessment: Assessment, postures: NDArray[np.float64]) -> Assessment:
    """Score other postures (n, 32) [rad] with the method of an assessment.

    The task options are those of its first posture.
    """
    return assess_rows(read_postures(postures), assessment.method, assessment._task.rows(0))


def is_seated(assessment: Assessment) -> bool:
    """Return whether the first posture was scored as seated."""
    return bool(assessment._task.rows(0).flag("seated"))
