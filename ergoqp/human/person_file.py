"""Files that describe a person: stature, measured segments, and positions of markers.

A person file is TOML with a stature, measured segment lengths, or both.
`ergoqp.human.FRACTIONS` names the segments. Lengths that are not given follow from the
stature. A stature that is not given follows from the lengths::

    stature = 1.68        # m
    mass = 62             # kg, optional

    [lengths]             # m, optional
    upper_arm = 0.30
    forearm = 0.25

    [markers.LASI]        # position of a marker on the person, optional, from a calibration
    frame = "pelvis"
    offset = [0.09, 0.12, 0.08]   # m, along the frame's axes
    residual = 0.004              # m
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from numbers import Real
from pathlib import Path
from typing import Any, Final, cast

from ergoqp.arguments import check_kind, check_number, check_word, numbers_of, shown
from ergoqp.errors import InputError
from ergoqp.files.read import read_toml
from ergoqp.human.body import FRACTIONS, FRAMES, MASS_RANGE, Body, Marker, believable

_FARTHEST: Final = 2.0
"""Largest distance of a marker from its segment [m]."""
_ROUNDED: Final = 1e-4
"""Tolerance of the range of a length, because written lengths are rounded [m]."""
_CONTROLS: Final = re.compile(r'[\x00-\x1f\x7f"\\]')
"""Characters that must be escaped within quotes in TOML."""


def given_person(person: float | str | Path) -> Body:
    """Return the body of a person from a stature or a person file.

    Args:
        person: stature [m], or path of a person file.

    Raises:
        InputError: if the value is neither, or the file does not describe a person.

    Example:
        >>> from ergoqp.human.person_file import given_person
        >>> given_person(1.68).stature
        1.68
    """
    return person_with_markers(person)[0]


def person_with_markers(person: float | str | Path) -> tuple[Body, dict[str, Marker]]:
    """Return the body of a person from a stature or a person file, and their marker positions.

    A stature gives no markers.

    Args:
        person: stature [m], or path of a person file.

    Raises:
        InputError: if the value is neither, or the file does not describe a person.
    """
    if isinstance(person, Real) and not isinstance(person, bool):
        return Body.of_stature(cast("float", person)), {}
    if not isinstance(person, str | Path):
        raise InputError(f"person: got {person!r}, allowed a stature in m, a person file or None")
    path = Path(person)
    if not path.name:
        raise InputError(f"person file: got {str(person)!r}, allowed a file")
    entries = read_toml(path, "person file")
    if unknown := set(entries) - {"stature", "mass", "lengths", "markers"}:
        raise InputError(
            f"person file {path.name}: got {shown(sorted(unknown))}, allowed stature, mass and the"
            " tables lengths and markers"
        )
    try:
        return _body(entries), _markers(entries.get("markers", {}))
    except InputError as error:
        raise InputError(f"person file {path.name}: {error}") from None


def _body(entries: Mapping[str, Any]) -> Body:
    """Return the body that a file describes."""
    measured, mass = entries.get("lengths", {}), entries.get("mass", 0.0)
    check_kind("lengths", measured, dict, "a table of segments, each with its length in m")
    if not (measured or "stature" in entries):
        raise InputError("got neither, required are a stature in m, a table lengths in m, or both")
    if "mass" in entries:
        # `Body` takes 0 for a mass that is not given, so check it here.
        check_number("mass", mass, *MASS_RANGE, "kg")
    if "stature" in entries:
        stature = Body.of_stature(entries["stature"]).stature
    else:
        stature = Body.of_lengths(measured, mass).stature
    for name, length in measured.items():
        check_number(f"length of {name}", length, 0.0, 1e6, "m")
        low, high = believable(name, stature) if name in FRACTIONS else (-math.inf, math.inf)
        if not low - _ROUNDED <= length <= high + _ROUNDED:
            raise InputError(
                f"length of {name}: got {length:.3f} m, allowed {low:.3f} to {high:.3f} m for a"
                f" stature of {stature:.2f} m"
            )
    return Body(stature, measured, mass)


def _markers(table: Any) -> dict[str, Marker]:
    """Return the positions of a person's markers from the table of a file."""
    check_kind("markers", table, dict, "a table for each marker")
    found = {}
    for name, entry in table.items():
        where = f"markers.{name}"
        if not isinstance(entry, dict) or set(entry) - {"frame", "offset", "residual"}:
            raise InputError(
                f"{where}: got {shown(entry)}, allowed a table of frame, offset and residual"
            )
        frame, offset, residual = (
            entry.get("frame"),
            entry.get("offset"),
            entry.get("residual", 0.0),
        )
        check_word(f"{where}.frame", frame, FRAMES)
        if not isinstance(offset, list) or len(offset) != 3:
            raise InputError(f"{where}.offset: got {shown(offset)}, allowed three lengths in m")
        x, y, z = numbers_of(f"{where}.offset", offset, -_FARTHEST, _FARTHEST)
        check_number(f"{where}.residual", residual, 0.0, 1e6, "m")
        found[name] = Marker(str(frame), (x, y, z), float(residual))
    return found


def write_person(
    path: Path, body: Body, markers: Mapping[str, Marker], notes: Sequence[str] = ()
) -> None:
    """Write a person file with a body and markers, for example from a recording.

    Args:
        path: path of the file.
        body: the person.
        markers: positions of the markers; markers that were never seen, or are too far from
            the body, are left out.
        notes: comments to write at the top of the file.

    Raises:
        OSError: if the file cannot be written.

    Example:
        >>> import tempfile
        >>> from pathlib import Path
        >>> from ergoqp.human import Body
        >>> from ergoqp.human.person_file import given_person, write_person
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = Path(folder) / "anna.toml"
        ...     write_person(path, Body(1.68), {})
        ...     body = given_person(path)
        >>> round(body.stature, 2)
        1.68
    """
    rows = [f"# {_printable(note)}" for note in notes]
    rows += [f"stature = {body.stature:.4f}"]
    # A mass that follows from the stature was not measured, so it is not written.
    if abs(body.mass - Body.of_stature(body.stature).mass) > 0.05:
        rows.append(f"mass = {body.mass:.1f}")
    rows += ["", "[lengths]", *(f"{name} = {size:.4f}" for name, size in body.lengths.items())]
    for name, marker in markers.items():
        if not math.isfinite(marker.residual) or max(map(abs, marker.offset)) > _FARTHEST:
            continue
        rows += [
            "",
            f'[markers."{_printable(name)}"]',
            f'frame = "{marker.frame}"',
            f"offset = [{', '.join(f'{round(each, 4) + 0.0:.4f}' for each in marker.offset)}]",
            f"residual = {marker.residual:.4f}",
        ]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")


def _printable(text: str) -> str:
    """Return a text with the characters escaped that TOML does not accept."""
    return _CONTROLS.sub(lambda found: f"\\u{ord(found.group()):04x}", text)
