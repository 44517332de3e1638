"""Which names belong to which joint centre or landmark.

Assignment of a recording's joints to the joint centres of the body, by their names. The known
namings are data. A mapping file adds to them, and all other names need one.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
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
from ergoqp.mocap.name_words import data_of, guessed
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


_UNPAIRED: Final = ("pelvis", "trunk", "head")
"""Segments in the middle of the body."""


LANDMARK_SEGMENTS: Final[dict[str, list[str]]] = {
    **data_of("landmarks.toml")["middle"],
    **{
        f"{side}_{name}": [part if part in _UNPAIRED else f"{side}_{part}" for part in parts]
        for side in SIDES
        for name, parts in data_of("landmarks.toml")["sided"].items()
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


RIGID: Final[dict[str, list[str]]] = data_of("landmarks.toml")["rigid"]
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
    return tuple(_set(entry) for entry in data_of("marker_sets.toml").values())


def best_set(names: tuple[str, ...]) -> tuple[MarkerSet, int] | None:
    """Return the set with the most landmarks among `names`, and their number; None if too few."""
    counts = [(len(each.found_in(names)), each) for each in known_sets()]
    count, best = max(counts, key=lambda pair: pair[0])
    return (best, count) if count >= _LEAST else None


def landmarks_in(names: tuple[str, ...]) -> tuple[MarkerSet, dict[str, str]] | None:
    """Return the set with the most landmarks, and landmark -> marker by all sets; None if too few.

    A landmark that this set does not find is found by a name of another set, if all sets mean the
    same by it: one laboratory's names are seldom those of one guide.
    """
    best = max(known_sets(), key=lambda each: len(each.found_in(names)))
    found = best.found_in(names)
    taken = {*found.values(), *(name for theirs in best.more_in(names).values() for name in theirs)}
    for name in names:
        mark = _everywhere().get(squashed(name))
        if mark is not None and mark not in found and name not in taken:
            found[mark] = name
    return (best, found) if len(found) >= _LEAST else None


@cache
def _everywhere() -> dict[str, str]:
    """Return squashed name -> landmark, for the names by which all sets mean the same landmark."""
    meanings: dict[str, set[str]] = {}
    for each in known_sets():
        for thing, theirs in (*each.landmarks.items(), *each.more.items()):
            for name in theirs:
                meanings.setdefault(squashed(name), set()).add(thing)
    meant = {name: things.pop() for name, things in meanings.items() if len(things) == 1}
    return {name: thing for name, thing in meant.items() if thing in LANDMARKS}


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

    @property
    def left_out(self) -> frozenset[str]:
        """The centres that have an empty name: they are not read."""
        return frozenset(centre for centre, theirs in self.centres.items() if theirs == ("",))

    def missing_in(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """Return a sentence about the joints of this naming that are not among others, if any."""
        found = self.found_in(names)
        lost = {c: theirs for c, theirs in self.centres.items() if c not in found}
        alone = {
            name: ()
            for centre, theirs in lost.items()
            if centre not in self.left_out
            for name in theirs
            if not Naming("", {centre: (name,)}).found_in(names)
        }
        if not alone:
            return ()
        return (f"The {self.title} names {some(list(alone))}, which the recording does not have.",)


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
        for entry in data_of("namings.toml").values()
    )


def read_mapping(path: Path) -> Naming:
    """Read a mapping file of TOML lines ``our_centre = "their joint"``.

    A line may also have a list of joints, which stands for their middle. The lines are added to the
    known names. An empty name leaves out what the known names find.

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
        mapping: naming that is added to the known ones; None: the known ones alone.
        where: the file's name, for messages.

    Raises:
        RecordingError: if the joints are of no known naming, or the pelvis or the upper trunk
            cannot be placed.
    """
    naming = max(known_namings(), key=lambda known: _agreement(known, motion.names))
    found = naming.found_in(motion.names)
    known = len(found) >= min(_LEAST_MATCHED, len(motion.names)) and bool(found)
    if mapping is None:
        if not known:
            raise _unknown(motion.names, where)
        check_placed(found, where, names=motion.names, read=_joints(motion, found))
        return naming, found
    own = mapping.found_in(motion.names)
    if known:
        own = added_to(mapping, own, found)
    if not known or set(own) <= set(mapping.centres):
        naming = mapping
    lost = mapping.missing_in(motion.names)
    check_placed(own, where, lost, names=motion.names, read=_joints(motion, own))
    return replace(naming, title=mapping.title), own


def added_to(
    mapping: Naming, own: Mapping[str, tuple[int, ...]], known: Mapping[str, tuple[int, ...]]
) -> dict[str, tuple[int, ...]]:
    """Return what a mapping finds, and what the known names find beside.

    Args:
        mapping: the mapping.
        own: centre or landmark -> indices of its joints by the mapping.
        known: the same by the known names. Joints with another meaning in the mapping are not used.
    """
    taken = {i for which in own.values() for i in which}
    more = {
        name: which
        for name, which in known.items()
        if name not in own and name not in mapping.left_out and not taken & set(which)
    }
    return {**own, **more}


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


PLACED: Final = {
    "the pelvis": ("pelvis", "right_hip", "left_hip"),
    "the upper trunk": ("neck", "right_shoulder", "left_shoulder"),
}
"""Part of the body that every recording needs -> the centres of which one places it."""


def check_placed(
    centres: Collection[str],
    where: str,
    missing: Sequence[str] = (),
    names: Sequence[str] = (),
    read: Collection[str] = (),
) -> None:
    """Raise if the pelvis or the upper trunk cannot be placed from these centres.

    Args:
        centres: the centres.
        where: the recording's name, for messages.
        missing: sentences about what the recording does not have, or is not read.
        names: names of the recording's joints or markers, which a mapping can name.
        read: those of them that are read.

    Raises:
        UnknownNamesError: if so and there are names that are not read.
        RecordingError: if so, with the centres that are needed.
    """
    lost = "".join(f"; {each[0].lower()}{each[1:-1]}" for each in missing)
    for part, needed in PLACED.items():
        if not any(centre in centres for centre in needed):
            raise unplaced(
                f"{where}: {part} cannot be placed; the recording needs at least one of"
                f" {', '.join(needed)}{lost}",
                needed,
                names,
                read,
            )


def unplaced(
    words: str, needed: Sequence[str], names: Sequence[str], read: Collection[str]
) -> RecordingError:
    """Return the error for a part that cannot be placed, with the names that a mapping can name.

    Args:
        words: the message.
        needed: centres or landmarks that place the part.
        names: names of the recording's joints or markers.
        read: those of them that are read.
    """
    unread = tuple(name for name in names if name not in read)
    guess = guessed(unread)
    nearest = {thing: guess[thing] for thing in needed if thing in guess}
    if not nearest and "neck" in needed:
        # A marker at C7 is read as a landmark; without its like it is the nearest thing to a neck.
        every = guessed(tuple(names))
        top = every.get("neck", every.get("c7"))
        nearest = {"neck": top} if top is not None else {}
    left = tuple(name for name in names if name in unread or name in nearest.values())
    if not left:
        return RecordingError(words)
    lines = [f'{thing} = "{name}"' for thing, name in nearest.items()]
    return UnknownNamesError(
        f"{words}; not read as such: {some(left, 16)}; a mapping file can name them, with lines"
        f" such as {', '.join(lines or [_EXAMPLE.replace('right_elbow', needed[0])])} (mapping)",
        left,
    )


_SCORED: Final = ("neck", "head", "shoulder", "elbow", "wrist", "hip", "knee", "ankle")
"""Ends of the centres without which a scored part is not seen."""


def overlooked(names: tuple[str, ...], found: Collection[str]) -> tuple[str, ...]:
    """Return a sentence about names that look like those of what is not found, if there are any.

    Args:
        names: names of joints or markers that are not read.
        found: the centres or landmarks that are found.
    """
    lines = [
        f'{thing} = "{name}"'
        for thing, name in guessed(names).items()
        if thing not in found and (thing in LANDMARKS or thing.endswith(_SCORED))
    ]
    if not lines:
        return ()
    return (
        "Not read although their names suggest it; a mapping file with these lines would"
        f" (mapping): {some(lines, longest=80)}.",
    )


def _joints(motion: JointMotion, found: Mapping[str, tuple[int, ...]]) -> set[str]:
    """Return the names of the joints that are read."""
    return {motion.names[i] for which in found.values() for i in which}


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
