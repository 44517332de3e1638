"""The code blocks of a page, and what its author says of them in comments that no reader sees.

``<!-- given: robot, take -->`` above a block names what it needs, of `page_given.GIVEN`;
``<!-- not run: why -->`` above one of a language that no test can run says why.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

_FENCE = re.compile(r"^(?P<mark>`{3,}|:{3,})(?P<language>[\w{}+-]*)[^\n]*$")
_GIVEN = re.compile(r"^<!-- given: (?P<names>.+) -->$")
_NOT_RUN = re.compile(r"^<!-- not run: (?P<why>.+) -->$")


@dataclass(frozen=True)
class Block:
    """A code block.

    Attributes:
        language: as its fence says.
        text: what is in it.
        line: of its first line in the page.
        given: what it needs.
        not_run: why it is not run, or an empty text.
    """

    language: str
    text: str
    line: int
    given: tuple[str, ...]
    not_run: str


def blocks_of(page: Path) -> list[Block]:
    """Return the code blocks of a page in their order; directives as ``{toctree}`` are none."""
    found: list[Block] = []
    given: tuple[str, ...] = ()
    not_run, inside, language, first = "", "", "", 0
    rows: list[str] = []
    for number, row in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
        if inside:
            if row.strip() == inside:
                if not language.startswith("{"):
                    found.append(Block(language, "\n".join(rows) + "\n", first, given, not_run))
                given, not_run, inside = (), "", ""
            else:
                rows.append(row)
        elif fence := _FENCE.match(row):
            inside, language, first, rows = fence["mark"], fence["language"], number + 1, []
        elif match := _GIVEN.match(row):
            given = tuple(name.strip() for name in match["names"].split(","))
        elif match := _NOT_RUN.match(row):
            not_run = match["why"]
    assert not inside, f"{page.name}: a block has no end"
    return found
