"""Which names belong to which joint centre or landmark, and guesses of what others mean.

Guess of what unknown joints are, from the words in their names.

The guess is only shown to the user: in a message, and in a mapping file to be checked.

Assignment of a recording's joints to the joint centres of the body, by their names. The known
namings are data. All other names need a mapping file.
"""

from __future__ import annotations

import re
import tomllib
import unicodedata
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import casadi as ca
import numpy as np

from ergoqp.errors import InputError, RecordingError, UnknownNamesError
from ergoqp.files.read import read_toml
from ergoqp.human import FRACTIONS, Body, Kinematics
from ergoqp.human.body import GROWTH
from ergoqp.joints import JOINTS, SIDES
from ergoqp.mocap.formats.text import some
from ergoqp.mocap.recording import JointMotion

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
    >>> from ergoqp.mocap.naming import CENTRES
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


@cache
def _data(name: str) -> dict[str, Any]:
    """Return the content of a TOML file of this folder."""
    file = resources.files("ergoqp.mocap").joinpath(name)
    return tomllib.loads(file.read_text(encoding="utf-8"))


def guessed(names: tuple[str, ...]) -> dict[str, str]:
    """Return our centre -> the joint with the most similar name, if any is similar.

    >>> guessed(("Skel_L_Elbow", "Skel_R_UpperArm", "box"))
    {'right_shoulder': 'Skel_R_UpperArm', 'left_elbow': 'Skel_L_Elbow'}
    """
    known = _data("name_words.toml")
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
        for theirs in _data("name_words.toml")[which].values()
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


_UNPAIRED: Final = ("pelvis", "trunk", "head")
"""Segments in the middle of the body."""


LANDMARK_SEGMENTS: Final[dict[str, list[str]]] = {
    **_data("landmarks.toml")["middle"],
    **{
        f"{side}_{name}": [part if part in _UNPAIRED else f"{side}_{part}" for part in parts]
        for side in SIDES
        for name, parts in _data("landmarks.toml")["sided"].items()
    },
}
"""Landmark -> the segments that a marker there may be fixed to."""


LANDMARKS: Final = tuple(LANDMARK_SEGMENTS)
"""Names of the places of markers on the skin, of ``landmarks.toml``; those on both sides begin with
the side.

Example:
    >>> from ergoqp.mocap.naming import LANDMARKS
    >>> "c7" in LANDMARKS, "right_asis" in LANDMARKS
    (True, True)
"""


RIGID: Final[dict[str, list[str]]] = _data("landmarks.toml")["rigid"]
"""Segments that are tracked as rigid shapes -> their landmarks."""


_BELOW: Final = ("asis", "psis", "sacrum", "thigh", "knee", "shank", "ankle", "heel", "forefoot")


_LEAST: Final = 8
"""Fewer landmarks than this may match by chance."""


