"""The site: whether every page is reached, opens without a network, and can be used by everybody.

Run ``python -m tools.site [--quick | --full] [--json FILE]`` after ``make docs``, or
``--check`` for the first four figures alone, as ``make docs`` does itself.

- ``pages``: HTML pages of the site. Listings of source code, the index and the search page are
  counted like all others, but in ``clicks``.
- ``clicks``: number of links that one follows from the first page to the farthest.
- ``network``: scripts, styles, fonts, pictures and frames that a page loads from elsewhere.
- ``broken``: links within the site to a page, a file or a heading that is not there. Of listings
  only the page counts: they link to names by another path.
- ``readme_lines``: lines of README.md.
- ``public_names``: names with a page in the reference. ``tests/docs/test_reference.py`` looks for
  shapes, units, errors and an example in each.
- ``blocks``: code blocks of the site and of README that ``tests/docs/test_pages.py`` runs or reads;
  ``blocks.shown``: the others, in languages that it cannot run.
- ``axe.serious``: serious and critical findings of axe-core in headless Chromium, 1400 and 420
  pixels wide, light and dark; ``axe.pages``: how many pages these are: with ``--full`` all but
  listings, of which every twentieth; else a few. ``axe.reports.serious``, ``axe.reports``: the
  same of the pages that the commands write, see `tools.site.reports`.
"""

from __future__ import annotations

import re
import sys
from collections import deque
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from typing import Final
from urllib.parse import unquote, urldefrag, urlparse

from benchmarks.report import Report, run
from tools.site.axe import serious_of
from tools.site.reports import write_reports

ROOT: Final = Path(__file__).resolve().parents[2]
SITE: Final = ROOT / "out" / "site"
FARTHEST: Final = 2
"""Links from the first page to any other, at most."""
TESTED: Final = ("python", "sh", "toml", "json")
"""Languages of the code blocks that are run or read by a test."""
_FENCE: Final = re.compile(r"^```(\S*)", re.MULTILINE)
_LOADED: Final = {
    "script": "src",
    "img": "src",
    "iframe": "src",
    "source": "src",
    "video": "src",
    "link": "href",
}
_NO_LOAD: Final = {
    "canonical",
    "search",
    "next",
    "prev",
    "index",
    "genindex",
    "alternate",
    "author",
}


