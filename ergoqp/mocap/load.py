"""Postures from a motion-capture file or from arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from numbers import Real
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from ergoqp.arguments import names_of, path_of, shown, unmasked
from ergoqp.errors import InputError
from ergoqp.human.person_file import person_with_markers
from ergoqp.mocap.assemble import Reading, recording_of
from ergoqp.mocap.fitting.axes import UPS
from ergoqp.mocap.formats.text import FASTEST, RATES, SLOWEST, Asked
from ergoqp.mocap.naming import read_mapping
from ergoqp.mocap.readers import lacking, normalised, read_motion
from ergoqp.mocap.recording import JointMotion, Recording
from ergoqp.progress import Progress, part_of, unseen

_READ: Final = 0.6
"""Share of the progress at which the file is read."""


def load_recording(
    path: str | Path,
    person: float | str | Path | None = None,
    unit_to_m: float | None = None,
    up: str | None = None,
    *,
    mapping: str | Path | None = None,
    neutral: float | str | Path | None = None,
    window: tuple[float, float] | None = None,
    subject: str | None = None,
    thing: str | None = None,
    columns: Sequence[str] = (),
    rate: float | None = None,
    progress: Progress | None = None,
) -> Recording:
    """Read a motion-capture file and find the postures in it.

    Args:
        path: the recording, or a folder with one table per body; the content decides the format
            (see `ergoqp.mocap.readers`).
        person: stature [m], path of a person file (see `ergoqp.human.person_file`), or None
            to measure the segment lengths in the recording itself.
        unit_to_m: size of the file's unit of length [m]; None uses the unit that the file states,
            or finds the one that gives the stature of an adult.
        up: the file's vertical axis, one of ``"x"``, ``"y"``, ``"z"``, ``"-x"``, ``"-y"``,
            ``"-z"``; None uses the axis that the file states, or finds the axis from the body and
            the camera's tilt from people who stand upright.
        mapping: TOML file with lines ``our_centre = "their joint"`` for unknown joint names (see
            `ergoqp.mocap.naming.CENTRES`), or ``our_landmark = "their marker"`` (see
            `ergoqp.mocap.markers.landmarks.LANDMARKS`); None tries the known names.
        neutral: where the person stands straight: a time in the recording [s], or the path of
            another recording of the same skeleton; ``"vertical"`` measures the trunk to the
            vertical, whatever the skeleton is like; None finds it by the rule of
            `ergoqp.mocap.fitting.axes`.
        window: first and last time to read [s]; None: all.
        subject: the person whose posture is read, where there are several: the prefix of the names
            of their joints.
        thing: name of the object that is held, where there are several.
        columns: names of the points of a table without names, three columns each.
        rate: frames per second of a table or of a folder of poses [Hz]; it is used instead of the
            file's own times.
        progress: is called with the share that is done.

    Returns:
        Postures, pelvis poses, which joints were observed, which frames show no posture and why,
        how well the body fits, and every assumption that was made.

    Raises:
        RecordingError: if the file is not a readable recording, or its skeleton, unit or axes are
            unknown.
        InputError: if another argument is invalid.

    Example:
        >>> import ergoqp
        >>> import tempfile
        >>> from pathlib import Path
        >>> from ergoqp.mocap.demo_recording import demo_recording
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     _ = demo_recording(Path(folder) / "demo.bvh")
        ...     recording = ergoqp.load_recording(Path(folder) / "demo.bvh", window=(0.0, 1.0))
        >>> recording.postures.shape, bool(recording.scored.all())
        ((31, 32), True)
    """
    path = path_of("recording", path)
    asked = Asked(_names("columns", columns), None if rate is None else _rate(rate))
    reading = _reading(person, unit_to_m, up, mapping, neutral, window, asked)
    reading = replace(reading, subject=_name("subject", subject), thing=_name("thing", thing))
    progress = progress or unseen
    # The motion is not kept here: an hour is large, and is freed as soon as its joints are named.
    return recording_of(
        read_motion(path, part_of(progress, 0.0, _READ), asked),
        path.name,
        reading,
        part_of(progress, _READ, 1.0),
    )


def fit_postures(
    names: Sequence[str],
    positions: ArrayLike,
    rate: float,
    *,
    person: float | str | Path | None = None,
    unit_to_m: float | None = 1.0,
    up: str | None = "z",
    mapping: str | Path | None = None,
    neutral: float | str | Path | None = None,
) -> Recording:
    """Find the postures that belong to joint centres or markers in an array.

    >>> import numpy as np
    >>> from ergoqp.human import Body
    >>> from ergoqp.mocap.fitting.person import centres_of
    >>> pelvis = np.tile([0.0, 0.0, 0.9, 0.0], (50, 1))
    >>> centres = centres_of(Body(), pelvis, np.zeros((50, 32)))
    >>> recording = fit_postures(list(centres), np.stack(list(centres.values()), axis=1), 50.0)
    >>> float(recording.time[-1])
    0.98

    Args:
        names: names of the joints, in any order: those of `ergoqp.mocap.naming.CENTRES`, of a
            known naming, or of the mapping; or names of markers in the same way
            (`ergoqp.mocap.markers.landmarks.LANDMARKS`).
        positions: positions (n, m, 3) [m]; NaN where not seen.
        rate: frames per second [Hz].
        person: as in `load_recording`.
        unit_to_m: size of the unit of length [m]; None finds it.
        up: the vertical axis as in `load_recording`; None finds it.
        mapping: as in `load_recording`.
        neutral: as in `load_recording`.

    Raises:
        InputError: if an argument is invalid.
        RecordingError: if the positions show too little of a person.
    """
    hertz = _rate(rate)
    listed = names_of("names", names, "names of joints or markers")
    places = _places(positions, len(listed))
    motion = JointMotion(listed, places, np.arange(len(places)) / hertz)
    if wrong := lacking(motion):
        raise InputError(f"fit_postures: got {wrong}, allowed names (m,) and positions (n, m, 3)")
    reading = _reading(person, unit_to_m, up, mapping, neutral, None, Asked())
    return recording_of(normalised(motion), "positions", reading)


def _reading(
    person: float | str | Path | None,
    unit_to_m: float | None,
    up: str | None,
    mapping: str | Path | None,
    neutral: float | str | Path | None,
    window: tuple[float, float] | None,
    asked: Asked,
) -> Reading:
    """Check the options before the file is read, and return them."""
    if unit_to_m is not None and not (
        isinstance(unit_to_m, Real) and math.isfinite(unit_to_m) and unit_to_m > 0
    ):
        raise InputError(f"unit_to_m: got {unit_to_m!r}, allowed a length in metres above 0")
    if up is not None and up not in UPS:
        raise InputError(f"up: got {up!r}, allowed {', '.join(map(repr, UPS))} or None")
    if window is not None:
        _check_window(window)
    body, shapes = (None, {}) if person is None else person_with_markers(person)
    return Reading(
        body=body,
        shapes=shapes,
        unit=unit_to_m,
        up=up,
        naming=None if mapping is None else read_mapping(Path(mapping)),
        neutral=_neutral(neutral, asked),
        window=window,
    )


def _check_window(window: tuple[float, float]) -> None:
    numbers = isinstance(window, tuple | list) and len(window) == 2
    if not numbers or not all(
        isinstance(each, Real) and not isinstance(each, bool) and not math.isnan(each)
        for each in window
    ):
        raise InputError(f"window: got {shown(window)}, allowed two times in seconds")
    if not window[0] < window[1]:
        raise InputError(
            f"window: got {window[0]:g} to {window[1]:g} s, allowed an end later than the start"
        )


def _rate(rate: float) -> float:
    if isinstance(rate, bool) or not isinstance(rate, Real) or not SLOWEST <= rate <= FASTEST:
        raise InputError(f"rate: got {shown(rate)}, allowed {RATES}")
    return float(rate)


def _places(positions: ArrayLike, count: int) -> np.ndarray:
    """Return a copy of positions (n, count, 3); masked elements become NaN."""
    found = shown(positions)
    try:
        array = unmasked(positions)
        if array.dtype.kind in "iufO":  # an array with a None in it has the dtype object
            with np.errstate(over="ignore"):
                places = np.array(array, dtype=float)
            if places.ndim == 3 and len(places) and places.shape[1:] == (count, 3):
                return places
            found = f"numbers of shape {places.shape}"
    except Exception:  # the argument cannot be made an array
        pass
    raise InputError(
        f"positions: got {' '.join(found.split())}, allowed real numbers of shape (n, {count}, 3)"
    )


def _name(what: str, name: str | None) -> str | None:
    if name is not None and not isinstance(name, str):
        raise InputError(f"{what}: got {shown(name)}, allowed a name or None")
    return name


def _names(what: str, names: Sequence[str]) -> tuple[str, ...]:
    if isinstance(names, str) or not all(isinstance(name, str) and name for name in names):
        raise InputError(f"{what}: got {shown(names)}, allowed a list of names")
    return tuple(names)


def _neutral(neutral: float | str | Path | None, asked: Asked) -> float | str | JointMotion | None:
    """Return the checked argument; a path becomes the recording that was read from it."""
    if neutral is None or neutral == "vertical":
        return None if neutral is None else "vertical"
    if isinstance(neutral, str | Path):
        return read_motion(path_of("neutral", neutral), asked=asked)
    if isinstance(neutral, bool) or not isinstance(neutral, Real) or not math.isfinite(neutral):
        raise InputError(
            f"neutral: got {shown(neutral)}, allowed a time in seconds, a recording, 'vertical' or"
            " None"
        )
    return float(neutral)
