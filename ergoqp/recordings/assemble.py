"""From the joints of a recording to its postures: name, place, straighten, fit."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from ergoqp.errors import InputError, RecordingError
from ergoqp.human import Body
from ergoqp.joints import spoken
from ergoqp.progress import Progress, part_of, unseen
from ergoqp.recordings.fitting.axes import axes_of, check_sides, find_unit, find_up, tilt_of
from ergoqp.recordings.fitting.leaning import straightened
from ergoqp.recordings.fitting.neutral import (
    Neutral,
    calibration_poses,
    neutral_of,
    stated_neutral,
)
from ergoqp.recordings.fitting.person import measured_lengths, measured_person, suggested_stature
from ergoqp.recordings.fitting.posture_fit import fit
from ergoqp.recordings.fitting.smoothing import smoothed
from ergoqp.recordings.formats.opening import some
from ergoqp.recordings.joints import joints_of
from ergoqp.recordings.markers.fit import markers_on
from ergoqp.recordings.motion import JointMotion
from ergoqp.recordings.naming import Naming
from ergoqp.recordings.recording import Recording
from ergoqp.recordings.remarks import remarks

CALIBRATION = "calibration pose"
"""Why the frames of a T-pose at the begin or end of a recording are not scored."""
_ROUNDED: Final = 1e-3  # s
_FOUND: Final = 0.3
"""What finding the joint centres is of the whole work."""
_SAMPLE: Final = 10_000
"""Frames by which an axis is found."""


@dataclass(frozen=True)
class Reading:
    """How a recording is to be read; None is to be found out.

    Attributes:
        body: the person.
        shapes: marker -> where it is on its segment (3,) [m], as a person file has it.
        subject: whose joints, by the prefix of their names.
        thing: which object the person holds.
        unit: size of the unit of length [m].
        up: the vertical axis.
        naming: how the joints are called.
        neutral: when the person is straight [s], a recording in which they are, or ``"vertical"``.
        window: first and last time [s].
    """

    body: Body | None = None
    shapes: Mapping[str, np.ndarray] = field(default_factory=dict)
    subject: str | None = None
    thing: str | None = None
    unit: float | None = None
    up: str | None = None
    naming: Naming | None = None
    neutral: float | str | JointMotion | None = None
    window: tuple[float, float] | None = None


def recording_of(
    motion: JointMotion, where: str, reading: Reading, progress: Progress = unseen
) -> Recording:
    """Return the postures behind the joints of a recording.

    Args:
        motion: the joints.
        where: its name, for messages.
        reading: how it is to be read.
        progress: told the share of the frames that is fitted.

    Raises:
        RecordingError: the skeleton, the unit or the axes are not known.
        InputError: what was stated does not fit the recording.
    """
    if reading.window is not None:
        motion = _windowed(motion, reading.window)
    found = joints_of(
        motion,
        where,
        reading.naming,
        reading.subject,
        reading.unit,
        reading.shapes,
        reading.body,
        part_of(progress, 0.0, _FOUND),
    )
    named, motion = found.centres, found.motion
    assumptions = list(found.said)
    lengths = measured_lengths(named.paths)
    stature = suggested_stature(lengths)
    unit = found.unit or _unit(where, stature, assumptions)
    axes = unit * _axes(where, named.paths, reading.up or motion.up, assumptions)
    held = _held(where, motion.objects, reading.thing, axes, assumptions)
    markers = {name: path @ axes.T / unit for name, path in found.markers.items()}
    body = reading.body or _measured_body(where, lengths, stature, unit, assumptions)
    # An hour of it is much: what is not needed any more goes, and single precision is kept.
    time, rest = motion.time, {name: axes @ place for name, place in named.rest.items()}
    paths, frames, landmarks = dict(named.paths), found.frames, found.landmarks
    upright = found.upright
    del motion, named, found
    world = {}
    for name in list(paths):
        path = paths.pop(name)
        world[name] = (path @ axes.T).astype(path.dtype)
    world = _with_both_hips(world, assumptions)
    world, said = smoothed(world, time)
    assumptions.extend(said)
    check_sides(where, world)
    posed = calibration_poses(world)
    straight = upright and reading.neutral is None
    neutral = None if straight else _neutral(where, world, rest, axes, time, reading)
    if neutral is not None:
        assumptions.append(neutral.sentence)
        world = straightened(world, neutral.trunk, neutral.neck)

    result = fit(body, world, time, part_of(progress, _FOUND, 1.0))
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
        object_poses=held,
        assumptions=tuple(assumptions),
        person=body,
        errors=result.errors,
        not_scored=result.not_scored,
        markers=markers_on(
            body, result.pelvis[frames], result.postures[frames], markers, landmarks
        ),
    )


def _with_both_hips(
    world: Mapping[str, np.ndarray], assumptions: list[str]
) -> dict[str, np.ndarray]:
    """Return the centres with a hip that is not seen opposite to the one that is."""
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
                    f"In {int(gained.sum())} frames the {side} hip is not seen: it is taken to be"
                    " opposite to the other one about the pelvis."
                )
    return found


def _windowed(motion: JointMotion, window: tuple[float, float]) -> JointMotion:
    # A file's frame time is rounded: the frame at two seconds is at 1.99999.
    inside = (motion.time >= window[0] - _ROUNDED) & (motion.time <= window[1] + _ROUNDED)
    if not inside.any():
        raise InputError(
            f"window: got {window[0]:g} to {window[1]:g} s, allowed times from"
            f" {motion.time[0]:.2f} to {motion.time[-1]:.2f} s"
        )
    return motion.at(inside)


def _unit(where: str, stature: float | None, assumptions: list[str]) -> float:
    """Return the size of the unit of length [m], by how tall people are."""
    if stature is None:
        raise RecordingError(
            f"{where}: no limb is complete enough to tell the unit of length; state unit_to_m"
        )
    unit = find_unit(stature, where)
    assumptions.append(
        f"The unit of length is taken as {unit:g} m, the only common one that gives a stature"
        " of 1.4 to 2.1 m."
    )
    return unit


def _axes(
    where: str, centres: Mapping[str, np.ndarray], stated: str | None, assumptions: list[str]
) -> np.ndarray:
    """Return the rotation (3, 3) from the file's axes to ours."""
    every = max(1, len(next(iter(centres.values()))) // _SAMPLE)
    centres = {name: path[::every] for name, path in centres.items()}
    found = find_up(centres)
    if stated is not None:
        if found is not None and found != stated:
            assumptions.append(
                f"The vertical axis is {stated} as stated, although the head is above the feet"
                f" along {found}."
            )
        return axes_of(stated)
    if found is None:
        raise RecordingError(
            f"{where}: the head is above the feet along none of x, y and z, up or down; state the"
            " vertical axis (up)"
        )
    axes = axes_of(found)
    tilt = tilt_of({centre: path @ axes.T for centre, path in centres.items()})
    if tilt is None:
        assumptions.append(
            f"The vertical axis is taken as {found}, along which the head is above the feet."
        )
        return axes
    angle = math.degrees(math.acos(min(1.0, tilt[2, 2])))
    assumptions.append(
        f"The camera is taken to be tilted by {angle:.0f} deg to the axis {found}: the person, who"
        " stands straight, is taken as vertical; state the vertical axis (up) if the file has one."
    )
    return tilt @ axes


def _neutral(
    where: str,
    world: Mapping[str, np.ndarray],
    rest: Mapping[str, np.ndarray],
    axes: np.ndarray,
    time: np.ndarray,
    reading: Reading,
) -> Neutral | None:
    """Return how the skeleton leans in a person who stands straight; None for not at all."""
    stated = reading.neutral
    if stated == "vertical":
        return None
    if isinstance(stated, JointMotion):
        trial = joints_of(
            stated,
            f"{where}: neutral",
            reading.naming,
            reading.subject,
            reading.unit,
            reading.shapes,
        )
        there = {centre: path @ axes.T for centre, path in trial.centres.paths.items()}
        every = np.ones(len(stated.time), dtype=bool)
        return stated_neutral(there, every, "in the recording that is stated to be neutral")
    if isinstance(stated, float):
        if not time[0] <= stated <= time[-1]:
            raise InputError(
                f"neutral: got {stated:g} s, allowed {time[0]:.2f} to {time[-1]:.2f} s"
            )
        frame = np.arange(len(time)) == np.argmin(np.abs(time - stated))
        return stated_neutral(world, frame, f"at {stated:g} s, as stated")
    return neutral_of(world, rest, time)


def _held(
    where: str,
    objects: Mapping[str, np.ndarray],
    thing: str | None,
    axes: np.ndarray,
    assumptions: list[str],
) -> np.ndarray | None:
    """Return the poses (n, 4, 4) [m] of the object that is meant, or the only one."""
    if thing is not None and thing not in objects:
        raise InputError(
            f"{where}: thing: got {thing!r}, allowed"
            f" {some([repr(name) for name in objects]) or 'None: the recording has no object'}"
        )
    if thing is None and len(objects) > 1:
        assumptions.append(
            f"The recording has {len(objects)} objects ({some(list(objects))}) and it is not stated"
            " which one is held (thing): none is shown."
        )
    name = thing if thing is not None or len(objects) != 1 else next(iter(objects))
    if name is None:
        return None
    assumptions.append(f"The object that is held is {name}.")
    turn = axes / np.cbrt(np.linalg.det(axes))
    poses = objects[name].astype(float)
    poses[:, :3, 3] = poses[:, :3, 3] @ axes.T
    poses[:, :3, :3] = turn @ poses[:, :3, :3]
    return poses


def _measured_body(
    where: str,
    lengths: Mapping[str, float],
    stature: float | None,
    unit: float,
    assumptions: list[str],
) -> Body:
    if stature is None:
        raise RecordingError(
            f"{where}: no trunk, arm or leg is complete enough to measure the person; state person"
        )
    try:
        body, average = measured_person(
            {name: unit * length for name, length in lengths.items()}, unit * stature
        )
    except InputError as error:
        raise RecordingError(
            f"{where}: with a unit of {unit:g} m, {error}; check unit_to_m"
        ) from None
    assumptions.append(
        "The segment lengths are measured between the recording's joints; they suggest a stature"
        f" of {body.stature:.2f} m."
    )
    if average:
        assumptions.append(
            f"Average lengths are taken for {', '.join(map(spoken, average))}: no person has those"
            " of the recording."
        )
    return body


def _poses(pelvis: np.ndarray) -> np.ndarray:
    """Return upright poses (n, 4, 4) from positions [m] and headings [rad], shape (n, 4)."""
    poses = np.tile(np.eye(4), (len(pelvis), 1, 1))
    poses[:, :3, 3] = pelvis[:, :3]
    cos, sin = np.cos(pelvis[:, 3]), np.sin(pelvis[:, 3])
    poses[:, 0, 0] = poses[:, 1, 1] = cos
    poses[:, 1, 0] = sin
    poses[:, 0, 1] = -sin
    return poses
