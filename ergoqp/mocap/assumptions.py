"""What the user states about a recording; what nobody states is found here, with a sentence."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from ergoqp.errors import InputError, RecordingError
from ergoqp.human import FRACTIONS, Body
from ergoqp.human.body import believable
from ergoqp.joints import INDEX, JOINTS, SIDES, spoken
from ergoqp.mocap.fitting.axes import (
    axes_of,
    find_unit,
    find_up,
    leg_of,
    tilt_of,
    upright_line,
)
from ergoqp.mocap.fitting.neutral import (
    Neutral,
    first_middle,
    neutral_of,
    stands_straight,
    stated_neutral,
)
from ergoqp.mocap.fitting.posture import STRAIGHT, Fit
from ergoqp.mocap.fitting.unknown import FASTEST, NEAR
from ergoqp.mocap.fitting.validity import scored_frames
from ergoqp.mocap.formats.text import some
from ergoqp.mocap.joints import ReadOptions, joints_of
from ergoqp.mocap.name_words import is_body_part
from ergoqp.mocap.recording import JointMotion, all_seen

_TELLING: Final = (("thigh", "shank", "trunk"), ("upper_arm", "forearm"))
"""Segments from which the stature is estimated: legs and trunk.

The arms are used only if those are missing, because character rigs often shorten the arms.
"""

_BETWEEN: Final[dict[str, tuple[tuple[str, str], ...]]] = {
    "neck": (("neck", "head"),),
    "head": (("head", "head_top"),),
    "shoulder_width": (("right_shoulder", "left_shoulder"),),
    "hip_width": (("right_hip", "left_hip"),),
    "upper_arm": (("right_shoulder", "right_elbow"), ("left_shoulder", "left_elbow")),
    "forearm": (("right_elbow", "right_wrist"), ("left_elbow", "left_wrist")),
    "thigh": (("right_hip", "right_knee"), ("left_hip", "left_knee")),
    "shank": (("right_knee", "right_ankle"), ("left_knee", "left_ankle")),
    "ankle_to_toe": (("right_ankle", "right_toe"), ("left_ankle", "left_toe")),
}
"""Segment -> the pairs of centres whose distance is its length, one pair per side."""


def measured_lengths(centres: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Return the segment lengths between named centres: frame medians, left and right averaged.

    Args:
        centres: centre -> positions (n, 3), any unit; NaN where not seen.

    Returns:
        Segment of `FRACTIONS`, or ``ankle_to_toe`` -> length in the same unit, for the segments
        whose ends were seen.
    """
    lengths = {}
    for segment, pairs in _BETWEEN.items():
        sides = [
            _median_distance(centres[a], centres[b])
            for a, b in pairs
            if a in centres and b in centres
        ]
        if sides := [side for side in sides if side > 0]:
            lengths[segment] = float(np.mean(sides))
    hips = first_middle(centres, ("right_hip", "left_hip"), ("pelvis",))
    shoulders = first_middle(centres, ("right_shoulder", "left_shoulder"))
    if hips is not None and "neck" in centres:
        trunk = centres["neck"] - hips
        lengths["trunk"] = _median_distance(hips, centres["neck"])
        if shoulders is not None:
            with np.errstate(invalid="ignore", divide="ignore"):
                along = np.einsum("ni,ni->n", shoulders - hips, trunk) / np.linalg.norm(
                    trunk, axis=1
                )
            lengths["shoulder_height"] = _median(along)
    return {segment: length for segment, length in lengths.items() if length > 0}


def side_measured(segment: str, centres: Collection[str]) -> str | None:
    """Return the only side on which a segment is measured; None for both, or a middle segment.

    Args:
        segment: segment of `FRACTIONS`.
        centres: centres of the recording.
    """
    pairs = _BETWEEN.get("ankle_to_toe" if segment == "foot_length" else segment, ())
    seen = [a for a, b in pairs if a in centres and b in centres]
    return seen[0].partition("_")[0] if len(seen) == 1 < len(pairs) else None


