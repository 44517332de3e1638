"""Guess of what unknown joints are, from the words in their names.

The guess is only shown to the user: in a message, and in a mapping file to be checked.
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


@cache
def data_of(name: str) -> dict[str, Any]:
    """Return the content of a TOML file of this folder."""
    file = resources.files("ergoqp.mocap").joinpath(name)
    return tomllib.loads(file.read_text(encoding="utf-8"))


def guessed(names: tuple[str, ...]) -> dict[str, str]:
    """Return our centre -> the joint with the most similar name, if any is similar.

    >>> guessed(("Skel_L_Elbow", "Skel_R_UpperArm", "box"))
    {'right_shoulder': 'Skel_R_UpperArm', 'left_elbow': 'Skel_L_Elbow'}
    """
    known = data_of("name_words.toml")
    best: dict[str, tuple[int, int, str]] = {}
    for name in names:
        words = _words(name)
        side = next((s for s, theirs in known["sides"].items() if set(words) & set(theirs)), None)
        joined = {"".join(pair) for pair in pairwise(words)} | set(words)
        if side is not None:
            # As in "LeftHandThumb1". On the middle line a number belongs to the name, as in "c7".
            joined |= {bare for word in joined if len(bare := word.rstrip("0123456789")) > 2}
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
        centre = part if side is None else f"{side}_{part}"
        # Of several names the one with the most usual and the fewest words is taken.
        best[centre] = min(best.get(centre, (rank, len(words), name)), (rank, len(words), name))
    order = [*known["middle"], *(f"{s}_{p}" for s in known["sides"] for p in known["sided"])]
    return {centre: best[centre][2] for centre in order if centre in best}


def is_body_part(name: str) -> bool:
    """Return whether the name of a thing is that of a part of the body.

    >>> is_body_part("giver_Chest"), is_body_part("LeftHand 2"), is_body_part("hand drill")
    (True, True, False)
    """
    known = data_of("name_words.toml")["body"]
    words = [word.rstrip("0123456789") for word in _words(name)]
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
    known = {
        word
        for which in ("middle", "sided")
        for theirs in data_of("name_words.toml")[which].values()
        for word in theirs
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
