"""Postures from a motion-capture file or arrays: name, place, straighten and fit its joints."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from numbers import Real
from pathlib import Path
from types import NoneType
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from ergoqp.arguments import (
    Progress,
    check_kind,
    names_of,
    part_of,
    path_of,
    shown,
    unmasked,
    unseen,
)
from ergoqp.errors import InputError, RecordingError
from ergoqp.human import Body
from ergoqp.human.body import Marker
from ergoqp.human.person_file import person_with_markers
from ergoqp.joints import INDEX, LOWER, SIDES, UPPER, spoken
from ergoqp.mocap.assumptions import (
    axes_to_ours,
    held_object,
    measured_body,
    measured_lengths,
    remarks,
    straight_of,
    suggested_stature,
    unit_by_stature,
    windowed,
)
from ergoqp.mocap.fitting.axes import UPS
from ergoqp.mocap.fitting.blind import blinded
from ergoqp.mocap.fitting.jitter import smoothed
from ergoqp.mocap.fitting.neutral import Neutral, calibration_poses, shift_of, straightened
from ergoqp.mocap.fitting.posture import Fit, fit
from ergoqp.mocap.fitting.sides import check_sides, exchanged_back
from ergoqp.mocap.fitting.unknown import Doubt
from ergoqp.mocap.fitting.validity import scored_frames
from ergoqp.mocap.formats.text import TableOptions, short
from ergoqp.mocap.formats.times import FASTEST, RATES, SLOWEST
from ergoqp.mocap.joints import ReadOptions as ReadOptions
from ergoqp.mocap.joints import joints_of, with_objects
from ergoqp.mocap.naming import above_hips, check_placed, read_mapping
from ergoqp.mocap.readers import lacking, normalised, read_motion
from ergoqp.mocap.recording import JointMotion, Recording, all_seen
from ergoqp.mocap.unseen import AHEAD

CALIBRATION = "calibration pose"
"""Cause for which the frames of a T-pose at the start or end of a recording are not scored."""
_FOUND: Final = 0.3
"""Share of the progress at which the joint centres are found."""
_FARTHEST: Final = 1e9
"""Largest coordinate in any unit; the square of a much larger number would be infinite."""
_EXACT: Final = 1e-3
"""Precision that the coordinates need [m]."""
_TRIED: Final = 2000
"""Frames from which it is found whether a correction is possible, about."""
_ARMS_BEYOND: Final = tuple(f"{side} upper arm beyond its range" for side in SIDES)
_SHARE_BEYOND: Final = 0.1
"""Share of the frames in which arms may get beyond their ranges by a correction."""
_FEW: Final = 20
"""If fewer frames than this are scored, the places of markers are computed from all frames."""


def recording_of(
    motion: JointMotion, where: str, reading: ReadOptions, progress: Progress = unseen
) -> Recording:
    """Return the postures that belong to the joints of a recording.

    Args:
        motion: the joints.
        where: the recording's name, for messages.
        reading: options for reading it.
        progress: is called with the share of the frames that is fitted.

    Raises:
        RecordingError: if the skeleton, the unit or the axes are unknown.
        InputError: if a stated option does not fit the recording.
    """
    exact = _exactness(where, motion)
    if reading.window is not None:
        motion = windowed(motion, reading.window)
    found = joints_of(motion, where, reading, part_of(progress, 0.0, _FOUND))
    motion = found.motion
    found_out = found.said
    assumptions = list(found_out)
    centres = _seen_at_all(found.paths, where, assumptions)
    lengths = measured_lengths(centres)
    stature = suggested_stature(lengths)
    unit = found.unit or unit_by_stature(where, stature, assumptions)
    if exact * unit > _EXACT:
        far = f"so far from the origin that they are exact to {1000 * exact * unit:.0f} mm only"
        if "precision" not in reading.trust:
            raise RecordingError(
                f"{where}: got coordinates {far}, allowed coordinates with the origin near the"
                " person; if that is enough, state it (trust precision)"
            )
        assumptions.append(f"The coordinates are {far}; they are used as stated (trust precision).")
    axes = unit * axes_to_ours(where, centres, reading.up or motion.up, assumptions)
    held = held_object(where, motion.objects, reading.thing, axes, centres, assumptions)
    read = with_objects(found.read, motion.objects, None if held is None else held[0])
    markers = {name: path @ axes.T / unit for name, path in found.markers.items()}
    body, measured = reading.body, ()
    if body is None:
        body, measured = measured_body(where, lengths, stature, unit, assumptions)
    # An hour is large: what is not needed any more is freed, and single precision is kept.
    time, rest = motion.time, {name: axes @ place for name, place in found.rest.items()}
    paths, frames, landmarks = centres, found.frames, found.landmarks
    upright, whole, unshown, blind = found.upright, found.whole, found.unshown, motion.blind
    doubt = _doubt_of(found.doubts)
    del motion, found
    world = {}
    for name in list(paths):
        path = paths.pop(name)
        world[name] = (path @ axes.T).astype(path.dtype)
    if "sides" not in reading.trust:
        world, said = exchanged_back(world, time)
        assumptions.extend(said)
    world = _with_both_hips(world, assumptions)
    world, said = smoothed(world, time)
    assumptions.extend(said)
    # A nose that was assumed to point ahead of the trunk is no evidence.
    shown = {name: path for name, path in world.items() if name != "nose" or AHEAD not in found_out}
    if unsure := check_sides(where, shown, trusted="sides" in reading.trust):
        assumptions.append(unsure)
    del shown
    posed = calibration_poses(world)
    straight = upright and reading.neutral is None
    neutral = (
        None
        if straight
        else straight_of(where, world, rest, axes, time, reading, skin=bool(markers))
    )
    if neutral is not None and reading.neutral is None and neutral.trunk:
        neutral = _possible(neutral, body, world, time)
    along: dict[str, np.ndarray] = {}
    if neutral is not None:
        assumptions.append(neutral.sentence)
        shift = shift_of(world, neutral.trunk) if neutral.trunk else None
        if shift is not None:
            along = {name: shift for name in markers if above_hips(landmarks[name])}
        others = _otherwise(neutral, body, world, time)
        doubt = replace(doubt, neck=neutral.nods, others=others)
        world = straightened(world, neutral.trunk, neutral.neck)

    world = _in_one_block(world)
    result = fit(body, world, time, part_of(progress, _FOUND, 1.0), doubt)
    result = _without(result, unshown)
    result = blinded(result, blind)
    markers |= {name: markers[name] + shift[frames] for name, shift in along.items()}
    sits = _calibrated(body, result, frames, markers, landmarks)
    if whole is not None and not reading.completed:
        to_ours = axes * whole.unit if whole.unit else axes
        # Lost markers are estimated without those left out.
        seen = {name: whole.of(name)[frames].astype(float) @ to_ours.T for name in markers}
        seen |= {name: seen[name] + shift[frames] for name, shift in along.items()}
        steady = _calibrated(body, result, frames, seen, landmarks)
        from ergoqp.mocap.markers.fit import completed

        more = completed(whole, steady, body, result.pelvis, result.postures, to_ours, along)
        if more is not None:
            again = replace(reading, window=None, subject=None, completed=True)
            # Places on the body are those by the seen markers, including those left out.
            return replace(recording_of(more, where, again, progress), markers=sits, read=read)
    del whole, along
    if posed.any() and not posed.all():
        result = replace(result, not_scored={CALIBRATION: posed, **result.not_scored})
    assumptions.extend(remarks(time, world, result))
    del world
    result.postures.setflags(write=False)
    return Recording(
        time=time,
        postures=result.postures,
        base_poses=_poses(result.pelvis),
        observed=result.observed,
        fit_error=result.error,
        object_poses=None if held is None else held[1],
        assumptions=tuple(assumptions),
        person=body,
        errors=result.errors,
        not_scored=result.not_scored,
        doubts=result.doubts,
        spans=result.spans,
        markers=sits,
        # From joint angles the centres have the lengths of the body that they were placed with.
        measured=() if upright else measured,
        read=read,
    )


def _doubt_of(doubts: Mapping[str, np.ndarray]) -> Doubt:
    """Return the doubts about markers (see `Found`) in the form of the fit."""
    axes = {name: turn for name, turn in doubts.items() if name.endswith("_axis")}
    return Doubt(arms={n: half for n, half in doubts.items() if n not in axes}, axes=axes)


def _possible(
    neutral: Neutral, body: Body, world: Mapping[str, np.ndarray], time: np.ndarray
) -> Neutral:
    """Return a lean, without that of the trunk if its correction makes arms impossible."""
    every = max(1, len(time) // _TRIED)
    tried = {name: path[::every] for name, path in world.items()}
    frames = []
    for places in (tried, straightened(tried, neutral.trunk, neutral.neck)):
        doubts = fit(body, places, time[::every]).doubts
        beyond = [doubts[arm] for arm in _ARMS_BEYOND if arm in doubts]
        frames.append(int(np.any(beyond, axis=0).sum()) if beyond else 0)
    plain, corrected = frames
    return (
        neutral.uncorrected if corrected > plain + _SHARE_BEYOND * len(time[::every]) else neutral
    )


def _otherwise(
    neutral: Neutral, body: Body, world: Mapping[str, np.ndarray], time: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Return the postures (n, 32) [rad] of the other leans that the trunk may have."""
    return tuple(
        fit(body, straightened(world, lean, neutral.neck), time).postures
        for lean in sorted({*neutral.trunk_ends} - {neutral.trunk})
    )