@dataclass(frozen=True)
class MarkerSet:
    """A convention for the names of markers.

    Attributes:
        title: its name in messages.
        landmarks: landmark -> possible names; the first one in the recording is used.
        more: rigid segment -> further markers on it.
    """

    title: str
    landmarks: Mapping[str, tuple[str, ...]]
    more: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def found_in(self, names: tuple[str, ...]) -> dict[str, str]:
        """Return landmark -> its marker, for the markers among `names`."""
        found = _known_among(names, self.landmarks)
        return {landmark: theirs[0] for landmark, theirs in found.items() if theirs}

    def more_in(self, names: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
        """Return rigid segment -> its further markers among `names`."""
        return _known_among(names, self.more)


def _known_among(
    names: tuple[str, ...], known: Mapping[str, tuple[str, ...]]
) -> dict[str, tuple[str, ...]]:
    """Return which of the known names of each thing are among others, as they are written there."""
    there = {squashed(name): name for name in reversed(names)}
    return {
        thing: tuple(there[squashed(name)] for name in theirs if squashed(name) in there)
        for thing, theirs in known.items()
    }


def above_hips(landmark: str) -> bool:
    """Return whether a landmark, a joint centre or a rigid segment is above the hips."""
    return not landmark.endswith((*_BELOW, "pelvis", "hip", "toe"))


@cache
def known_sets() -> tuple[MarkerSet, ...]:
    """Return the sets of ``marker_sets.toml``, in its order."""
    return tuple(_set(entry) for entry in _data("marker_sets.toml").values())


def best_set(names: tuple[str, ...]) -> tuple[MarkerSet, int] | None:
    """Return the set with the most landmarks among `names`, and their number; None if too few."""
    counts = [(len(each.found_in(names)), each) for each in known_sets()]
    count, best = max(counts, key=lambda pair: pair[0])
    return (best, count) if count >= _LEAST else None


def _set(entry: Mapping[str, Any]) -> MarkerSet:
    landmarks = _listed(entry.get("middle", {}))
    for side in SIDES:
        letters = {"S": side[0].upper(), "s": side[0], "side": side}
        for name, theirs in _listed({**entry.get("sided", {}), **entry.get(side, {})}).items():
            landmarks[f"{side}_{name}"] = tuple(each.format(**letters) for each in theirs)
    return MarkerSet(entry["title"], landmarks, _listed(entry.get("more", {})))


_EXAMPLE: Final = 'right_elbow = "theirs"'
_LEAST_MATCHED = 8  # fewer may match by chance: every skeleton has a "Neck" and a "Head"


@dataclass(frozen=True)
class Naming:
    """A convention for the names of joints.

    Attributes:
        title: its name in messages.
        centres: our centre -> the names of the joints whose middle it is.
        upright_rest: whether a skeleton of this naming stands upright and looks straight ahead in
            its rest pose.
        turned: our centre -> the segment whose orientation determines it, and its place in the axes
            of that segment, in lengths of the trunk.
    """

    title: str
    centres: Mapping[str, tuple[str, ...]]
    upright_rest: bool = False
    turned: Mapping[str, tuple[str, tuple[float, ...]]] = field(default_factory=dict)

    def found_in(self, names: tuple[str, ...]) -> dict[str, tuple[int, ...]]:
        """Return the indices of the joints of each centre whose joints are all among `names`.

        Upper and lower case, separators of words and a prefix that all names share ("mixamorig:",
        "Character1_", "human/") are ignored.
        """
        # An exact match is preferred, then the first of several names that differ only in spelling.
        named = [(i, name) for i, name in reversed(list(enumerate(names)))]
        places: dict[str, int] = {}
        for prefix in _shared_prefixes(names):
            places |= {squashed(name.removeprefix(prefix)): i for i, name in named}
        exactly = dict(zip(names, range(len(names)), strict=True))
        found = {
            centre: tuple(exactly.get(name, places.get(squashed(name), -1)) for name in theirs)
            for centre, theirs in self.centres.items()
        }
        return {centre: which for centre, which in found.items() if min(which) >= 0}


@cache
def known_namings() -> tuple[Naming, ...]:
    """Return the namings of ``namings.toml``, in its order."""
    return tuple(
        Naming(
            entry["title"],
            _listed(entry["centres"]),
            entry.get("upright_rest", False),
            {name: (part, tuple(place)) for name, (part, place) in entry.get("turned", {}).items()},
        )
        for entry in _data("namings.toml").values()
    )


def read_mapping(path: Path) -> Naming:
    """Read a mapping file of TOML lines ``our_centre = "their joint"``.

    A line may also have a list of joints, which stands for their middle.

    Args:
        path: the mapping file.

    Raises:
        InputError: if the file is not readable TOML, or a name is neither one of `CENTRES` nor one
            of `LANDMARKS`.
    """
    entries = read_toml(path, "mapping file")
    for centre, theirs in entries.items():
        if centre not in CENTRES and centre not in LANDMARKS:
            raise InputError(
                f"mapping file {path.name}: got the centre {centre!r}, allowed are"
                f" {', '.join(CENTRES)}; for markers on the skin {', '.join(LANDMARKS)}"
            )
        listed = theirs if isinstance(theirs, list) else [theirs]
        if not listed or not all(isinstance(name, str) for name in listed):
            raise InputError(
                f"mapping file {path.name}: {centre} is {theirs!r}, allowed is the name of a joint"
                " or a list of names"
            )
    return Naming(f"mapping file {path.name}", _listed(entries))


def naming_of(
    motion: JointMotion, mapping: Naming | None, where: str
) -> tuple[Naming, dict[str, tuple[int, ...]]]:
    """Return the naming of a recording's joints, and our centre -> the indices of its joints.

    Args:
        motion: the recording's own joints.
        mapping: naming of its joints; None tries the known namings.
        where: the file's name, for messages.

    Raises:
        RecordingError: if the joints are of no known naming, the mapping names joints that are not
            in the recording, or the pelvis or the upper trunk cannot be placed.
    """
    if mapping is None:
        naming = max(known_namings(), key=lambda known: _agreement(known, motion.names))
        found = naming.found_in(motion.names)
        if len(found) < min(_LEAST_MATCHED, len(motion.names)) or not found:
            raise _unknown(motion.names, where)
    else:
        naming = mapping
        found = naming.found_in(motion.names)
        check_all_there(naming, found, motion.names, where)
    check_placed(tuple(found), where)
    return naming, found


def named_centres(
    motion: JointMotion,
    naming: Naming,
    found: Mapping[str, tuple[int, ...]],
    more: Mapping[str, np.ndarray],
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return our centre -> positions (n, 3), and -> position (3,) in an upright rest pose.

    The latter are empty if there is no such pose, or it is not known to be upright.

    Args:
        motion: the recording's own joints.
        naming: naming of the joints.
        found: our centre -> the indices of its joints.
        more: further centres -> positions (n, 3).
    """
    # These are copies, so that the memory of the motion can be freed.
    paths = {
        centre: motion.positions[:, list(which)].mean(axis=1) for centre, which in found.items()
    }
    kind = motion.positions.dtype
    paths |= {centre: path.astype(kind) for centre, path in more.items()}
    if motion.rest is None or not naming.upright_rest:
        return paths, {}
    return paths, {centre: motion.rest[list(which)].mean(axis=0) for centre, which in found.items()}


def _unknown(names: tuple[str, ...], where: str) -> UnknownNamesError:
    """Return the error for unknown names, with the nearest guess."""
    guess = guessed(names)
    nearest = ", ".join(f'{centre} = "{name}"' for centre, name in list(guess.items())[:3])
    return UnknownNamesError(
        f"{where}: got the joints or markers {some(names, 8)}, whose names are unknown; state a"
        f" mapping file with lines such as {nearest or _EXAMPLE}"
        " (mapping)",
        names,
    )


def check_all_there(
    naming: Naming, found: Collection[str], names: tuple[str, ...], where: str
) -> None:
    """Raise if a mapping names joints that the recording does not have.

    Raises:
        RecordingError: if it does, with their names.
    """
    if missing := [
        name for centre, theirs in naming.centres.items() if centre not in found for name in theirs
    ]:
        raise RecordingError(
            f"{where}: the {naming.title} names {some(tuple(missing))}, which the recording does"
            f" not have; it has {some(names)}"
        )


def check_placed(centres: Collection[str], where: str) -> None:
    """Raise if the pelvis or the upper trunk cannot be placed from these centres.

    Raises:
        RecordingError: if so, with the centres that are needed.
    """
    for part, needed in (
        ("the pelvis", ("pelvis", "right_hip", "left_hip")),
        ("the upper trunk", ("neck", "right_shoulder", "left_shoulder")),
    ):
        if not any(centre in centres for centre in needed):
            raise RecordingError(
                f"{where}: {part} cannot be placed; the recording needs at least one of"
                f" {', '.join(needed)}"
            )


def _listed(entries: Mapping[str, Any]) -> dict[str, tuple[str, ...]]:
    return {
        centre: (theirs,) if isinstance(theirs, str) else tuple(theirs)
        for centre, theirs in entries.items()
    }


def _agreement(naming: Naming, names: tuple[str, ...]) -> tuple[int, float]:
    """Return the number of centres that a naming finds, and their share of its own centres.

    With equal numbers, the larger share wins: the naming that expects fewer further joints.
    """
    found = len(naming.found_in(names))
    return found, found / len(naming.centres)


def _shared_prefixes(names: tuple[str, ...]) -> list[str]:
    """Return the prefixes that all names share, the longest first; the last one is empty."""
    first = names[0] if names else ""
    starts = [first[: i + 1] for i, letter in enumerate(first) if letter in ":/_"]
    return [s for s in reversed(starts) if all(name.startswith(s) for name in names)] + [""]


_MEASURED: Final = tuple(
    centre for centre in CENTRES if not centre.endswith(("nose", "knuckles", "thumb"))
)
"""Centres with an anatomical position; the others only define a direction."""


_BLOCK: Final = 4096
"""Frames that are evaluated at once, to save memory."""


def placed(names: Iterable[str]) -> list[str]:
    """Return those of some centres that have an anatomical position."""
    return [name for name in names if name in _MEASURED]


def centres_of(body: Body, pelvis: np.ndarray, postures: np.ndarray) -> dict[str, np.ndarray]:
    """Return the body's joint centres that have an anatomical position.

    Args:
        body: the person.
        pelvis: x, y, z [m] and yaw [rad] (n, 4).
        postures: joint angles (n, 32) [rad].

    Returns:
        Centre -> positions (n, 3) [m].

    Example:
        >>> import numpy as np
        >>> from ergoqp.human import Body

        >>> pelvis = np.array([[0.0, 0.0, 0.9, 0.0]])
        >>> centres = centres_of(Body(), pelvis, np.zeros((1, 32)))
        >>> float(centres["left_wrist"][0, 1].round(3))
        0.184
    """
    values = evaluated(_centres_function(), body, pelvis, postures)
    places = values.reshape(len(_MEASURED), 3, -1)
    return {centre: place.T for centre, place in zip(_MEASURED, places, strict=True)}


def evaluated(
    function: ca.Function, body: Body, pelvis: np.ndarray, postures: np.ndarray
) -> np.ndarray:
    """Return the values (m, n) of a function of pelvis and posture (36,) and growth (14,).

    Args:
        function: the function, with a column of m values.
        body: the person.
        pelvis: x, y, z [m] and yaw [rad] (n, 4).
        postures: joint angles (n, 32) [rad].
    """
    z, growth = np.hstack([pelvis, postures]), growth_of(body)
    starts = range(0, len(z), _BLOCK)
    return np.hstack([np.array(function(z[at : at + _BLOCK].T, growth)) for at in starts])


def growth_of(body: Body) -> np.ndarray:
    """Return a body's growth over the nominal body (14,), in the order of `GROWTH`."""
    nominal = Body()
    whole = body.stature / nominal.stature
    growth = [whole - 1]
    growth += [body.lengths[name] / nominal.lengths[name] - whole for name in FRACTIONS]
    return np.array(growth)


def of_any_body() -> tuple[ca.SX, ca.SX, Kinematics, ca.SX]:
    """Return symbols of pelvis and posture (36,) and growth (14,), the body and its yaw (3, 3)."""
    z, growth = ca.SX.sym("z", 4 + len(JOINTS)), ca.SX.sym("growth", len(GROWTH))
    cos, sin = ca.cos(z[3]), ca.sin(z[3])
    yaw = ca.blockcat([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    return z, growth, Kinematics(Body(), growth), yaw


@cache
def _centres_function() -> ca.Function:
    """Return a function: pelvis and posture (36,), growth (14,) -> positions of `_MEASURED`."""
    z, growth, kinematics, yaw = of_any_body()
    places = [z[:3] + yaw @ kinematics.at(centre, z[4:])[0] for centre in _MEASURED]
    return ca.Function("centres", [z, growth], [ca.densify(ca.cse(ca.vertcat(*places)))])
