"""Joint centres from a recording of markers, block by block, by landmarks on the skin.

The hips follow from the pelvis (Harrington et al. 2007). Knee, elbow and ankle lie half their width
inside the outer marker, perpendicular to the bone above ("chord", Davis et al. 1991), or midway
between the outer and the inner marker. The axis of the elbow follows from its bend, or where it is
straight from the marker on the upper arm; that of the knee from the marker on the thigh.

All lengths are in metres, and NaN means not seen. The vertical is not needed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from ergoqp.arguments import Progress, unseen
from ergoqp.errors import RecordingError
from ergoqp.human.body import Marker
from ergoqp.joints import SIDES, spoken
from ergoqp.mocap.fitting.posture import unit
from ergoqp.mocap.fitting.standins import either
from ergoqp.mocap.markers.arms import arm_of, axes_said, carrying_of, turn_to_axis
from ergoqp.mocap.markers.bones import (
    BENT,
    Landmarks,
    Widths,
    across,
    aside_of,
    axis_of,
    inside,
)
from ergoqp.mocap.markers.fit import AS_STATED, check_order
from ergoqp.mocap.markers.rigid import Links, middle_of, pelvis_size, rigid_segments, usual_distance
from ergoqp.mocap.markers.shoulders import (
    Sliding,
    axes_of,
    sliding_of,
    sliding_said,
    turned,
)
from ergoqp.mocap.naming import CENTRES, RIGID, unplaced
from ergoqp.mocap.recording import JointMotion

_ROUNDS: Final = 5


def centres_of_landmarks(
    at: Mapping[str, np.ndarray], widths: Widths, size: tuple[float, float]
) -> dict[str, np.ndarray]:
    """Return joint centre -> positions (n, 3) [m], for the centres that are determined.

    Args:
        at: landmark of `ergoqp.mocap.naming.LANDMARKS` -> positions (n, 3) [m].
        widths: widths of the person.
        size: width between the ASIS and depth from them to the PSIS [m]; NaN if unknown.
    """
    return centres_and_doubts(at, widths, size, {}, turns_of(at, widths, size, {}))[0]


def centres_and_doubts(
    at: Mapping[str, np.ndarray],
    widths: Widths,
    size: tuple[float, float],
    sliding: Mapping[str, Sliding],
    turns: Mapping[str, float],
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return the centres of `centres_of_landmarks`, and the doubts about the upper arms.

    Args:
        at: as in `centres_of_landmarks`.
        widths: as in `centres_of_landmarks`.
        size: as in `centres_of_landmarks`.
        sliding: side -> how the acromion's marker slides, where it may.
        turns: side -> angle from the marker on the upper arm to the elbow's axis, as of `turns_of`.

    Returns:
        The centres, and the doubts as of `joints_of_markers`.
    """
    place = Landmarks(at)
    level, hips = _hips(place, size)
    trunk, down, left = _trunk(place, hips)
    shoulders, doubts = _shoulders(place, down, left, widths, sliding)
    left = either(left, level)
    centres = {**hips, **trunk, **shoulders}
    for side in SIDES:
        out = -1.0 if side == "right" else 1.0
        shoulder = centres[f"{side}_shoulder"]
        centres |= arm_of(side, out, place, shoulder, (left, down), widths, turns.get(side))
        if f"{side}_inner_elbow" in place:
            doubts[f"{side}_elbow_axis"] = out * carrying_of(side, place, centres)
        centres |= _leg(side, out, place, centres[f"{side}_hip"], level, widths)
    centres |= _head(place)
    return {name: path for name, path in centres.items() if np.isfinite(path[:, 0]).any()}, doubts