def _without(result: Fit, joints: Sequence[str]) -> Fit:
    """Return a fit in which some joints are not seen: they may be anywhere in their ranges."""
    if not joints:
        return result
    numbers, count = [INDEX[joint] for joint in joints], len(result.postures)
    postures, observed = result.postures.copy(), result.observed.copy()
    postures[:, numbers], observed[:, numbers] = 0.0, False
    every = np.arange(count, dtype=np.int32)
    free = {
        joint: (every, *(np.full(count, end[joint], dtype=np.float32) for end in (LOWER, UPPER)))
        for joint in numbers
    }
    found = replace(result, postures=postures, observed=observed, spans={**result.spans, **free})
    if "trunk_flexion" not in joints:
        return found
    return replace(found, not_scored={"trunk not seen": np.ones(count, dtype=bool)})


def _seen_at_all(
    paths: Mapping[str, np.ndarray], where: str, assumptions: list[str]
) -> dict[str, np.ndarray]:
    """Return the centres without those that are named in the recording but never seen."""
    found = {name: path for name, path in paths.items() if np.isfinite(path).any()}
    if len(found) < len(paths):
        check_placed(tuple(found), where)
        lost = ", ".join(spoken(name) for name in paths if name not in found)
        assumptions.append(f"Never seen and left out: {lost}.")
    return found


