"""Assignment of a recording's joints to the joint centres of the body, by their names.

The known namings are data. All other names need a mapping file.
"""

from __future__ import annotations

import tomllib
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Any, Final

import numpy as np

from ergoqp.errors import InputError, RecordingError, UnknownNamesError
from ergoqp.files.read import read_toml
from ergoqp.mocap.formats.text import some
from ergoqp.mocap.markers.landmarks import LANDMARKS
from ergoqp.mocap.names import CENTRES as CENTRES
from ergoqp.mocap.names import guessed, squashed
from ergoqp.mocap.recording import JointMotion

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


@dataclass(frozen=True)
class NamedCentres:
    """The body's joint centres in a recording.

    Attributes:
        title: title of the naming that was found.
        paths: centre -> positions (n, 3) in the file's unit and axes.
        rest: centre -> position (3,) in an upright rest pose; empty if there is none or it is not
            known to be upright.
    """

    title: str
    paths: Mapping[str, np.ndarray]
    rest: Mapping[str, np.ndarray]


@lru_cache(maxsize=1)
def known_namings() -> tuple[Naming, ...]:
    """Return the namings of ``namings.toml``, in its order."""
    text = resources.files("ergoqp.mocap").joinpath("namings.toml").read_text(encoding="utf-8")
    return tuple(
        Naming(
            entry["title"],
            _listed(entry["centres"]),
            entry.get("upright_rest", False),
            {name: (part, tuple(place)) for name, (part, place) in entry.get("turned", {}).items()},
        )
        for entry in tomllib.loads(text).values()
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
) -> NamedCentres:
    """Return the body's joint centres under our names.

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
        return NamedCentres(naming.title, paths, {})
    return NamedCentres(
        naming.title,
        paths,
        {centre: motion.rest[list(which)].mean(axis=0) for centre, which in found.items()},
    )


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
