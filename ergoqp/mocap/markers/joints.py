"""Joint centres from a recording of markers, block by block."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.human.person_file import Marker
from ergoqp.joints import SIDES
from ergoqp.mocap.markers.centres import Widths, centres_of_landmarks, roots_of
from ergoqp.mocap.markers.landmarks import RIGID, Links, check_order, usual_distance
from ergoqp.mocap.markers.rigid import middle_of, pelvis_size, rigid_segments
from ergoqp.mocap.names import CENTRES
from ergoqp.mocap.recording import JointMotion
from ergoqp.progress import Progress, unseen

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
_BARE_ELBOW: Final = (
    "An elbow with one marker is taken to bend about the axis that this marker shows, as in"
    " Plug-in Gait: if the arm is bent by less than 25 deg, the elbow may be off by 12 deg and the"
    " upper arm's rotation by 15 deg."
)
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
) -> tuple[dict[str, np.ndarray], list[str], Astray]:
    """Return joint centre -> positions (n, 3) [m], sentences, and the markers that are left out.

    Args:
        motion: the markers.
        where: the recording's name, for messages.
        landmarks: landmark, or joint centre -> indices of the markers whose middle it is.
        more: rigid segment -> indices of its further markers.
        given: name of a marker -> its place on the body, from a person file.
        unit: the file's unit of length [m].
        progress: is called with the share of the frames that is done.

    Raises:
        RecordingError: if the pelvis cannot be placed, or markers are in impossible places.
    """
    every = max(1, len(motion.time) // _SAMPLE)
    # If one marker of a wrist is never seen, the wrist is computed from the other one.
    landmarks = {
        name: which
        for name, which in landmarks.items()
        if "_wrist_" not in name or np.isfinite(motion.positions[:, list(which), 0]).any()
    }
    segments, said = rigid_segments(motion, landmarks, more, given, unit, every)
    size = pelvis_size(segments)
    if not np.isfinite(size).all() and not {"pelvis", "right_hip", "left_hip"} & set(landmarks):
        unplaced = _unplaced(where, _at(landmarks, motion.positions[::every], unit))
        # A person file of somebody else may be the reason, so its sentence is added.
        for sentence in said:
            if "pelvis's markers are not where" in sentence:
                unplaced += f"; t{sentence[1:-1]}"
        raise RecordingError(unplaced)
    widths, count = Widths.of(motion.measures), len(motion.time)
    sample = _at(landmarks, motion.positions[::every], unit)
    check_order(where, sample)
    links = Links(roots_of(sample, widths, size) | sample)
    step = float(np.median(np.diff(motion.time))) if count > 1 else _ON_ITS_WAY
    around = round(_ON_ITS_WAY / step)
    # One array per centre, so that the memory of each can be freed separately.
    centres: dict[str, np.ndarray] = {}
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
        for name, away in links.astray(roots_of(at, widths, size) | at, around).items():
            # The shoulder is computed from the acromion, so the acromion is the wrong marker.
            landmark = name.replace("shoulder", "acromion")
            if landmark in at:
                _add(astray, landmark, start, away[inside])
                at[landmark] = np.where(away[:, None], np.nan, at[landmark])
        found = centres_of_landmarks(at, widths, size)
        found |= {name: path for name, path in at.items() if name in CENTRES}
        for name, path in found.items():
            if name not in centres:
                centres[name] = np.full((count, 3), np.nan, dtype=np.float32)
            centres[name][start : start + _BLOCK] = path[inside]
        progress(min((start + _BLOCK) / count, 1.0))
    bare = [s for s in SIDES if f"{s}_outer_elbow" in sample and f"{s}_inner_elbow" not in sample]
    how = [*_said(widths, filled, count), *([_BARE_ELBOW] if bare else [])]
    return centres, [*how, *astray_said(motion, astray), *said], astray


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
    motion: JointMotion,
    where: str,
    landmarks: Mapping[str, tuple[int, ...]],
    stated: float | None,
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
    return [*said, *_counted(words, filled, count)]


def astray_said(motion: JointMotion, astray: Astray) -> list[str]:
    """Return a sentence about markers that are left out because they are in a wrong place, or none.

    It is not repeated for a motion from which they have been removed.
    """
    words = "are far from those that move with them and are left out"
    if any(words in note for note in motion.notes):
        return []
    counts = Counter({name: len(frames) for name, frames in astray.items()})
    return _counted(words, counts, len(motion.time))


def _counted(words: str, each: Counter[str], count: int) -> list[str]:
    each = +each
    if not each:
        return []
    # Equal counts are sorted by name, so that the order does not depend on the blocks.
    most = sorted(each.items(), key=lambda pair: (-pair[1], pair[0]))[:6]
    shares = ", ".join(f"{name.replace('_', ' ')} in {frames}" for name, frames in most)
    more = f" and {len(each) - 6} more markers" if len(each) > 6 else ""
    return [f"Of {count} frames, markers {words}: {shares}{more}."]


_MOST: Final = 6
"""Largest number of markers that a sentence names."""


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
        block = motion.positions[start : start + _BLOCK]
        # Most files have no such marker, so two coordinates are tested first, for speed.
        lost = (block[:, columns, 0] == 0) & (block[:, columns, 1] == 0)
        if not lost.any():
            continue
        lost &= block[:, columns, 2] == 0
        if not lost.any():
            continue
        if positions is motion.positions:
            positions = positions.copy()
        frames, at = np.nonzero(lost)
        positions[start + frames, columns[at]] = np.nan
        counts += lost.sum(axis=0)
    if positions is motion.positions:
        return motion
    names = [motion.names[i] for i in which]
    found = sorted(zip(counts.tolist(), names, strict=True), key=lambda each: -each[0])
    found = [each for each in found if each[0]]
    shares = ", ".join(f"{name} in {count}" for count, name in found[:_MOST])
    more = f" and {len(found) - _MOST} more markers" if len(found) > _MOST else ""
    said = (
        f"Of {len(positions)} frames, markers at exactly 0, 0, 0 are taken as not seen:"
        f" {shares}{more}."
    )
    return replace(motion, positions=positions, notes=(*motion.notes, said))
