"""Postures from the joints of a recording: name, place, straighten and fit them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.human import Body
from ergoqp.human.person_file import Marker
from ergoqp.mocap.assumptions import Reading as Reading
from ergoqp.mocap.assumptions import (
    axes_to_ours,
    held_object,
    measured_body,
    remarks,
    straight_of,
    unit_by_stature,
    windowed,
)
from ergoqp.mocap.fitting.axes import calibration_poses, check_sides, shift_of, straightened
from ergoqp.mocap.fitting.person import measured_lengths, suggested_stature
from ergoqp.mocap.fitting.posture import Fit, fit
from ergoqp.mocap.fitting.validity import smoothed
from ergoqp.mocap.formats.text import short
from ergoqp.mocap.joints import joints_of
from ergoqp.mocap.markers.fit import completed, markers_on
from ergoqp.mocap.markers.landmarks import above_hips
from ergoqp.mocap.naming import check_placed
from ergoqp.mocap.recording import JointMotion, Recording
from ergoqp.mocap.unseen import AHEAD
from ergoqp.progress import Progress, part_of, unseen

CALIBRATION = "calibration pose"
"""Cause for which the frames of a T-pose at the start or end of a recording are not scored."""
_FOUND: Final = 0.3
"""Share of the progress at which the joint centres are found."""
_FARTHEST: Final = 1e9
"""Largest coordinate in any unit; the square of a much larger number would be infinite."""
_EXACT: Final = 1e-3
"""Precision that the coordinates need [m]."""
_FEW: Final = 20
"""If fewer frames than this are scored, the places of markers are computed from all frames."""


def recording_of(
    motion: JointMotion, where: str, reading: Reading, progress: Progress = unseen
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
    found_out = found.said
    assumptions = list(found_out)
    centres = _seen_at_all(named.paths, where, assumptions)
    lengths = measured_lengths(centres)
    stature = suggested_stature(lengths)
    unit = found.unit or unit_by_stature(where, stature, assumptions)
    if exact * unit > _EXACT:
        raise RecordingError(
            f"{where}: got coordinates so far from the origin that they are exact to"
            f" {1000 * exact * unit:.0f} mm only, allowed coordinates with the origin near the"
            " person"
        )
    axes = unit * axes_to_ours(where, centres, reading.up or motion.up, assumptions)
    held = held_object(where, motion.objects, reading.thing, axes, centres, assumptions)
    markers = {name: path @ axes.T / unit for name, path in found.markers.items()}
    body, measured = reading.body, ()
    if body is None:
        body, measured = measured_body(where, lengths, stature, unit, assumptions)
    # An hour is large: what is not needed any more is freed, and single precision is kept.
    time, rest = motion.time, {name: axes @ place for name, place in named.rest.items()}
    paths, frames, landmarks = centres, found.frames, found.landmarks
    upright, whole = found.upright, found.whole
    del motion, named, found
    world = {}
    for name in list(paths):
        path = paths.pop(name)
        world[name] = (path @ axes.T).astype(path.dtype)
    world = _with_both_hips(world, assumptions)
    world, said = smoothed(world, time)
    assumptions.extend(said)
    # A nose that was assumed to point ahead of the trunk is no evidence.
    shown = {name: path for name, path in world.items() if name != "nose" or AHEAD not in found_out}
    if unsure := check_sides(where, shown):
        assumptions.append(unsure)
    del shown
    posed = calibration_poses(world)
    straight = upright and reading.neutral is None
    neutral = None if straight else straight_of(where, world, rest, axes, time, reading)
    along: dict[str, np.ndarray] = {}
    if neutral is not None:
        assumptions.append(neutral.sentence)
        shift = shift_of(world, neutral.trunk) if neutral.trunk else None
        if shift is not None:
            along = {name: shift for name in markers if above_hips(landmarks[name])}
        world = straightened(world, neutral.trunk, neutral.neck)

    world = _in_one_block(world)
    result = fit(body, world, time, part_of(progress, _FOUND, 1.0))
    markers |= {name: markers[name] + shift[frames] for name, shift in along.items()}
    sits = _calibrated(body, result, frames, markers, landmarks)
    if whole is not None and not reading.completed:
        to_ours = axes * whole.unit if whole.unit else axes
        # Lost markers are estimated without those left out.
        seen = {name: whole.of(name)[frames].astype(float) @ to_ours.T for name in markers}
        seen |= {name: seen[name] + shift[frames] for name, shift in along.items()}
        steady = _calibrated(body, result, frames, seen, landmarks)
        more = completed(whole, steady, body, result.pelvis, result.postures, to_ours, along)
        if more is not None:
            again = replace(reading, window=None, subject=None, completed=True)
            # Places on the body are those by the seen markers, including those left out.
            return replace(recording_of(more, where, again, progress), markers=sits)
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
        object_poses=held,
        assumptions=tuple(assumptions),
        person=body,
        errors=result.errors,
        not_scored=result.not_scored,
        markers=sits,
        # From joint angles the centres have the lengths of the body that they were placed with.
        measured=() if upright else measured,
    )


def _seen_at_all(
    paths: Mapping[str, np.ndarray], where: str, assumptions: list[str]
) -> dict[str, np.ndarray]:
    """Return the centres without those that are named in the recording but never seen."""
    found = {name: path for name, path in paths.items() if np.isfinite(path).any()}
    if len(found) < len(paths):
        check_placed(tuple(found), where)
        lost = ", ".join(name.replace("_", " ") for name in paths if name not in found)
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
    """Return the places of markers on the body, from the scored frames if there are enough."""
    shown = np.ones(len(frames), dtype=bool)
    for lacking in result.not_scored.values():
        shown &= ~lacking[frames]
    if shown.sum() < _FEW:
        shown[:] = True
    rows = frames[shown]
    seen = {name: path[shown] for name, path in markers.items()}
    return markers_on(body, result.pelvis[rows], result.postures[rows], seen, landmarks)


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
    cos, sin = np.cos(pelvis[:, 3]), np.sin(pelvis[:, 3])
    poses[:, 0, 0] = poses[:, 1, 1] = cos
    poses[:, 1, 0] = sin
    poses[:, 0, 1] = -sin
    return poses
