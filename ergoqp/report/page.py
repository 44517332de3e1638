"""One self-contained page: its parts, how it is rendered, and numbers for people.

Everything except pictures is escaped.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ergoqp._version import __version__
from ergoqp.errors import MissingExtraError
from ergoqp.files.atomic import write_text_atomic
from ergoqp.report import palette
from ergoqp.report.charts.axes import NARROW, WIDTH
from ergoqp.sheets.assessment import Assessment, assess_rows, read_postures


@dataclass(frozen=True)
class Headline:
    """A score at the top of the page.

    Attributes:
        label: what it is, for example ``"before"``.
        value: the score as text.
        level: action level 0 to 4, -1 without a colour.
        words: text below it.
        arrow: whether an arrow leads to it from the one before.
    """

    label: str
    value: str
    level: int
    words: str
    arrow: bool = False


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
    def of(cls, draw: Callable[[float], str], caption: str = "") -> Picture:
        """Return a drawing, given as a function of the width [px], at both widths of the page."""
        return cls(draw(WIDTH), caption, draw(NARROW))


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
        change: difference between before and after, in words; may be empty.
        stays: segments that still cost points, each with its reason, below `change`.
        facts: names and values of further numbers.
        replay: the replay as a page of its own; empty without one.
        replay_note: how the replay differs from real time.
        figures: flat figures of the important postures.
        sections: charts and tables.
        notes: further problems, one sentence each.
    """

    title: str
    subtitle: str
    headlines: Sequence[Headline]
    change: str
    facts: Sequence[tuple[str, str]]
    replay: str
    replay_note: str
    figures: Sequence[Picture]
    sections: Sequence[Section] = field(default_factory=tuple)
    notes: Sequence[str] = field(default_factory=tuple)
    stays: Sequence[str] = field(default_factory=tuple)


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