def roots_of(
    at: Mapping[str, np.ndarray],
    widths: Widths,
    size: tuple[float, float],
    sliding: Mapping[str, Sliding],
) -> dict[str, np.ndarray]:
    """Return hips and shoulders (n, 3) [m], which the limbs' distances begin at.

    Args:
        at: as in `centres_of_landmarks`.
        widths: as in `centres_of_landmarks`.
        size: as in `centres_of_landmarks`.
        sliding: as in `centres_and_doubts`.
    """
    place = Landmarks(at)
    _, hips = _hips(place, size)
    _, down, left = _trunk(place, hips)
    return hips | _shoulders(place, down, left, widths, sliding)[0]


def turns_of(
    at: Mapping[str, np.ndarray],
    widths: Widths,
    size: tuple[float, float],
    sliding: Mapping[str, Sliding],
) -> dict[str, float]:
    """Return side -> angle about the upper arm from its marker to the elbow's axis [rad].

    Sides whose elbow is bent in too few frames are left out.

    Args:
        at: as in `centres_of_landmarks`.
        widths: as in `centres_of_landmarks`.
        size: as in `centres_of_landmarks`.
        sliding: as in `centres_and_doubts`.
    """
    place, roots = Landmarks(at), roots_of(at, widths, size, sliding)
    turns = {side: turn_to_axis(side, place, roots[f"{side}_shoulder"]) for side in SIDES}
    return {side: turn for side, turn in turns.items() if turn is not None}


def _sliding(
    at: Mapping[str, np.ndarray], widths: Widths, size: tuple[float, float]
) -> dict[str, Sliding]:
    """Return side -> how its acromion's marker slides, by a sample of frames, where it may."""
    place = Landmarks(at)
    _, hips = _hips(place, size)
    _, down, left = _trunk(place, hips)
    # The shoulders themselves are no place on the trunk.
    neck = (place["c7"] + place["notch"]) / 2
    seen = [np.isfinite(each[:, 0]).sum() for each in (neck, place["c7"], place["notch"])]
    trunk = (neck, place["c7"], place["notch"])[int(np.argmax(seen))]
    axes = axes_of(down, left)
    found: dict[str, Sliding] = {}
    for side, below in zip(SIDES, _below(place, down, widths), strict=True):
        arm = turned(axes, place[f"{side}_outer_elbow"] - below)
        sliding = sliding_of(arm, turned(axes, place[f"{side}_acromion"] - trunk))
        if sliding is not None:
            found[side] = sliding
    return found


