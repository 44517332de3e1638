"""From a recording of markers to one of joint centres, block by block."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.joints import SIDES
from ergoqp.progress import Progress, unseen
from ergoqp.recordings.formats.opening import some
from ergoqp.recordings.markers.centres import Widths, centres_of_landmarks
from ergoqp.recordings.markers.rigid import follow, shape_of
from ergoqp.recordings.motion import JointMotion
from ergoqp.recordings.names import CENTRES

_BLOCK: Final = 8192
"""Frames at once."""
_SAMPLE: Final = 4000
"""Frames by which shapes and widths are found."""
_PELVIS: Final = (0.15, 0.40)
"""How far apart the two ASIS of a person are [m]."""
_SHOULDERS: Final = (0.22, 0.55)
"""How far apart a person's acromions are [m]."""
_UNITS: Final = (1.0, 0.01, 0.001, 0.0254)
_SEGMENTS: Final = {
    "pelvis": ("right_asis", "left_asis", "right_psis", "left_psis", "sacrum"),
    "trunk": ("c7", "back", "notch", "xiphoid"),
    "head": tuple(f"{side}_head_{end}" for side in SIDES for end in ("front", "back")),
}
"""Landmarks that move as one."""


@dataclass(frozen=True, eq=False)
class Rigid:
    """What moves as one.

    Attributes:
        names: its landmarks and further markers.
        places: of each, which points are its middle.
        shape: where they are in it (m, 3) [m].
    """

    names: tuple[str, ...]
    places: tuple[tuple[int, ...], ...]
    shape: np.ndarray