def _exactness(where: str, motion: JointMotion) -> float:
    """Return the precision of the positions as numbers; raise if a coordinate is too large."""
    most = 0.0
    for i, name in enumerate(motion.names):
        path = motion.positions[:, i]
        farthest = max(np.fmax.reduce(path, axis=None), -np.fmin.reduce(path, axis=None))
        if farthest > _FARTHEST:
            raise RecordingError(
                f"{where}: got a coordinate of {farthest:.3g} for {short(name)}, allowed numbers"
                f" from {-_FARTHEST:g} to {_FARTHEST:g}"
            )
        most = np.fmax(most, farthest)
    return float(np.spacing(np.asarray(most, dtype=motion.positions.dtype)))


def _with_both_hips(
    world: Mapping[str, np.ndarray], assumptions: list[str]
) -> dict[str, np.ndarray]:
    """Return the centres, with a hip that is not seen placed opposite to the other one."""
    found, pelvis = dict(world), world.get("pelvis")
    for side, other in (("right", "left"), ("left", "right")):
        hip = world.get(f"{other}_hip")
        if pelvis is not None and hip is not None:
            opposite = 2 * pelvis - hip
            own = world.get(f"{side}_hip", np.full_like(opposite, np.nan))
            found[f"{side}_hip"] = np.where(np.isfinite(own), own, opposite)
            gained = np.isfinite(opposite[:, 0]) & np.isnan(own[:, 0])
            if gained.any():
                assumptions.append(
                    f"In {int(gained.sum())} frames the {side} hip is not seen: it is placed"
                    " opposite to the other hip about the pelvis."
                )
    return found


