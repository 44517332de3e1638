"""Xsens MVN's export of a recording as XML: poses of 23 segments, and joint angles.

A segment's place is that of the joint it begins in; z is up, lengths are metres, quaternions are
w, x, y, z (Xsens, "MVN User Manual", MVNX; version 3 was read as a file of others, version 4 is
the same in what is read here).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO, Final
from xml.etree import ElementTree

import numpy as np

from ergoqp.errors import RecordingError
from ergoqp.progress import Progress
from ergoqp.recordings.formats.opening import binary, short
from ergoqp.recordings.formats.poses import unit_turns
from ergoqp.recordings.formats.rows import Asked, gathered
from ergoqp.recordings.formats.stamps import repeated, seconds
from ergoqp.recordings.motion import JointMotion

_AXES: Final = ("abduction", "rotation", "flexion")
"""Of the three angles of a joint, in Xsens' order z, x, y of axes."""
_BLOCK: Final = 4000


def read_mvnx(path: Path, progress: Progress, asked: Asked) -> JointMotion:
    """Return segments and joint angles of a recording; its calibration poses are left out.

    Args:
        path: the file.
        progress: told how much of it is read.
        asked: unused, the file states its rate.

    Raises:
        RecordingError: it is no whole MVNX file, or holds several people.
    """
    size = max(path.stat().st_size, 1) if path.is_file() else 1
    with binary(path) as file:
        segments: list[str] = []
        joints: list[str] = []
        indices, places, turns, angles = [], [], [], []
        block: list[list[float]] = []
        rate, posed, subjects = None, 0, 0
        for event, element in _elements(path, file):
            tag = element.tag.rpartition("}")[2]
            if event == "start":
                if tag == "subject":
                    subjects += 1
                    rate = _rate(path, element.get("frameRate"))
                    if subjects > 1:
                        raise RecordingError(
                            f"{path.name}: got several people, allowed one: export them one by one"
                        )
                continue
            if tag == "segment":
                segments.append(str(element.get("label")))
            elif tag == "joint":
                joints.append(str(element.get("label")))
            elif tag == "frame":
                if element.get("type", "normal") == "normal":
                    index, row = _frame(path, element, len(segments), len(joints))
                    indices.append(index)
                    block.append(row)
                else:
                    posed += 1
                if len(block) == _BLOCK:
                    _take(block, len(segments), places, turns, angles)
                    progress(min(file.tell() / size, 1.0))
            if tag in {"frame", "segment", "joint"}:
                element.clear()
        if block:
            _take(block, len(segments), places, turns, angles)
    if not segments or rate is None:
        raise RecordingError(f"{path.name}: got no segments, allowed an MVNX file with a subject")
    if not indices:
        raise RecordingError(f"{path.name}: got no frame of movement, allowed normal frames")
    positions, quaternions, bent = gathered(places), gathered(turns), gathered(angles)
    time, kept, notes = seconds(path.name, np.array(indices) / rate, 1.0)
    positions, quaternions, bent = positions[kept], quaternions[kept], bent[kept]
    if posed:
        notes.append(f"{posed} calibration poses (N-pose, T-pose) of the file are left out.")
    return JointMotion(
        tuple(segments),
        positions,
        time,
        None,
        (*notes, *repeated(positions)),
        turns={name: unit_turns(quaternions[:, i]) for i, name in enumerate(segments)},
        angles={
            f"{joint} {axis}": np.radians(bent[:, 3 * i + j])
            for i, joint in enumerate(joints)
            for j, axis in enumerate(_AXES)
            if bent.shape[1]
        },
        unit=1.0,
        up="z",
    )


def _elements(path: Path, file: BinaryIO) -> Iterator[tuple[str, Any]]:
    """Return the elements of an XML file as they begin and end, or say where it is none."""
    try:
        yield from ElementTree.iterparse(file, events=("start", "end"))
    except ElementTree.ParseError as error:
        line, column = error.position
        raise RecordingError(
            f"{path.name}, line {line}: got no XML at column {column + 1}"
            f" ({error.msg.split(':')[0]}), allowed a whole MVNX file"
        ) from None


def _rate(path: Path, stated: str | None) -> float:
    try:
        rate = float(stated or "")
    except ValueError:
        rate = 0.0
    if not 1.0 <= rate <= 10_000.0:
        raise RecordingError(
            f"{path.name}: frameRate: got {stated!r}, allowed frames per second from 1 to 10000"
        )
    return rate


def _frame(path: Path, element: Any, segments: int, joints: int) -> tuple[int, list[float]]:
    """Return a frame's index, and its places, quaternions and joint angles in a row."""
    found = {child.tag.rpartition("}")[2]: child.text or "" for child in element}
    row: list[float] = []
    index = str(element.get("index"))
    for what, width in (
        ("position", 3 * segments),
        ("orientation", 4 * segments),
        ("jointAngle", 3 * joints),
    ):
        if what == "jointAngle" and what not in found:
            continue
        words = found.get(what, "").split()
        try:
            values = [float(word) for word in words]
        except ValueError:
            values = []
        if len(values) != width or not np.isfinite(values).all():
            raise RecordingError(
                f"{path.name}: frame {short(index)}: got {len(words)} words for {what}, allowed"
                f" {width} numbers"
            )
        row += values
    if not index.lstrip("-").isdigit():
        raise RecordingError(
            f"{path.name}: got a frame with the index {short(index)}, allowed a whole number"
        )
    return int(index), row


def _take(
    block: list[list[float]],
    segments: int,
    places: list[np.ndarray],
    turns: list[np.ndarray],
    angles: list[np.ndarray],
) -> None:
    """Move rows into arrays; what cannot be in one is a mistake of the file."""
    values = np.array(block)
    block.clear()
    places.append(values[:, : 3 * segments].reshape(len(values), -1, 3).astype(np.float32))
    quaternions = values[:, 3 * segments : 7 * segments].reshape(len(values), -1, 4)
    turns.append(quaternions[:, :, [1, 2, 3, 0]].astype(np.float32))
    angles.append(values[:, 7 * segments :].astype(np.float32))
