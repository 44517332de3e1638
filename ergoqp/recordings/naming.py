"""Which of a recording's joints is which centre of the body.

The known namings are data; mapping files serve all others.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Any, Final

import numpy as np

from ergoqp.errors import InputError, RecordingError
from ergoqp.files.text import read_toml
from ergoqp.recordings.formats.opening import some
from ergoqp.recordings.motion import JointMotion

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
skull."""

_LEAST_MATCHED = 8  # fewer named centres are chance: every skeleton has a "Neck" and a "Head"


@dataclass(frozen=True)
class Naming:
    """One way of naming joints.

    Attributes:
        title: how it is called in messages.
        centres: our centre -> the names of their joints whose middle it is.
        upright_rest: whether a skeleton of this naming stands upright and looks straight ahead in
            its rest pose.
    """

    title: str
    centres: Mapping[str, tuple[str, ...]]
    upright_rest: bool = False

    def found_in(self, names: tuple[str, ...]) -> dict[str, tuple[int, ...]]:
        """Return, for each centre whose joints are all among `names`, the places of these joints.

        Upper and lower case do not count, nor does a prefix that all names share ("mixamorig:",
        "Character1_").
        """
        prefix = _shared_prefix(names)
        places = {name.removeprefix(prefix).casefold(): i for i, name in enumerate(names)}
        places |= {name.casefold(): i for i, name in enumerate(names)}
        return {
            centre: tuple(places[name.casefold()] for name in theirs)
            for centre, theirs in self.centres.items()
            if all(name.casefold() in places for name in theirs)
        }


@dataclass(frozen=True)
class NamedCentres:
    """The body's joint centres in a recording.

    Attributes:
        title: the naming that was found.
        paths: centre -> positions (n, 3) in the file's unit and axes.
        rest: centre -> position (3,) in an upright rest pose; empty when there is none or it is not
            known to be upright.
    """

    title: str
    paths: Mapping[str, np.ndarray]
    rest: Mapping[str, np.ndarray]


@lru_cache(maxsize=1)
def known_namings() -> tuple[Naming, ...]:
    """Return the namings of ``namings.toml``, in its order."""
    text = resources.files("ergoqp.recordings").joinpath("namings.toml").read_text(encoding="utf-8")
    return tuple(
        Naming(entry["title"], _listed(entry["centres"]), entry["upright_rest"])
        for entry in tomllib.loads(text).values()
    )


def read_mapping(path: Path) -> Naming:
    """Read a mapping file of TOML lines ``our_centre = "their joint"``.

    A line may also give a list of joints whose middle is meant.

    Args:
        path: the mapping file.

    Raises:
        InputError: the file is not readable TOML, or names a centre that is not one of `CENTRES`.
    """
    entries = read_toml(path, "mapping file")
    for centre, theirs in entries.items():
        if centre not in CENTRES:
            raise InputError(
                f"mapping file {path.name}: got the centre {centre!r}, allowed are"
                f" {', '.join(CENTRES)}"
            )
        listed = theirs if isinstance(theirs, list) else [theirs]
        if not listed or not all(isinstance(name, str) for name in listed):
            raise InputError(
                f"mapping file {path.name}: {centre} is {theirs!r}, allowed is a joint's name or a"
                " list of names"
            )
    return Naming(f"mapping file {path.name}", _listed(entries))


def named_centres(motion: JointMotion, mapping: Naming | None, where: str) -> NamedCentres:
    """Return the body's joint centres that a recording holds.

    Args:
        motion: the recording's own joints.
        mapping: how its joints are called; None tries the known namings.
        where: the file's name, for messages.

    Returns:
        The centres under our names, and the naming that gave them.

    Raises:
        RecordingError: the skeleton is of no known naming, the mapping names joints that are not
            there, or neither the pelvis nor the upper trunk can be placed.
    """
    if mapping is None:
        naming = max(known_namings(), key=lambda known: _agreement(known, motion.names))
        found = naming.found_in(motion.names)
        if len(found) < min(_LEAST_MATCHED, len(motion.names)):
            raise RecordingError(
                f"{where}: the skeleton is of no known naming"
                f" ({', '.join(n.title for n in known_namings())}); its joints are"
                f" {some(motion.names)}; give a mapping file with lines such as right_elbow ="
                " 'their joint' (mapping)"
            )
    else:
        naming = mapping
        found = naming.found_in(motion.names)
        if missing := [
            name
            for centre, theirs in naming.centres.items()
            if centre not in found
            for name in theirs
        ]:
            raise RecordingError(
                f"{where}: the {naming.title} names {some(tuple(missing))}, which the recording"
                f" does not have; it has {some(motion.names)}"
            )
    for part, centres in (
        ("the pelvis", ("pelvis", "right_hip", "left_hip")),
        ("the upper trunk", ("neck", "right_shoulder", "left_shoulder")),
    ):
        if not any(centre in found for centre in centres):
            raise RecordingError(
                f"{where}: {part} cannot be placed; the recording needs at least one of"
                f" {', '.join(centres)}"
            )
    paths = {centre: motion.positions[:, places].mean(axis=1) for centre, places in found.items()}
    if motion.rest is None or not naming.upright_rest:
        return NamedCentres(naming.title, paths, {})
    return NamedCentres(
        naming.title,
        paths,
        {centre: motion.rest[list(places)].mean(axis=0) for centre, places in found.items()},
    )


def _listed(entries: Mapping[str, Any]) -> dict[str, tuple[str, ...]]:
    return {
        centre: (theirs,) if isinstance(theirs, str) else tuple(theirs)
        for centre, theirs in entries.items()
    }


def _agreement(naming: Naming, names: tuple[str, ...]) -> tuple[int, float]:
    """Return how many centres a naming finds and, between equals, what share of its own.

    So, between equals, the naming that expects no more wins.
    """
    found = len(naming.found_in(names))
    return found, found / len(naming.centres)


def _shared_prefix(names: tuple[str, ...]) -> str:
    """Return the longest start that all names have, up to a colon or underscore; "" if none."""
    starts = [names[0][: i + 1] for i, letter in enumerate(names[0]) if letter in ":_"]
    return next(
        (start for start in reversed(starts) if all(name.startswith(start) for name in names)), ""
    )
