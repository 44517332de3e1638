"""One self-contained page: what it consists of, and its rendering.

Everything that is not a picture is escaped.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path

from ergoqp._version import __version__
from ergoqp.errors import MissingExtraError
from ergoqp.files.whole import write_whole
from ergoqp.report import palette
from ergoqp.report.charts.frame import NARROW, WIDTH


@dataclass(frozen=True)
class Headline:
    """A score that the page starts with.

    Attributes:
        label: what it is, for example ``"before"``.
        value: as it is written.
        level: action level 0 to 4, -1 without a colour.
        words: below it.
        arrow: an arrow leads to it from the one before.
    """

    label: str
    value: str
    level: int
    words: str
    arrow: bool = False


@dataclass(frozen=True)
class Picture:
    """A drawing with its caption; `svg` is trusted markup, made by this package.

    Attributes:
        svg: the drawing.
        caption: below it, may be empty.
        narrow: the same drawing for a telephone; empty: `svg` is narrow enough.
    """

    svg: str
    caption: str = ""
    narrow: str = ""

    @classmethod
    def of(cls, draw: Callable[[float], str], caption: str = "") -> Picture:
        """Return what is drawn for a width [px], at the page's own and at a narrow one."""
        return cls(draw(WIDTH), caption, draw(NARROW))


@dataclass(frozen=True)
class PageTable:
    """A table: words only.

    Attributes:
        head: column titles, may be empty.
        rows: cells as they are written.
        marked: numbers of the rows to point out.
        numeric: numbers of the columns that hold numbers.
        even: all columns have the same width.
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
        intro: a sentence or two, may be empty.
        pictures: charts, one below the other.
        tables: below the charts.
        sentences: as a list, at the end.
        columns: pictures side by side instead.
        chips: what colours mean: class and words, above the pictures.
        links: pages beside this one, as a list: file name and words.
        folded: only the heading is seen until it is clicked; on paper all is.
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
        title: heading and title of the window.
        subtitle: below it.
        headlines: the scores that matter, large.
        change: between before and after, in words; may be empty.
        stays: what still costs points, each with its reason, below `change`.
        facts: name and value of the numbers that go with them.
        replay: the replay as a page of its own; empty without one.
        replay_note: what it leaves out.
        figures: flat figures of the postures that matter.
        sections: charts and tables.
        notes: what else is not well, a sentence each, below them.
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
        page: what it consists of.
        path: of the HTML file; its folder exists.

    Raises:
        MissingExtraError: if jinja2 is not installed.
        OSError: if the file cannot be written.
    """
    write_whole(path, render(page))


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