@dataclass
class Page(HTMLParser):
    """What a page links to, what it loads, and which headings can be linked to."""

    links: list[str] = field(default_factory=list)
    loads: list[str] = field(default_factory=list)
    marks: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        """Begin to read."""
        super().__init__()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Keep what an element says of the three."""
        told = {name: value for name, value in attrs if value is not None}
        self.marks |= {told[name] for name in ("id", "name") if name in told}
        if tag == "a" and "href" in told:
            self.links.append(told["href"])
        elif tag == "form" and "action" in told:
            self.links.append(told["action"])
        elif tag in _LOADED and _LOADED[tag] in told and told.get("rel") not in _NO_LOAD:
            self.loads.append(told[_LOADED[tag]])


def read_site(folder: Path) -> dict[Path, Page]:
    """Return the pages of a site by their paths."""
    found: dict[Path, Page] = {}
    for path in sorted(folder.rglob("*.html")):
        if "_static" not in path.relative_to(folder).parts:
            found[path] = Page()
            found[path].feed(path.read_text(encoding="utf-8"))
    return found


def local(page: Path, address: str) -> tuple[Path, str] | None:
    """Return the file and the mark that a link of a page leads to; None: out of the site."""
    parts = urlparse(address)
    if parts.scheme or parts.netloc:
        return None
    target, mark = urldefrag(address)
    return (page.parent / unquote(target)).resolve() if target else page, unquote(mark)


def clicks(pages: dict[Path, Page], first: Path) -> dict[Path, int]:
    """Return how many links from the first page away each page is that can be reached."""
    away, waiting = {first: 0}, deque([first])
    while waiting:
        page = waiting.popleft()
        for link in pages[page].links:
            to = local(page, link)
            if to and to[0] in pages and to[0] not in away:
                away[to[0]] = away[page] + 1
                waiting.append(to[0])
    return away


def broken(pages: dict[Path, Page]) -> list[str]:
    """Return the links within the site that lead nowhere, as sentences."""
    said = []
    for path, page in pages.items():
        for link in page.links:
            to = local(path, link)
            if to is None:
                continue
            file, mark = to
            loose = not mark or file not in pages or listing(path)
            if not file.is_file() or not (loose or mark in pages[file].marks):
                said.append(f"{path.name}: {link} leads nowhere")
    return said


def network(pages: dict[Path, Page], folder: Path) -> list[str]:
    """Return what pages and style sheets load from elsewhere, as sentences."""
    said = [
        f"{path.name}: loads {each}"
        for path, page in pages.items()
        for each in page.loads
        if local(path, each) is None and not each.startswith("data:")
    ]
    for sheet in sorted(folder.rglob("*.css")):
        text = sheet.read_text(encoding="utf-8")
        said += [
            f"{sheet.name}: {told}"
            for told in ("url(http", "url(//", '@import "http')
            if told in text
        ]
    return said


def listing(page: Path) -> bool:
    """Whether a page is a listing of source code, which the page of its name links to."""
    return "_modules" in page.parts


def judge(report: Report | None = None, folder: Path = SITE) -> list[str]:
    """Return what is wrong with the links of the site, as sentences; give a report its figures."""
    first = folder / "index.html"
    if not first.is_file():
        raise SystemExit(f"tools.site: got no {first.name} in out/site, allowed: after make docs")
    pages = read_site(folder)
    away = clicks(pages, first)
    lost = [
        f"{page.name} is not reached" for page in pages if page not in away and not listing(page)
    ]
    far = {page: steps for page, steps in away.items() if not listing(page)}
    dead, loaded = broken(pages), network(pages, folder)
    if report:
        report.figure("pages", len(pages))
        report.figure("clicks", max(far.values()) if not lost else float("inf"))
        report.figure("network", len(loaded))
        report.figure("broken", len(dead))
    tired = [
        f"{page.name} is {steps} clicks away" for page, steps in far.items() if steps > FARTHEST
    ]
    return lost + tired + dead + loaded


def languages() -> list[str]:
    """Return the language of every code block of the site and of README."""
    pages = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
    fences = (_FENCE.findall(page.read_text(encoding="utf-8"))[::2] for page in pages)
    return [each for found in fences for each in found if not each.startswith("{")]


def measure(report: Report) -> None:
    """Print the figures."""
    for said in judge(report):
        report.say(said)
    report.figure("readme_lines", len((ROOT / "README.md").read_text("utf-8").splitlines()))
    report.figure("public_names", len(list((SITE / "reference").glob("*.html"))))
    blocks = languages()
    report.figure("blocks", sum(each in TESTED for each in blocks))
    report.figure("blocks.shown", sum(each not in TESTED for each in blocks))
    pages = list(read_site(SITE))
    listings = [page for page in pages if listing(page)]
    pages = [page for page in pages if not listing(page)][:: report.pick(24, 1)]
    pages += listings[:: report.pick(len(listings), 20)]
    report.figure("axe.serious", serious_of(pages, report.say))
    report.figure("axe.pages", len(pages))
    with write_reports(report.full) as reports:
        report.figure("axe.reports.serious", serious_of(reports, report.say))
        report.figure("axe.reports", len(reports))


def main() -> None:
    """Run the command line."""
    if "--check" in sys.argv:
        wrong = judge()
        print("\n".join(wrong) if wrong else "every page is reached, and nothing is loaded")
        sys.exit(bool(wrong))
    run(measure, "Links and accessibility of the site.")


if __name__ == "__main__":
    main()
