"""Guess of what unknown joints are, from the words in their names.

The guess is only shown to the user: in a message, and in a mapping file to be checked. Markers on
the skin are no joints: if there are some, only places on the skin are guessed.
"""

from __future__ import annotations

import re
import tomllib
import unicodedata
from collections.abc import Mapping
from functools import cache
from importlib import resources
from itertools import pairwise
from typing import Any, Final

_LEAST: Final = 3
"""Least number of places on the skin that are not there by chance."""
_CHAINS: Final = ("knuckles", "thumb", "toe")
"""Centres whose bones are numbered along a finger or toe."""
_NUMBERED: Final = re.compile(r"\d").search


@cache
def data_of(name: str) -> dict[str, Any]:
    """Return the content of a TOML file of this folder."""
    file = resources.files("ergoqp.mocap").joinpath(name)
    return tomllib.loads(file.read_text(encoding="utf-8"))


def guessed(names: tuple[str, ...]) -> dict[str, str]:
    """Return our centre or landmark -> the joint or marker with the most similar name, if any is.

    >>> guessed(("Skel_L_Elbow", "Skel_R_UpperArm", "box"))
    {'right_shoulder': 'Skel_R_UpperArm', 'left_elbow': 'Skel_L_Elbow'}
    """
    known = data_of("name_words.toml")
    marks = _landmarks(names)
    if len(marks) >= _LEAST:
        return marks
    best: dict[str, tuple[int, int, str]] = {}
    clusters = _clusters(names)
    for name in names:
        words = _words(name)
        side = _side(words)
        joined = {"".join(pair) for pair in pairwise(words)} | set(words)
        if joined & set(known["skin"]["words"]):
            continue
        if side is not None:
            # As in "LeftHandThumb1". On the middle line a number belongs to the name, as in "c7".
            joined |= {bare for word in joined if len(bare := _bare(word)) > 2}
        said = [
            (-len(word), rank, part)
            for part, theirs in known["middle" if side is None else "sided"].items()
            for rank, word in enumerate(theirs)
            if word in joined
        ]
        if not said:
            continue
        # The longest word decides: "HandThumb" is a thumb.
        _, rank, part = min(said)
        if name in clusters and part not in _CHAINS:
            continue
        centre = part if side is None else f"{side}_{part}"
        # Of several names the one with the most usual and the fewest words is taken.
        best[centre] = min(best.get(centre, (rank, len(words), name)), (rank, len(words), name))
    order = [*known["middle"], *(f"{s}_{p}" for s in known["sides"] for p in known["sided"])]
    return {centre: best[centre][2] for centre in order if centre in best}


def _landmarks(names: tuple[str, ...]) -> dict[str, str]:
    """Return our landmark -> the marker whose name has all words of that place."""
    places = data_of("name_words.toml")["skin"]
    best: dict[str, tuple[int, str]] = {}
    for name in names:
        words = _words(name)
        side, there = _side(words), {*words, *map(_bare, words)}
        for part, theirs in places["middle" if side is None else "sided"].items():
            if any(there.issuperset(each.split()) for each in theirs):
                mark = part if side is None else f"{side}_{part}"
                best[mark] = min(best.get(mark, (len(words), name)), (len(words), name))
    return {mark: name for mark, (_, name) in best.items()}


def _clusters(names: tuple[str, ...]) -> set[str]:
    """Return the names that differ from others by a number only: markers beside each other."""
    alike: dict[str, list[str]] = {}
    for name in names:
        alike.setdefault("".join(map(_bare, _words(name))), []).append(name)
    several = [each for each in alike.values() if len(each) > 1]
    return {n for each in several if all(map(_NUMBERED, each)) for n in each}


def _side(words: list[str]) -> str | None:
    """Return the side that the words of a name state."""
    sides = data_of("name_words.toml")["sides"]
    return next((side for side, theirs in sides.items() if set(words) & set(theirs)), None)


def _bare(word: str) -> str:
    return word.rstrip("0123456789")


def is_body_part(name: str) -> bool:
    """Return whether the name of a thing is that of a part of the body.

    >>> is_body_part("giver_Chest"), is_body_part("LeftHand 2"), is_body_part("hand drill")
    (True, True, False)
    """
    known = data_of("name_words.toml")["body"]
    words = list(map(_bare, _words(name)))
    words = [word for word in words if word and word not in known["beside"]]
    return bool(words) and words[-1] in known["parts"]


def template(names: tuple[str, ...], wanted: tuple[str, ...]) -> str:
    """Return the text of a mapping file: a guess for each centre, or a line to be filled in.

    Args:
        names: names of the recording's joints.
        wanted: our centres.
    """
    guess: Mapping[str, str] = guessed(names)
    rows = [
        "# Which joint of the recording is which centre of the body. These are guesses from the"
        " names: check them.",
        "# A list stands for the middle of several joints; lines that begin with # are ignored.",
        *(
            f"{centre} = {_quoted(guess[centre])}" if centre in guess else f'# {centre} = ""'
            for centre in wanted
        ),
        "",
        "# The recording has:",
        *(f"#   {_quoted(name)}" for name in names),
    ]
    return "\n".join(rows) + "\n"


def _words(name: str) -> list[str]:
    """Return the words of a name in small letters: "LeftForeArm_2" has left, fore and arm."""
    letters = unicodedata.normalize("NFC", name).translate(_UMLAUTS)
    decomposed = unicodedata.normalize("NFD", letters)
    plain = "".join(letter for letter in decomposed if not unicodedata.combining(letter))
    parts = re.findall(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+\d*|[A-Z]+\d*", plain)
    data = data_of("name_words.toml")
    known = {
        word
        for places in (data, data["skin"])
        for theirs in (*places["middle"].values(), *places["sided"].values())
        for words in theirs
        for word in words.split()
    }
    words = []
    for part in (part.casefold() for part in parts):
        # "LElbow" and "lElbow": the side is the first letter.
        sided = part[0] in "lr" and part[1:] in known
        words += [part[0], part[1:]] if sided else [part]
    return words


def _quoted(name: str) -> str:
    """Return a name as a TOML string; a lone surrogate, which no file can hold, becomes "?"."""
    text = name.encode("utf-8", "replace").decode().replace("\\", "\\\\").replace('"', '\\"')
    return f'"{"".join(each if each.isprintable() else _escaped(each) for each in text)}"'


def _escaped(letter: str) -> str:
    code = ord(letter)
    return f"\\u{code:04x}" if code < 1 << 16 else f"\\U{code:08x}"


_UMLAUTS: Final = str.maketrans(
    {"ä": "ae", "ö": "oe", "ü": "ue", "Ä": "Ae", "Ö": "Oe", "Ü": "Ue", "ß": "ss"}
)