def joints_of_markers(
    motion: JointMotion,
    where: str,
    landmarks: Mapping[str, tuple[int, ...]],
    more: Mapping[str, tuple[int, ...]],
    shapes: Mapping[str, np.ndarray],
    unit: float,
    progress: Progress = unseen,
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Return joint centre -> positions (n, 3) [m] below markers, and sentences on how.

    Args:
        motion: the markers.
        where: its name, for messages.
        landmarks: landmark, or joint centre -> the places of the markers whose middle it is.
        more: rigid segment -> the places of its further markers.
        shapes: name of a marker -> where it is on its segment, as a person file has it (3,) [m].
        unit: the file's unit of length [m].
        progress: told the share of the frames that is done.

    Raises:
        RecordingError: the pelvis cannot be placed.
    """
    every = max(1, len(motion.time) // _SAMPLE)
    size = _size(_at(landmarks, motion.positions[::every], unit))
    if not np.isfinite(size).all() and not {"pelvis", "right_hip", "left_hip"} & set(landmarks):
        raise RecordingError(
            f"{where}: the pelvis cannot be placed; the recording needs both ASIS, and both PSIS or"
            f" the sacrum; it has {some(list(landmarks))}"
        )
    rigid = _rigid(motion, landmarks, more, shapes, unit, every)
    widths, count = Widths.of(motion.measures), len(motion.time)
    # Each by itself, so that it can be let go of by itself.
    centres: dict[str, np.ndarray] = {}
    filled: dict[str, int] = {}
    astray: dict[str, int] = {}
    for start in range(0, count, _BLOCK):
        block = motion.positions[start : start + _BLOCK]
        at = _at(landmarks, block, unit)
        for segment in rigid:
            _completed(at, block, unit, segment, filled, astray)
        found = centres_of_landmarks(at, widths, size)
        found |= {name: path for name, path in at.items() if name in CENTRES}
        for name, path in found.items():
            if name not in centres:
                centres[name] = np.full((count, 3), np.nan, dtype=np.float32)
            centres[name][start : start + len(block)] = path
        progress(min((start + _BLOCK) / count, 1.0))
    return centres, _said(widths, filled, astray, count)


def _at(
    places: Mapping[str, tuple[int, ...]], block: np.ndarray, unit: float
) -> dict[str, np.ndarray]:
    """Return landmark -> positions (n, 3) [m]."""
    return {
        name: unit * block[:, list(which)].astype(float).mean(axis=1)
        for name, which in places.items()
    }


def _rigid(
    motion: JointMotion,
    landmarks: Mapping[str, tuple[int, ...]],
    more: Mapping[str, tuple[int, ...]],
    shapes: Mapping[str, np.ndarray],
    unit: float,
    every: int,
) -> list[Rigid]:
    """Return the segments of which three points and more are known."""
    found = []
    for segment, parts in _SEGMENTS.items():
        which = {name: landmarks[name] for name in parts if name in landmarks}
        which |= {motion.names[i]: (i,) for i in more.get(segment, ())}
        if len(which) < 3:
            continue
        points = np.stack(
            [
                unit * motion.positions[::every, list(each)].astype(float).mean(axis=1)
                for each in which.values()
            ],
            axis=1,
        )
        given = [shapes.get(motion.names[each[0]], np.full(3, np.nan)) for each in which.values()]
        known = np.isfinite(given).all(axis=1)
        shape = np.array(given) if known.sum() >= 3 else shape_of(points)
        if shape is not None:
            found.append(Rigid(tuple(which), tuple(which.values()), shape))
    return found


def _completed(
    at: dict[str, np.ndarray],
    block: np.ndarray,
    unit: float,
    rigid: Rigid,
    filled: dict[str, int],
    astray: dict[str, int],
) -> None:
    """Put landmarks that are not seen, or astray, where the others of their segment have them."""
    points = np.stack(
        [unit * block[:, list(each)].astype(float).mean(axis=1) for each in rigid.places], axis=1
    )
    followed = follow(points, rigid.shape)
    for i, name in enumerate(rigid.names):
        if followed.astray[:, i].any():
            astray[name] = astray.get(name, 0) + int(followed.astray[:, i].sum())
        if name not in at:
            continue
        lost = np.isnan(at[name][:, 0]) & np.isfinite(followed.points[:, i, 0])
        if lost.any():
            filled[name] = filled.get(name, 0) + int(lost.sum())
        put = lost | followed.astray[:, i]
        at[name] = np.where(put[:, None], followed.points[:, i], at[name])


def _size(at: Mapping[str, np.ndarray]) -> tuple[float, float]:
    """Return width and depth of the pelvis [m]; NaN where it is not known."""
    if "right_asis" not in at or "left_asis" not in at:
        return float("nan"), float("nan")
    front = (at["right_asis"] + at["left_asis"]) / 2
    psis = [at[name] for name in ("right_psis", "left_psis") if name in at]
    back = (psis[0] + psis[1]) / 2 if len(psis) == 2 else at.get("sacrum")
    width = _median(at["left_asis"] - at["right_asis"])
    return width, float("nan") if back is None else _median(front - back)


def _median(vectors: np.ndarray) -> float:
    length = np.linalg.norm(vectors, axis=1)
    length = length[np.isfinite(length)]
    return float(np.median(length)) if len(length) else float("nan")


def unit_of_markers(
    motion: JointMotion, where: str, landmarks: Mapping[str, tuple[int, ...]]
) -> float:
    """Return the only unit with which pelvis or shoulders are a person's [m].

    Raises:
        RecordingError: there is none, or more than one.
    """
    every = max(1, len(motion.time) // _SAMPLE)
    at = _at(landmarks, motion.positions[::every], 1.0)
    for name, (low, high) in (("asis", _PELVIS), ("acromion", _SHOULDERS)):
        if f"right_{name}" not in at or f"left_{name}" not in at:
            continue
        width = _median(at[f"left_{name}"] - at[f"right_{name}"])
        fitting = [unit for unit in _UNITS if low <= unit * width <= high]
        if len(fitting) == 1:
            return fitting[0]
    raise RecordingError(
        f"{where}: the unit of length is not stated, and neither pelvis nor shoulders tell it;"
        " state the unit (unit_to_m)"
    )


def _said(
    widths: Widths,
    filled: Mapping[str, int],
    astray: Mapping[str, int],
    count: int,
) -> list[str]:
    measured = widths != Widths()
    said = [
        "Joint centres are computed from the markers, which are taken to be 14 mm wide: hips by"
        " the pelvis (Harrington et al. 2007), the others inside of their markers by"
        f" {1000 * widths.knee:.0f} mm at the knee, {1000 * widths.ankle:.0f} at the ankle,"
        f" {1000 * widths.elbow:.0f} at the elbow and {1000 * widths.shoulder:.0f} at the shoulder"
        f" ({'as the file has measured them' if measured else 'adult averages'}) where only one"
        " side has a marker."
    ]
    for words, each in (
        ("are not seen and put where those that move with them have them", filled),
        ("are nowhere near those that move with them, taken for another's and left out", astray),
    ):
        if each:
            worst = sorted(each, key=lambda name: -each[name])[:6]
            shares = ", ".join(f"{name.replace('_', ' ')} in {each[name]}" for name in worst)
            more = f" and {len(each) - 6} more markers" if len(each) > 6 else ""
            said.append(f"Of {count} frames, markers {words}: {shares}{more}.")
    return said
