"""Assumptions: what neither the file nor the user states is found here, with a sentence."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np

from ergoqp.errors import InputError, RecordingError
from ergoqp.human import Body
from ergoqp.joints import spoken
from ergoqp.recordings.another_take import check_same_person, check_stands
from ergoqp.recordings.fitting.axes import axes_of, find_unit, find_up, tilt_of, upright_line
from ergoqp.recordings.fitting.neutral import Neutral, neutral_of, stated_neutral
from ergoqp.recordings.fitting.person import measured_person
from ergoqp.recordings.formats.opening import some
from ergoqp.recordings.joints import joints_of
from ergoqp.recordings.motion import JointMotion
from ergoqp.recordings.reading import Reading

_SAMPLE: Final = 10_000
"""Frames from which the vertical axis is found, about."""
_REACH: Final = 3.0
"""Largest median distance of a held object from the nearer hand [m]; a long pole is nearer."""


def unit_by_stature(where: str, stature: float | None, assumptions: list[str]) -> float:
    """Return the size of the unit of length [m], found from the stature of adults."""
    if stature is None:
        raise RecordingError(
            f"{where}: no limb is complete enough to find the unit of length; state unit_to_m"
        )
    unit = find_unit(stature, where)
    assumptions.append(
        f"The unit of length is taken as {unit:g} m, the only common one that gives a stature"
        " of 1.4 to 2.1 m."
    )
    return unit


def axes_to_ours(
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
            f"{where}: the head is above the feet along none of the axes x, y, z, -x, -y and -z;"
            " state the vertical axis (up)"
        )
    axes = axes_of(found)
    line = upright_line({centre: path @ axes.T for centre, path in centres.items()})
    tilt = None if line is None else tilt_of(line)
    if tilt is None:
        assumptions.append(
            f"The vertical axis is taken as {found}, along which the head is above the feet."
        )
        if line is None:
            assumptions.append(
                "Whether the camera is tilted against that axis is not checked, because legs and"
                " trunk are not seen in line: a tilt would be read as a lean of the trunk."
            )
        return axes
    angle = math.degrees(math.acos(min(1.0, tilt[2, 2])))
    assumptions.append(
        f"The camera is taken to be tilted by {angle:.0f} deg against the axis {found}, because the"
        " person who stands straight is taken as vertical; state the vertical axis (up) if the file"
        " has one."
    )
    return tilt @ axes


def straight_of(
    where: str,
    world: Mapping[str, np.ndarray],
    rest: Mapping[str, np.ndarray],
    axes: np.ndarray,
    time: np.ndarray,
    reading: Reading,
) -> Neutral | None:
    """Return the lean of the skeleton of a person who stands straight; None for no lean."""
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
        check_same_person(where, world, trial.centres.paths, trial.unit)
        there = {centre: path @ axes.T for centre, path in trial.centres.paths.items()}
        check_stands(where, there)
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


def measured_body(
    where: str,
    lengths: Mapping[str, float],
    stature: float | None,
    unit: float,
    assumptions: list[str],
) -> tuple[Body, tuple[str, ...]]:
    """Return the body with the lengths between the recording's joints, and the measured lengths."""
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
        "The segment lengths are measured between the recording's joints; they correspond to a"
        f" stature of {body.stature:.2f} m."
    )
    if average:
        assumptions.append(
            f"Average lengths are used for {', '.join(map(spoken, average))}: the recording's"
            " lengths are outside a person's range."
        )
    own = ("foot_length" if name == "ankle_to_toe" else name for name in lengths)
    return body, tuple(name for name in own if name not in average)


def held_object(
    where: str,
    objects: Mapping[str, np.ndarray],
    thing: str | None,
    axes: np.ndarray,
    centres: Mapping[str, np.ndarray],
    assumptions: list[str],
) -> np.ndarray | None:
    """Return the poses (n, 4, 4) [m] of the stated object, or of the only one.

    None if it is never seen, if it is not stated and far from the hands, or if there are several
    objects and none is stated.

    Args:
        where: the recording's name, for messages.
        objects: their poses (n, 4, 4) in the file's unit and axes.
        thing: name of the stated object; None: the only one.
        axes: from the file's unit and axes to ours (3, 3).
        centres: the person's joint centres (n, 3) in the file's unit and axes.
        assumptions: list to which sentences about the object are added.

    Raises:
        InputError: if there is no object of that name.
    """
    if thing is not None and thing not in objects:
        raise InputError(
            f"{where}: thing: got {thing!r}, allowed"
            f" {some([repr(name) for name in objects]) or 'None: the recording has no object'}"
        )
    if thing is None and len(objects) > 1:
        assumptions.append(
            f"The recording has {len(objects)} objects ({some(list(objects))}); none is shown,"
            " because the one that is held is not stated (thing)."
        )
    name = thing if thing is not None or len(objects) != 1 else next(iter(objects))
    if name is None:
        return None
    path = objects[name][:, :3, 3].astype(float)
    if not np.isfinite(path).all(axis=1).any():
        assumptions.append(f"The object {name} is never seen, so no object is taken as held.")
        return None
    away = _from_hands(path, centres) * float(np.cbrt(np.linalg.det(axes)))
    if away <= _REACH or np.isnan(away):
        assumptions.append(f"The object that is held is {name}.")
    elif thing is not None:
        assumptions.append(
            f"The object that is held is {name}, as stated, although it is {away:.1f} m from the"
            " nearer hand in the median."
        )
    else:
        assumptions.append(
            f"The object {name} is {away:.1f} m from the nearer hand in the median and is not taken"
            " as held; state it (thing) if it is."
        )
        return None
    turn = axes / np.cbrt(np.linalg.det(axes))
    poses = objects[name].astype(float)
    poses[:, :3, 3] = poses[:, :3, 3] @ axes.T
    poses[:, :3, :3] = turn @ poses[:, :3, :3]
    return poses


def _from_hands(path: np.ndarray, centres: Mapping[str, np.ndarray]) -> float:
    """Return the median distance of a path (n, 3) from the nearer wrist, in the unit of both.

    NaN if no wrist is seen.
    """
    nearest = np.full(len(path), np.nan)
    for name in ("right_wrist", "left_wrist"):
        if name in centres:
            nearest = np.fmin(nearest, np.linalg.norm(path - centres[name], axis=1))
    told = nearest[np.isfinite(nearest)]
    return float(np.median(told)) if len(told) else math.nan
