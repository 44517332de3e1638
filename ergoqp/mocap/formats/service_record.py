"""Records of the service: the postures that its clients have sent, as its MCAP files hold them.

The fields of the frames are found by the schema that stands in the file itself.
"""

from __future__ import annotations

import json
import struct
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np

from ergoqp.arguments import Progress
from ergoqp.errors import ErgoqpError, MissingExtraError, RecordingError
from ergoqp.files.mcap import mcap_records, open_mcap, profile_of
from ergoqp.joints import JOINTS
from ergoqp.mocap.formats.text import TableOptions, some
from ergoqp.mocap.formats.times import to_seconds
from ergoqp.mocap.recording import JointMotion
from ergoqp.problem.load import problem_from_dict

PROFILE: Final = "ergoqp"
"""Profile of the file."""
_ENCODING: Final = "x-ergoqp-frames"
_METADATA: Final = "ergoqp loop "
_CODES: Final = {"u16": "H", "u32": "I", "u64": "Q", "f64": "d", "text": "s"}
_PROGRESS: Final = 1000
"""Messages between two reports of progress."""


def is_record(first: bytes) -> bool:
    """Return whether a file is a record of the service, by its first bytes."""
    return profile_of(first) == PROFILE


class _Layout:
    """Where the fields of a frame are."""

    def __init__(self, fields: Sequence[Mapping[str, Any]], sizes: Mapping[str, int]) -> None:
        self._at: dict[str, tuple[int, str]] = {}
        start = 0
        for each in fields:
            count = sizes[each["count"]] if isinstance(each["count"], str) else int(each["count"])
            code = f"<{count}{_CODES[each['kind']]}"
            self._at[each["name"]] = start, code
            start += struct.calcsize(code)
        self.length = start

    def of(self, name: str, data: bytes, start: int = 0) -> tuple[Any, ...]:
        """Return the numbers of a field of the frame that begins at `start`."""
        at, code = self._at[name]
        return struct.unpack_from(code, data, start + at)


class _Steps:
    """The postures of one loop."""

    def __init__(self, schema: Mapping[str, Any], channel: Mapping[str, str]) -> None:
        sizes = {name: int(channel[name]) for name in ("coordinates", "rows")}
        self.loop, self.names = channel["loop"], json.loads(channel["names"])
        self._message, self._request, self._answer = (
            _Layout(schema[name], sizes) for name in ("message", "request", "answer")
        )
        self._flags, self._step = schema["flags"], schema["answers"]["step"]
        self.times: list[int] = []
        self.postures: list[np.ndarray] = []
        self.poses: list[np.ndarray] = []
        self.unused = 0

    def take(self, data: bytes) -> None:
        """Add the posture of a message, if it has one."""
        (time,) = self._message.of("time", data)
        request = self._message.length
        answer = request + self._message.of("request", data)[0]
        (bits,) = self._request.of("flags", data, request)
        stepped = self._answer.of("kind", data, answer)[0] == self._step
        if not (stepped and bits & self._flags["frame"]):
            self.unused += 1
            return
        posture = np.array(self._request.of("posture", data, request))
        if bits & self._flags["observed"]:
            seen = np.array(self._request.of("observed", data, request))
            posture[seen != 1.0] = np.nan
        # A clock that was set back gives no frames until it is where it was.
        if (
            np.isinf(posture).any()
            or np.isnan(posture).all()
            or time <= max(self.times[-1:] or [0])
        ):
            self.unused += 1
            return
        self.times.append(time)
        self.postures.append(posture)
        self.poses.append(np.array(self._answer.of("pose", data, answer)).reshape(4, 4))


