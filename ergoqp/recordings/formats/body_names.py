"""Names of bodies, and their people, from the names of the files of a folder."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from pathlib import Path
from typing import Final

_LEAST: Final = 6
"""Least number of bodies of each of several people."""
_MARKS: Final = "_-. "
_SIDES: Final = frozenset({"left", "right", "l", "r"})


def names_of(paths: list[Path]) -> list[str]:
    """Return the bodies' names: the file names without a shared start and end, up to a mark.

    Bodies of several people get the person as a prefix: "giver:head".
    """
    stems = [path.stem for path in paths]
    if len(set(stems)) < len(stems):
        return [path.name for path in paths]
    if len(stems) < 2:
        return stems
    begins = Counter(map(_first, stems))
    most = max(begins, key=lambda begin: begins[begin])
    ends = itertools.takewhile(
        lambda letters: len(set(letters)) == 1, zip(*map(reversed, stems), strict=False)
    )
    shared = "".join(letters[0] for letters in ends)[::-1]
    cut = re.search(r"[_\-. ].*", shared)
    behind = cut.group(0) if cut else ""
    names = [stem.removesuffix(behind) if behind else stem for stem in stems]
    if people := _people(stems):
        names = [
            f"{begin.rstrip(_MARKS)}:{name.removeprefix(begin)}" if begin in people else name
            for name, begin in zip(names, map(_first, stems), strict=True)
        ]
        empty = any(name.endswith(":") for name in names)
        return stems if empty or len(set(names)) < len(names) else names
    many = sum(_first(name) == most for name in names) > 1
    names = [name.removeprefix(most) if many else name for name in names]
    return names if len(set(names)) == len(names) and all(names) else stems


def of_people(paths: list[Path]) -> list[bool]:
    """Return which bodies are a person's: those with a common start, if others have another."""
    stems = [path.stem for path in paths]
    begins = list(map(_first, stems))
    if people := _people(stems):
        return [begin in people for begin in begins]
    most = max(begins, key=begins.count)
    alike = [begin == most for begin in begins]
    return alike if 1 < sum(alike) < len(alike) else [False] * len(alike)


def _people(stems: list[str]) -> set[str]:
    """Return the starts of names with enough bodies for a person, if there are at least two."""
    begins = Counter(begin for stem in stems if (begin := _first(stem)) != stem)
    found = {begin for begin, count in begins.items() if count >= _LEAST}
    return found if len(found) > 1 else set()


def _first(stem: str) -> str:
    """Return the start of a name up to a mark; the whole name without a mark or if it is a side."""
    match = re.match(r"[^_\-. ]+[_\-. ]", stem)
    sided = match and match.group(0)[:-1].casefold() in _SIDES
    return match.group(0) if match and not sided else stem