def suggested_stature(lengths: Mapping[str, float]) -> float | None:
    """Return the stature estimated from the long segments, in the unit of the lengths.

    It is None if none of them was measured. The sum of the segments is used and not each one,
    because the sum does not depend on where a skeleton puts the joints between them.
    """
    for chain in _TELLING:
        if present := [segment for segment in chain if segment in lengths]:
            return sum(lengths[segment] for segment in present) / sum(
                FRACTIONS[segment] for segment in present
            )
    return None


def measured_person(lengths: Mapping[str, float], stature: float) -> tuple[Body, list[str]]:
    """Return the body with the measured lengths that are within a person's range.

    The names of the segments that keep average proportions are returned too.

    Args:
        lengths: segment -> length [m]; ``ankle_to_toe`` is converted to the foot length that puts
            the body's toe joint there.
        stature: stature estimated from the long segments [m].

    Raises:
        InputError: if the stature is not that of a person.
    """
    lengths = dict(lengths)
    if ankle_to_toe := lengths.pop("ankle_to_toe", None):
        forward, _, down = Body.of_stature(stature).model.site("right_toe").pos
        toe_forward = math.sqrt(max(ankle_to_toe**2 - down**2, 0.0))
        lengths["foot_length"] = FRACTIONS["foot_length"] * stature * toe_forward / forward
    believed = {}
    for segment, length in lengths.items():
        # With a length outside this range, the file's joint is not the anatomical one.
        low, high = believable(segment, stature)
        if low <= length <= high:
            believed[segment] = length
    return Body(stature, believed), sorted(set(lengths) - set(believed))


def _median_distance(a: np.ndarray, b: np.ndarray) -> float:
    return _median(np.linalg.norm(a - b, axis=1))


def _median(values: np.ndarray, unknown: float = 0.0) -> float:
    values = values[np.isfinite(values)]
    return float(np.median(values)) if len(values) else unknown


_ROUNDED: Final = 1e-3  # s


def windowed(motion: JointMotion, window: tuple[float, float]) -> JointMotion:
    """Return the part of a motion between two times [s].

    Raises:
        InputError: if there is no frame between them.
    """
    # The frame time in a file is rounded: the frame at two seconds is at 1.99999.
    inside = (motion.time >= window[0] - _ROUNDED) & (motion.time <= window[1] + _ROUNDED)
    if not inside.any():
        raise InputError(
            f"window: got {window[0]:g} to {window[1]:g} s, allowed times from"
            f" {motion.time[0]:.2f} to {motion.time[-1]:.2f} s"
        )
    return motion.at(inside)


_SIMILAR: Final = math.log(1.15)
"""Largest log ratio of a segment's proportions between two recordings of the same person."""
_STANDS: Final = 12.0
"""Largest lean of the straight legs of a person who stands [deg]."""


def other_proportions(
    own: Mapping[str, np.ndarray], other: Mapping[str, np.ndarray], unit: float | None
) -> str:
    """Return how the skeletons of two recordings differ in proportions; empty if they are alike.

    Args:
        own: centre -> positions (n, 3) [m].
        other: the same of the other recording, in its unit.
        unit: that unit [m]; None if it is unknown.
    """
    mine, theirs = measured_lengths(own), measured_lengths(other)
    both = [name for name in mine if name in theirs]
    if len(both) < 3:
        return ""
    ratios = np.array([math.log(theirs[name] / mine[name]) for name in both])
    off = np.abs(ratios - np.median(ratios))
    # One segment may be measured badly in one of the recordings.
    if np.sort(off)[-2] <= _SIMILAR:
        return ""
    worst = both[int(np.argmax(off))]
    sizes = f"{100 * (math.exp(off.max()) - 1):.0f} % off"
    if unit is not None:
        sizes += f": {mine[worst]:.2f} m here, {unit * theirs[worst]:.2f} m there"
    return f"a skeleton with other proportions ({worst.replace('_', ' ')} {sizes})"


