"""Our names of joint centres, and guesses of what other names mean.

Guess of what unknown joints are, from the words in their names.

The guess is only shown to the user: in a message, and in a mapping file to be checked.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from itertools import pairwise
from typing import Final

CENTRES: Final[tuple[str, ...]] = (
    "pelvis",
    "neck",
    "head",
    "head_top",
    "nose",
    *(
        f"{side}_{name}"
        for side in ("right", "left")
        for name in ("shoulder", "elbow", "wrist", "knuckles", "thumb")
    ),
    *(f"{side}_{name}" for side in ("right", "left") for name in ("hip", "knee", "ankle", "toe")),
)
"""The joint centres that a recording can be mapped to: frames of `ergoqp.human.FRAMES`.

``pelvis`` is the middle of the hip centres, ``neck`` the base of the neck, ``head`` the base of the
skull.

Example:
    >>> from ergoqp.mocap.names import CENTRES
    >>> "right_elbow" in CENTRES
    True
"""


_NAMELESS: Final = re.compile(r"[*U]?\d*|C_\d+|unlabell?ed.*", re.IGNORECASE)


def nameless(name: str) -> bool:
    """Return whether a marker's name, without its prefix, is one that programs give by default.

    >>> nameless("*21"), nameless("Anna:U7"), nameless("LASI")
    (True, True, False)
    """
    return _NAMELESS.fullmatch(name.rpartition(":")[2]) is not None


def squashed(name: str) -> str:
    """Return a name in small letters, without the separators of its words.

    >>> squashed("Left Elbow_2") == squashed("LEFT.ELBOW-2")
    True
    """
    return re.sub(r"[\s_.\-]+", "", name.casefold())


def parted(name: str) -> tuple[str, str]:
    """Return the prefix of a joint's or marker's name, which states the person, and the rest.

    The prefix stands before the last colon or slash. A slash at the very front is ignored.

    >>> parted("Anna:LASI"), parted("/human/left_elbow"), parted("neck")
    (('Anna', 'LASI'), ('human', 'left_elbow'), ('', 'neck'))
    """
    at = max(name.rfind(":"), name.rfind("/"))
    return name[: max(at, 0)].lstrip("/"), name[at + 1 :]


_SIDES: Final = {
    "right": ("right", "rt", "r", "re", "rechts", "rechte", "droite", "droit"),
    "left": ("left", "lt", "l", "li", "links", "linke", "gauche"),
}
_WORDS: Final[dict[str, tuple[str, ...]]] = {
    "pelvis": ("pelvis", "hips", "root", "belt", "waist", "midhip", "becken", "bassin"),
    "neck": ("neck", "c7", "spineshoulder", "hals", "cou"),
    "head": ("head", "skull", "kopf", "tete"),
    "head_top": ("headtop", "headend", "vertex"),
    "nose": ("nose", "nase", "nez"),
    "shoulder": ("shoulder", "uarm", "upperarm", "humerus", "glenohumeral", "schulter", "epaule"),
    "elbow": ("elbow", "farm", "forearm", "lowerarm", "radius", "ellbogen", "coude"),
    "wrist": ("wrist", "hand", "handgelenk", "poignet"),
    "knuckles": ("knuckles", "index", "middle", "fingers", "finger"),
    "thumb": ("thumb", "daumen", "pouce"),
    "hip": ("hip", "thigh", "upleg", "upperleg", "femur", "huefte", "hanche"),
    "knee": ("knee", "shank", "calf", "shin", "lowerleg", "leg", "tibia", "knie", "genou"),
    "ankle": ("ankle", "foot", "knoechel", "cheville"),
    "toe": ("toe", "toes", "toebase", "ball", "zehe"),
}
_MIDDLE: Final = ("pelvis", "neck", "head", "head_top", "nose")


def guessed(names: tuple[str, ...]) -> dict[str, str]:
    """Return our centre -> the joint with the most similar name, if any is similar.

    >>> guessed(("Skel_L_Elbow", "Skel_R_UpperArm", "box"))
    {'right_shoulder': 'Skel_R_UpperArm', 'left_elbow': 'Skel_L_Elbow'}
    """
    best: dict[str, tuple[int, int, str]] = {}
    for name in names:
        words = _words(name)
        side = next((s for s, theirs in _SIDES.items() if set(words) & set(theirs)), None)
        joined = {"".join(pair) for pair in pairwise(words)} | set(words)
        if side is not None:
            # As in "LeftHandThumb1". On the middle line a number belongs to the name, as in "c7".
            joined |= {bare for word in joined if len(bare := word.rstrip("0123456789")) > 2}
        said = [
            (-len(word), rank, part)
            for part, theirs in _WORDS.items()
            if (part in _MIDDLE) == (side is None)
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
    order = [*_MIDDLE, *(f"{s}_{p}" for s in _SIDES for p in _WORDS if p not in _MIDDLE)]
    return {centre: best[centre][2] for centre in order if centre in best}


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
    plain = "".join(
        letter
        for letter in unicodedata.normalize("NFD", letters)
        if not unicodedata.combining(letter)
    )
    parts = re.findall(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+\d*|[A-Z]+\d*", plain)
    found = [part.casefold() for part in parts]
    # "LElbow" and "lElbow": the side is the first letter.
    return [
        word
        for part in found
        for word in ([part[0], part[1:]] if part[0] in "lr" and part[1:] in _KNOWN else [part])
    ]


def _quoted(name: str) -> str:
    """Return a name as a TOML string; a lone surrogate, which no file can hold, becomes "?"."""
    text = name.encode("utf-8", "replace").decode().replace("\\", "\\\\").replace('"', '\\"')
    return f'"{"".join(each if each.isprintable() else _escaped(each) for each in text)}"'


def _escaped(letter: str) -> str:
    code = ord(letter)
    return f"\\u{code:04x}" if code < 1 << 16 else f"\\U{code:08x}"


_KNOWN: Final = frozenset(word for words in _WORDS.values() for word in words)
_UMLAUTS: Final = str.maketrans(
    {"ä": "ae", "ö": "oe", "ü": "ue", "Ä": "Ae", "Ö": "Oe", "Ü": "Ue", "ß": "ss"}
)