def _hips(place: Landmarks, size: tuple[float, float]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return the left direction of the pelvis (n, 3), and the hip centres."""
    width, depth = size
    front = place.middle("asis")
    back = either(place.middle("psis"), place["sacrum"], place["right_psis"], place["left_psis"])
    left = unit(place["left_asis"] - place["right_asis"])
    ahead = front - back
    ahead = unit(across(ahead, left))
    up = np.cross(ahead, left)
    middle = front - (0.24 * depth + 0.0099) * ahead - (0.30 * width + 0.0109) * up
    aside = (0.33 * width + 0.0073) * left
    return left, {"right_hip": middle - aside, "left_hip": middle + aside}


def _trunk(
    place: Landmarks, hips: Mapping[str, np.ndarray]
) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
    """Return the base of the neck, and the directions down and left of the trunk (n, 3)."""
    shoulders = place.middle("acromion")
    neck = either((place["c7"] + place["notch"]) / 2, shoulders)
    low = either((place["back"] + place["xiphoid"]) / 2, place["back"], place["xiphoid"])
    pelvis = (hips["right_hip"] + hips["left_hip"]) / 2
    down = either(unit(low - neck), unit(pelvis - neck))
    left = place["left_acromion"] - place["right_acromion"]
    left = unit(across(left, down))
    ahead = place["notch"] - place["c7"]
    left = either(left, unit(np.cross(ahead, down)))
    return {"neck": neck}, down, left


def _below(place: Landmarks, down: np.ndarray, widths: Widths) -> list[np.ndarray]:
    """Return the right and the left shoulder below markers that do not slide (n, 3)."""
    return [place[f"{side}_acromion"] + widths.shoulder * down for side in SIDES]


def _shoulders(
    place: Landmarks,
    down: np.ndarray,
    left: np.ndarray,
    widths: Widths,
    sliding: Mapping[str, Sliding],
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Return the shoulders, and the doubts about the upper arms of the sides that may slide."""
    shoulders: dict[str, np.ndarray] = dict(zip(SIDES, _below(place, down, widths), strict=True))
    doubts: dict[str, np.ndarray] = {}
    for side, each in sliding.items():
        elbow = place[f"{side}_outer_elbow"]
        shoulders[side], doubts[f"{side}_upper_arm"] = each.joint(
            shoulders[side], elbow, axes_of(down, left)
        )
    return {f"{side}_shoulder": path for side, path in shoulders.items()}, doubts


def _head(place: Landmarks) -> dict[str, np.ndarray]:
    """Return base and top of the head, and where the nose points."""
    front, back = place.middle("head_front"), place.middle("head_back")
    ahead = unit(front - back)
    left = place["left_head_front"] + place["left_head_back"]
    left = left - place["right_head_front"] - place["right_head_back"]
    up = np.cross(ahead, unit(across(left, ahead)))
    middle = (front + back) / 2
    base = middle - 0.09 * up - 0.01 * ahead
    return {"head": base, "head_top": middle + 0.10 * up, "nose": base + 0.12 * ahead}


def _leg(
    side: str, out: float, place: Landmarks, hip: np.ndarray, left: np.ndarray, widths: Widths
) -> dict[str, np.ndarray]:
    knee, ankle = place[f"{side}_outer_knee"], place[f"{side}_outer_ankle"]
    # The shank bends backward.
    both = (ankle + place[f"{side}_inner_ankle"]) / 2
    bent, aside = _knee(hip, knee, (ankle, both), out * left, widths, out)
    shown = aside_of(hip, knee, place[f"{side}_thigh"])
    inner = place[f"{side}_inner_knee"]
    middle = either((knee + inner) / 2, inside(hip, knee, shown, widths.knee), bent)
    aside = either(shown, aside)
    aside = either(knee - middle, aside)
    aside = either(aside_of(middle, ankle, place[f"{side}_shank"]), aside)
    low = either(both, inside(middle, ankle, aside, widths.ankle))
    return {f"{side}_knee": middle, f"{side}_ankle": low, f"{side}_toe": place[f"{side}_forefoot"]}


def _knee(
    hip: np.ndarray,
    marker: np.ndarray,
    ankle: tuple[np.ndarray, np.ndarray],
    usual: np.ndarray,
    widths: Widths,
    out: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the knee from its marker and its bend (n, 3), and its outward direction (n, 3).

    The axis is perpendicular to both bones, which depend on the knee in turn. A few rounds find
    both.

    Args:
        hip: upper end of the thigh (n, 3).
        marker: marker on the outside of the knee.
        ankle: marker on the outside of the ankle, and the joint if both sides have a marker.
        usual: outward direction while the leg is straight and does not show it.
        widths: widths of the person.
        out: sign of the outward direction along the cross product of both bones.
    """
    aside, knee = usual, marker
    for _ in range(_ROUNDS):
        knee = inside(hip, marker, aside, widths.knee)
        end = either(ankle[1], inside(knee, ankle[0], aside, widths.ankle))
        thigh, shank = unit(knee - hip), unit(end - knee)
        aside = axis_of(out * np.cross(thigh, shank), usual, thigh, BENT)
    return knee, aside


_BLOCK: Final = 8192
"""Frames that are computed at once."""
_SAMPLE: Final = 4000
"""Frames from which shapes and widths are found, about."""
_PELVIS: Final = (0.15, 0.40)
"""Range of the distance between the two ASIS of a person [m]."""
_SHOULDERS: Final = (0.22, 0.55)
"""Range of the distance between the acromions of a person [m]."""
_ON_ITS_WAY: Final = 0.1
"""Time that a marker needs to move to a wrong place, and back [s]."""
_UNITS: Final = (1.0, 0.01, 0.001, 0.0254)


Astray = dict[str, np.ndarray]
"""Landmark, or further marker -> the frames in which it is in a wrong place and left out (k,)."""


def joints_of_markers(
    motion: JointMotion,
    where: str,
    landmarks: Mapping[str, tuple[int, ...]],
    more: Mapping[str, tuple[int, ...]],
    given: Mapping[str, Marker],
    unit: float,
    progress: Progress = unseen,
) -> tuple[dict[str, np.ndarray], list[str], Astray, dict[str, np.ndarray]]:
    """Return joint centre -> positions (n, 3) [m], sentences, markers left out, and doubts.

    The doubts are the half-angles by which the direction of an upper arm may be off, because the
    acromion's marker slides: ``right_upper_arm``, ``left_upper_arm`` -> (n,) [rad]. With two
    markers of an elbow, they are also the inward rotation of the upper arm by these beyond that by
    the forearm: ``right_elbow_axis``, ``left_elbow_axis`` -> (n,) [rad].

    Args:
        motion: the markers.
        where: the recording's name, for messages.
        landmarks: landmark, or joint centre -> indices of the markers whose middle it is.
        more: rigid segment -> indices of its further markers.
        given: name of a marker -> its place on the body, from a person file.
        unit: the file's unit of length [m].
        progress: is called with the share of the frames that is done.

    Raises:
        RecordingError: if the pelvis cannot be placed.
    """
    every = max(1, len(motion.time) // _SAMPLE)
    # If one marker of a wrist is never seen, the wrist is computed from the other one.
    landmarks = {
        name: which
        for name, which in landmarks.items()
        if "_wrist_" not in name or np.isfinite(motion.positions[:, list(which), 0]).any()
    }
    sample = _at(landmarks, motion.positions[::every], unit)
    segments, said = rigid_segments(motion, landmarks, more, given, unit, every)
    size = pelvis_size(segments)
    if not np.isfinite(size).all() and not {"pelvis", "right_hip", "left_hip"} & set(landmarks):
        words = _unplaced(where, sample)
        # A person file of somebody else may be the reason, so its sentence is added.
        for sentence in said:
            if "pelvis's markers are not where" in sentence:
                words += f"; t{sentence[1:-1]}"
        read = {motion.names[i] for which in (*landmarks.values(), *more.values()) for i in which}
        raise unplaced(words, RIGID["pelvis"], motion.names, read)
    widths, count = Widths.of(motion.measures), len(motion.time)
    sliding = _sliding(sample, widths, size)
    turns = turns_of(sample, widths, size, sliding)
    links = Links(roots_of(sample, widths, size, sliding) | sample)
    step = float(np.median(np.diff(motion.time))) if count > 1 else _ON_ITS_WAY
    around = round(_ON_ITS_WAY / step)
    # One array per centre, so that the memory of each can be freed separately.
    centres: dict[str, np.ndarray] = {}
    doubts = {f"{side}_upper_arm": np.zeros(count, dtype=np.float32) for side in SIDES}
    filled: Counter[str] = Counter()
    astray: Astray = {}
    for start in range(0, count, _BLOCK):
        # The block and the frames around it, in which a marker may move to a wrong place or back.
        rows = slice(max(0, start - around), start + _BLOCK + around)
        inside = slice(start - rows.start, start - rows.start + _BLOCK)
        block = motion.positions[rows]
        at = _at(landmarks, block, unit)
        for segment in segments:
            for name, away in segment.complete(at, block, unit, filled, inside).items():
                _add(astray, name, start, away[inside])
        for name, away in links.astray(roots_of(at, widths, size, sliding) | at, around).items():
            # The shoulder is computed from the acromion, so the acromion is the wrong marker.
            landmark = name.replace("shoulder", "acromion")
            if landmark in at:
                _add(astray, landmark, start, away[inside])
                at[landmark] = np.where(away[:, None], np.nan, at[landmark])
        found, doubtful = centres_and_doubts(at, widths, size, sliding, turns)
        for name, off in doubtful.items():
            whole = doubts.setdefault(name, np.zeros(count, dtype=np.float32))
            whole[start : start + _BLOCK] = off[inside]
        found |= {name: path for name, path in at.items() if name in CENTRES}
        for name, path in found.items():
            if name not in centres:
                centres[name] = np.full((count, 3), np.nan, dtype=np.float32)
            centres[name][start : start + _BLOCK] = path[inside]
        progress(min((start + _BLOCK) / count, 1.0))
    bare = [s for s in SIDES if f"{s}_outer_elbow" in sample and f"{s}_inner_elbow" not in sample]
    how = [*_said(widths, filled, count), *axes_said(bare, sample, turns)]
    how += sliding_said(sliding, doubts)
    said = [*how, *astray_said(motion, astray), *said]
    return centres, said, astray, doubts


def in_order(
    motion: JointMotion,
    where: str,
    landmarks: Mapping[str, tuple[int, ...]],
    unit: float,
    trusted: bool,
) -> JointMotion:
    """Return markers that are where their names say; a note says if that is stated against them.

    Args:
        motion: the markers.
        where: the recording's name, for messages.
        landmarks: landmark -> indices of its markers.
        unit: the file's unit of length [m].
        trusted: whether the names are right, wherever the markers are.

    Raises:
        RecordingError: if markers are in impossible places and the names are not trusted.
    """
    every = max(1, len(motion.time) // _SAMPLE)
    said = check_order(where, _at(landmarks, motion.positions[::every], unit), trusted=trusted)
    # It is not repeated when lost markers have been estimated.
    before = any(AS_STATED in note for note in motion.notes)
    return motion if before else replace(motion, notes=(*motion.notes, *said))


def _add(astray: Astray, name: str, start: int, away: np.ndarray) -> None:
    """Add the frames (n,) bool after `start` in which a marker is in a wrong place."""
    if away.any():
        before = astray.get(name, np.empty(0, dtype=int))
        astray[name] = np.concatenate([before, start + np.flatnonzero(away)])


def _at(
    places: Mapping[str, tuple[int, ...]], block: np.ndarray, unit: float
) -> dict[str, np.ndarray]:
    """Return landmark -> positions (n, 3) [m]."""
    return {name: middle_of(block, which, unit) for name, which in places.items()}


def _unplaced(where: str, at: Mapping[str, np.ndarray]) -> str:
    """Return the error text for landmarks (n, 3) from which the pelvis cannot be placed."""
    lost = np.full((1, 3), np.nan)
    seen = [mark for mark in RIGID["pelvis"] if np.isfinite(at.get(mark, lost)).any()]
    return (
        f"{where}: the pelvis cannot be placed; the recording needs both ASIS, and a PSIS or the"
        f" sacrum, three of them at once; of these it has {', '.join(seen) or 'none'}"
    )


def unit_of_markers(
    motion: JointMotion, where: str, landmarks: Mapping[str, tuple[int, ...]], stated: float | None
) -> float:
    """Return the stated unit, or the only one that gives the width of a person [m].

    Raises:
        RecordingError: if no unit or more than one gives it, or the stated one does not.
    """
    every = max(1, len(motion.time) // _SAMPLE)
    at = _at(landmarks, motion.positions[::every], 1.0)
    for name, (low, high) in (("asis", _PELVIS), ("acromion", _SHOULDERS)):
        if f"right_{name}" not in at or f"left_{name}" not in at:
            continue
        width = usual_distance(at[f"left_{name}"], at[f"right_{name}"])
        if not np.isfinite(width):
            continue
        if stated is not None and not low / 1.5 <= stated * width <= 1.5 * high:
            raise RecordingError(
                f"{where}: with a unit of {stated:g} m the {name.upper()} markers of both sides are"
                f" {stated * width:.3g} m apart, allowed {low:g} to {high:g} m; check the unit"
                " (unit_to_m)"
            )
        if stated is not None:
            return stated
        fitting = [unit for unit in _UNITS if low <= unit * width <= high]
        if len(fitting) == 1:
            return fitting[0]
    if stated is not None:
        return stated
    raise RecordingError(
        f"{where}: the unit of length is not stated, and neither pelvis nor shoulders show it;"
        " state the unit (unit_to_m)"
    )


def _said(widths: Widths, filled: Counter[str], count: int) -> list[str]:
    measured = widths != Widths()
    said = [
        "Joint centres are computed from the markers, which are taken to be 14 mm wide: the hips"
        " from the pelvis (Harrington et al. 2007), the others inside their markers by"
        f" {1000 * widths.knee:.0f} mm at the knee, {1000 * widths.ankle:.0f} at the ankle,"
        f" {1000 * widths.elbow:.0f} at the elbow and {1000 * widths.shoulder:.0f} at the shoulder"
        f" ({'as measured in the file' if measured else 'adult averages'}) where only one side has"
        " a marker."
    ]
    words = "are not seen and are placed by those that move with them"
    return [*said, *_counted(words, _most_first(filled), count)]


def astray_said(motion: JointMotion, astray: Astray) -> list[str]:
    """Return a sentence about markers that are left out because they are in a wrong place, or none.

    It is not repeated for a motion from which they have been removed.
    """
    words = "are far from those that move with them and are left out"
    if any(words in note for note in motion.notes):
        return []
    return _counted(
        words, _most_first({name: len(frames) for name, frames in astray.items()}), len(motion.time)
    )


_MOST: Final = 6
"""Largest number of markers that a sentence names."""


def _most_first(counts: Mapping[str, int]) -> list[tuple[str, int]]:
    """Return names in words and counts, the largest first."""
    # Equal counts are sorted by name, so that the order does not depend on the blocks.
    ordered = sorted(counts.items(), key=lambda pair: (-pair[1], pair[0]))
    return [(spoken(name), count) for name, count in ordered]


def _counted(words: str, each: list[tuple[str, int]], count: int) -> list[str]:
    each = [(name, frames) for name, frames in each if frames]
    if not each:
        return []
    shares = ", ".join(f"{name} in {frames}" for name, frames in each[:_MOST])
    more = f" and {len(each) - _MOST} more markers" if len(each) > _MOST else ""
    return [f"Of {count} frames, markers {words}: {shares}{more}."]


def off_origin(motion: JointMotion, which: Sequence[int]) -> JointMotion:
    """Return a motion in which markers at exactly 0, 0, 0 are not seen, with a note about it.

    The given array is not changed.

    Args:
        motion: the markers.
        which: indices of the markers that are checked.
    """
    columns, positions = np.array(which, dtype=int), motion.positions
    counts = np.zeros(len(columns), dtype=int)
    for start in range(0, len(positions), _BLOCK):
        lost = (motion.positions[start : start + _BLOCK, columns] == 0).all(axis=2)
        if not lost.any():
            continue
        if positions is motion.positions:
            positions = positions.copy()
        frames, at = np.nonzero(lost)
        positions[start + frames, columns[at]] = np.nan
        counts += lost.sum(axis=0)
    if positions is motion.positions:
        return motion
    found = [(motion.names[i], count) for i, count in zip(which, counts.tolist(), strict=True)]
    found = sorted(found, key=lambda each: -each[1])
    said = _counted("at exactly 0, 0, 0 are taken as not seen", found, len(positions))
    return replace(motion, positions=positions, notes=(*motion.notes, *said))