def leaning_legs(places: Mapping[str, np.ndarray]) -> str:
    """Return how far straight legs lean in another recording; empty if they are vertical.

    If they are not, the person leans as a whole there, or the camera's tilt is another.

    Args:
        places: centre -> positions (n, 3), along our axes as they are in the first recording.
    """
    stands, legs = stands_straight(places), leg_of(places)
    if legs is None or not stands.any():
        return ""
    leg = np.nanmedian(legs[stands], axis=0)
    angle = math.degrees(math.acos(float(np.clip(leg[2] / np.linalg.norm(leg), -1, 1))))
    if angle <= _STANDS:
        return ""
    return f"a recording in which straight legs lean by {angle:.0f} deg to this one's vertical axis"


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
    reading: ReadOptions,
    skin: bool,
) -> Neutral | None:
    """Return the lean of the skeleton of a person who stands straight; None for no lean.

    Args:
        where: the recording's name, for messages.
        world: centre -> positions (n, 3) [m], along our axes.
        rest: centre -> position (3,) in the rest pose, the same; empty if there is none.
        axes: from the file's unit and axes to ours (3, 3).
        time: times of the frames (n,) [s].
        reading: options for reading the recording.
        skin: whether the centres are those of markers on the skin.

    Raises:
        RecordingError: if the stated recording looks like one of somebody else or of another
            camera, and is not trusted.
        InputError: if the stated time is not in the recording.
    """
    stated = reading.neutral
    if stated == "vertical":
        return None
    if isinstance(stated, JointMotion):
        trial = joints_of(stated, f"{where}: neutral", replace(reading, body=None))
        there = {centre: path @ axes.T for centre, path in trial.paths.items()}
        unlike = other_proportions(world, trial.paths, trial.unit)
        allowed = "that of the same person, a time of this recording, or vertical"
        if not unlike:
            unlike, allowed = leaning_legs(there), "one with the same camera and the same axes"
        when = "in the recording that is stated to be neutral"
        if unlike and "neutral" not in reading.trust:
            raise RecordingError(
                f"{where}: neutral: got {unlike}, allowed {allowed}; if it is right, state that"
                " (trust neutral)"
            )
        if unlike:
            when = f"{when} (trusted, although it is {unlike})"
        return stated_neutral(there, np.ones(len(stated.time), dtype=bool), when)
    if isinstance(stated, float):
        if not time[0] <= stated <= time[-1]:
            raise InputError(
                f"neutral: got {stated:g} s, allowed {time[0]:.2f} to {time[-1]:.2f} s"
            )
        frame = np.arange(len(time)) == np.argmin(np.abs(time - stated))
        return stated_neutral(world, frame, f"at {stated:g} s, as stated")
    return neutral_of(world, rest, time, skin)


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
) -> tuple[str, np.ndarray] | None:
    """Return name and poses (n, 4, 4) [m] of the stated object, or of the only one.

    None if it is never seen, if it is not stated and far from the hands or named as a part of a
    body, or if there are several objects and none is stated.

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
    offered = [name for name in objects if not is_body_part(name)]
    if thing is None and len(offered) > 1:
        assumptions.append(
            f"The recording has {len(offered)} objects ({some(offered)}); none is shown, because"
            " the one that is held is not stated (thing)."
        )
    if thing is None and len(offered) < len(objects):
        parts = [name for name in objects if name not in offered]
        assumptions.append(
            f"Named as parts of a body and not taken as held: {some(parts)}; state it (thing) if"
            " one is."
        )
    name = thing if thing is not None or len(offered) != 1 else offered[0]
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
    return name, poses


def _from_hands(path: np.ndarray, centres: Mapping[str, np.ndarray]) -> float:
    """Return the median distance of a path (n, 3) from the nearer wrist, in the unit of both.

    NaN if no wrist is seen.
    """
    nearest = np.full(len(path), np.nan)
    for name in ("right_wrist", "left_wrist"):
        if name in centres:
            nearest = np.fmin(nearest, np.linalg.norm(path - centres[name], axis=1))
    return _median(nearest, math.nan)


_POOR: Final = 0.06  # m


def remarks(time: np.ndarray, targets: Mapping[str, np.ndarray], result: Fit) -> Iterator[str]:
    """Yield sentences about what is unusual in a fitted recording.

    Args:
        time: time stamps, shape (n,) [s].
        targets: centre -> positions (n, 3) [m] that the body was fitted to.
        result: result of the fit.
    """
    # The body is far from the recording with a wrong axis or mapping.
    if (median := _median(result.error)) > _POOR:
        yield (
            f"The body fits poorly, with an error of {1000 * median:.0f} mm in the median frame;"
            " check the vertical axis, the person and the mapping."
        )
    yield from _leaps(time, targets)
    scored = scored_frames(len(time), result.not_scored)
    if causes := result.not_scored:
        counted = ", ".join(f"{cause} {int(frames.sum())}" for cause, frames in causes.items())
        yield f"{int((~scored).sum())} of {len(scored)} frames are not scored: {counted}."
    if doubts := result.doubts:
        some_wrong = np.logical_or.reduce(list(doubts.values()))
        counted = some([f"{cause} {int(frames.sum())}" for cause, frames in doubts.items()])
        yield (
            f"In {int(some_wrong.sum())} of {len(scored)} frames a part of the body cannot be right"
            f" and is taken as not seen: {counted}."
        )
    if count := int((~all_seen(result.observed) & scored).sum()):
        yield (
            f"In {count} frames a joint is not seen that is seen at other times: up to {NEAR:g} s"
            " from these its angle is within what it moves in that time, later anywhere in its"
            " range."
        )
    elbows = [INDEX[f"{side}_elbow_flexion"] for side in SIDES]
    straight = result.observed[:, elbows] & (result.postures[:, elbows] <= STRAIGHT)
    if count := int((straight.any(axis=1) & scored).sum()):
        yield (
            f"In {count} frames an elbow is bent by less than {math.degrees(STRAIGHT):.0f} deg and"
            " does not show how the upper arm is rotated."
        )
    yield from _unobserved(np.any(result.observed, axis=0))


def _leaps(time: np.ndarray, targets: Mapping[str, np.ndarray]) -> Iterator[str]:
    """Yield a sentence if a centre moves too fast for the frame time (calibration, keyframes)."""
    moved = np.full(len(time) - 1, np.nan)
    for path in targets.values():
        moved = np.fmax(moved, np.linalg.norm(np.diff(path, axis=0), axis=1))
    places = np.flatnonzero(moved > FASTEST * np.diff(time))
    if len(places):
        first = places[0]
        more = f" and at {len(places) - 1} more places" if len(places) > 1 else ""
        yield (
            f"Between the frames {first + 1} and {first + 2}{more} a joint moves by"
            f" {moved[places].max():.2f} m at once: this is a calibration pose, or the frames are"
            " not uniform in time."
        )


def _unobserved(told: np.ndarray) -> Iterator[str]:
    """Yield sentences about joints that no centre determines, and what follows for the score."""
    never = [spoken(JOINTS[i]) for i in np.flatnonzero(~told)]
    if never:
        yield (
            f"Never seen, and anywhere in their ranges: {', '.join(never)}. The lowest and the"
            " highest score include that; the likeliest posture has them at zero."
        )
    if any(
        told[INDEX[f"{side}_wrist_flexion"]] and not told[INDEX[f"{side}_forearm_pronation"]]
        for side in SIDES
    ):
        yield (
            "The bend of the wrist is split into flexion and deviation as if the forearm were not"
            " rotated."
        )