def read_service_record(path: Path, progress: Progress, asked: TableOptions) -> JointMotion:
    """Return the joint angles that a client of the service has sent, and the poses of the object.

    Args:
        path: the file.
        progress: is called with the share of the file that is read.
        asked: the subject is the loop, where there are several.

    Raises:
        RecordingError: if it is no record, is damaged, or shows no posture of a person.
        MissingExtraError: if the package for MCAP files is not installed.
    """
    try:
        with open_mcap(path, "a record of the service") as file:
            loops, told, notes = _read(file, path.stat().st_size, progress)
    except (ErgoqpError, MissingExtraError):
        raise
    except OSError as error:
        raise RecordingError(f"{path.name}: cannot be read ({error.strerror})") from None
    except Exception:  # whatever broken bytes cause
        raise RecordingError(f"{path.name}: the record is damaged") from None
    steps = _chosen(path.name, loops, asked.subject)
    if steps.unused:
        notes.append(f"{steps.unused} steps without a posture are left out.")
    postures = np.stack(steps.postures)
    stamps = 1e-9 * (np.array(steps.times) - steps.times[0])
    objects = _beside(told.get(steps.loop, {}), postures, np.stack(steps.poses))
    if objects is None:
        notes.append("The object is left out: its place beside the person is unknown.")
    time, kept, said = to_seconds(path.name, stamps, 1.0, [postures])
    motion = JointMotion(
        (),
        np.empty((len(stamps), 0, 3)),
        stamps,
        notes=(*said, *notes),
        angles=dict(zip(steps.names, postures.T, strict=True)),
        objects={} if objects is None else {"object": objects},
        subject=steps.loop,
        beside=objects is not None,
    )
    return replace(motion if kept.all() else motion.at(kept), time=time)


def _read(
    file: BinaryIO, size: int, progress: Progress
) -> tuple[list[_Steps], dict[str, Mapping[str, str]], list[str]]:
    """Return the loops of a person, metadata by loop, and sentences."""
    schemas: dict[int, Any] = {}
    loops: dict[int, _Steps] = {}
    told: dict[str, Mapping[str, str]] = {}
    damaged, cut_off = 0, False
    for number, record in enumerate(mcap_records(file)):
        kind = type(record).__name__
        if kind == "Message" and record.channel_id in loops:
            loops[record.channel_id].take(record.data)
        elif kind == "Schema" and record.encoding == _ENCODING:
            schemas[record.id] = json.loads(record.data)
        elif kind == "Channel" and record.message_encoding == _ENCODING:
            if record.id not in loops:  # it is repeated at the end
                loops[record.id] = _Steps(schemas[record.schema_id], record.metadata)
        elif kind == "Metadata" and record.name.startswith(_METADATA):
            told[record.name.removeprefix(_METADATA)] = record.metadata
        elif kind == "Unreadable":
            damaged, cut_off = damaged + 1, cut_off or record.cut_off
        if number % _PROGRESS == 0:
            progress(min(1.0, file.tell() / size))
    notes = ["The file was cut off; it is read up to there."] if cut_off else []
    if damaged > cut_off:
        notes.append(f"{damaged - cut_off} damaged parts of the file are left out.")
    return list(loops.values()), told, notes


def _chosen(where: str, loops: Sequence[_Steps], subject: str | None) -> _Steps:
    """Return the loop that is asked for, or the only one."""
    people = [each for each in loops if tuple(each.names) == JOINTS and each.postures]
    if not people:
        raise RecordingError(
            f"{where}: got a record without a posture, allowed one of a loop that moves a person"
        )
    if subject is None and len(people) > 1:
        raise RecordingError(
            f"{where}: got {len(people)} loops ({some([each.loop for each in people])}), allowed"
            " one; state the loop that is meant (subject)"
        )
    for each in people:
        if subject is None or each.loop == subject:
            return each
    raise RecordingError(
        f"{where}: subject: got {subject!r}, allowed {some([repr(each.loop) for each in people])}"
    )


def _beside(told: Mapping[str, str], postures: np.ndarray, poses: np.ndarray) -> np.ndarray | None:
    """Return the poses of the object in the axes of the pelvis (n, 4, 4); None if unknown.

    Args:
        told: metadata of the loop.
        postures: joint angles (n, 32) [rad].
        poses: contact frame in the world (n, 4, 4) [m].
    """
    try:
        folder = Path(told["folder"]) if told["folder"] else None
        problem = problem_from_dict(tomllib.loads(told["text"]), told["problem"], folder)
    except (ErgoqpError, KeyError, ValueError):
        return None
    contact = problem.response.contact()
    found = contact.map(len(postures))(postures.T)[1]
    pelvis = np.array(found).reshape(4, -1, 4).transpose(1, 0, 2)
    return np.linalg.inv(pelvis) @ poses if np.isfinite(pelvis).all() else None