def _calibrated(
    body: Body,
    result: Fit,
    frames: np.ndarray,
    markers: Mapping[str, np.ndarray],
    landmarks: Mapping[str, str],
) -> dict[str, Marker]:
    """Return the places of markers on the body, from frames that are seen if there are enough."""
    if not markers:
        return {}
    from ergoqp.mocap.markers.fit import markers_on

    shown = all_seen(result.observed) & scored_frames(len(result.pelvis), result.not_scored)
    shown = shown[frames]
    if shown.sum() < _FEW:
        shown[:] = True
    rows = frames[shown]
    seen_at = {name: path[shown] for name, path in markers.items()}
    return markers_on(body, result.pelvis[rows], result.postures[rows], seen_at, landmarks)


def _in_one_block(paths: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Make the paths parts of one array, in place, and return them.

    The system gets one large array back when nobody needs it any more. Many smaller ones would
    leave gaps in the memory of the process: 100 MB for an hour of recording.
    """
    first = next(iter(paths.values()))
    kind = np.result_type(*{path.dtype for path in paths.values()})
    block = np.empty((len(paths), *first.shape), dtype=kind)
    for part, name in zip(block, list(paths), strict=True):
        part[:] = paths.pop(name)
        paths[name] = part
    return paths


def _poses(pelvis: np.ndarray) -> np.ndarray:
    """Return upright poses (n, 4, 4) from positions [m] and headings [rad], shape (n, 4)."""
    poses = np.tile(np.eye(4), (len(pelvis), 1, 1))
    poses[:, :3, 3] = pelvis[:, :3]
    poses[:, 0, 0] = poses[:, 1, 1] = np.cos(pelvis[:, 3])
    poses[:, 1, 0] = np.sin(pelvis[:, 3])
    poses[:, 0, 1] = -poses[:, 1, 0]
    return poses


TRUSTED: Final = ("names", "sides", "angles", "neutral", "precision")
"""What `load_recording` can be told to trust."""
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
    trust: Sequence[str] = (),
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
            `ergoqp.mocap.naming.LANDMARKS`); None tries the known names.
        neutral: where the person stands straight: a time in the recording [s], or the path of
            another recording of the same skeleton; ``"vertical"`` measures the trunk to the
            vertical, whatever the skeleton is like; None finds it by the rule of
            `ergoqp.mocap.fitting.neutral`.
        window: first and last time to read [s]; None: all.
        subject: the person whose posture is read, where there are several: the prefix of the names
            of their joints.
        thing: name of the object that is held, where there are several.
        columns: names of the points of a table without names, three columns each.
        rate: frames per second of a table or of a folder of poses [Hz]; it is used instead of the
            file's own times.
        trust: what is right although it looks impossible, of `TRUSTED`: ``"names"`` (markers are
            where their names say), ``"sides"`` (left and right are as named), ``"angles"`` (unit
            and sign of the file's own angles), ``"neutral"`` (the stated recording shows the same
            person upright, by the same camera), ``"precision"`` (coordinates far from the origin
            are exact enough). Such a file is read, and a sentence says what looked impossible.
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
    if isinstance(columns, str) or not all(isinstance(each, str) and each for each in columns):
        raise InputError(f"columns: got {shown(columns)}, allowed a list of names")
    for what, name in (("subject", subject), ("thing", thing)):
        check_kind(what, name, (str, NoneType), "a name or None")
    hertz = None if rate is None else _rate(rate)
    asked = TableOptions(tuple(columns), hertz, _trusted(trust), subject)
    reading = _reading(person, unit_to_m, up, mapping, neutral, window, asked)
    reading = replace(reading, subject=subject, thing=thing)
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
    trust: Sequence[str] = (),
) -> Recording:
    """Find the postures that belong to joint centres or markers in an array.

    >>> import numpy as np
    >>> from ergoqp.human import Body
    >>> from ergoqp.mocap.naming import centres_of
    >>> pelvis = np.tile([0.0, 0.0, 0.9, 0.0], (50, 1))
    >>> centres = centres_of(Body(), pelvis, np.zeros((50, 32)))
    >>> recording = fit_postures(list(centres), np.stack(list(centres.values()), axis=1), 50.0)
    >>> float(recording.time[-1])
    0.98

    Args:
        names: names of the joints, in any order: those of `ergoqp.mocap.naming.CENTRES`, of a
            known naming, or of the mapping; or names of markers in the same way
            (`ergoqp.mocap.naming.LANDMARKS`).
        positions: positions (n, m, 3) [m]; NaN where not seen.
        rate: frames per second [Hz].
        person: as in `load_recording`.
        unit_to_m: size of the unit of length [m]; None finds it.
        up: the vertical axis as in `load_recording`; None finds it.
        mapping: as in `load_recording`.
        neutral: as in `load_recording`.
        trust: as in `load_recording`.

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
    asked = TableOptions(trust=_trusted(trust))
    reading = _reading(person, unit_to_m, up, mapping, neutral, None, asked)
    return recording_of(normalised(motion), "positions", reading)


def _reading(
    person: float | str | Path | None,
    unit_to_m: float | None,
    up: str | None,
    mapping: str | Path | None,
    neutral: float | str | Path | None,
    window: tuple[float, float] | None,
    asked: TableOptions,
) -> ReadOptions:
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
    return ReadOptions(
        body=body,
        shapes=shapes,
        unit=unit_to_m,
        up=up,
        naming=None if mapping is None else read_mapping(Path(mapping)),
        neutral=_neutral(neutral, asked),
        window=window,
        trust=asked.trust,
    )


def _trusted(trust: Sequence[str]) -> frozenset[str]:
    listed = isinstance(trust, tuple | list) and all(isinstance(each, str) for each in trust)
    if not listed or not set(trust) <= set(TRUSTED):
        raise InputError(f"trust: got {shown(trust)}, allowed a list of {', '.join(TRUSTED)}")
    return frozenset(trust)


def _check_window(window: tuple[float, float]) -> None:
    pair = isinstance(window, tuple | list) and len(window) == 2
    if not pair or not all(_is_real(each) and not math.isnan(each) for each in window):
        raise InputError(f"window: got {shown(window)}, allowed two times in seconds")
    if not window[0] < window[1]:
        raise InputError(
            f"window: got {window[0]:g} to {window[1]:g} s, allowed an end later than the start"
        )


def _is_real(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool)


def _rate(rate: float) -> float:
    if not (_is_real(rate) and SLOWEST <= rate <= FASTEST):
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


def _neutral(
    neutral: float | str | Path | None, asked: TableOptions
) -> float | str | JointMotion | None:
    """Return the checked argument; a path becomes the recording that was read from it."""
    if neutral is None or neutral == "vertical":
        return None if neutral is None else "vertical"
    if isinstance(neutral, str | Path):
        return read_motion(path_of("neutral", neutral), asked=asked)
    if not (_is_real(neutral) and math.isfinite(neutral)):
        raise InputError(
            f"neutral: got {shown(neutral)}, allowed a time in seconds, a recording, 'vertical' or"
            " None"
        )
    return float(neutral)
