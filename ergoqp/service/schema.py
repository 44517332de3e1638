"""The frames between service and clients: one declaration for Python, C, JSON and the docs.

A frame is a block of little-endian numbers. It begins with its length, so a stream of frames needs
no separator. Fields are only ever added at the end, and the last two versions are understood. Sizes
that depend on the problem are the number of coordinates and that of rows.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import Any, Final

import numpy as np

VERSION: Final = 1
"""Version of the frames."""

SPOKEN: Final = (1,)
"""Versions that the service understands: the last two."""

KNOTS: Final = 64
"""Most knots of a stop in an answer."""

TEXT: Final = 256
"""Bytes of the text of an answer, filled with zeros."""

LONGEST: Final = 1 << 20
"""Longest frame [bytes]; a longer one ends the connection."""


class Ask(IntEnum):
    """Kind of a request."""

    describe = 1
    step = 2
    step_by_names = 3
    """Reserved: the posture as positions by name, which the service will track."""


class Tell(IntEnum):
    """Kind of an answer."""

    described = 1
    """The text is JSON and as long as the frame says."""
    step = 2
    unknown = 3
    """The service does not know what the robot does: report that it stands, or take over."""
    refused = 4
    """The request was not carried out; the text says why."""


class Flag(IntFlag):
    """What a request contains and asks for."""

    frame = 1
    """A posture arrived."""
    pose = 2
    twist = 4
    observed = 8
    """Without it all joints are seen."""
    enable = 16
    stands = 32
    """The robot is reported to stand: begin anew."""
    takes_over = 64
    """The robot is reported to move at the given twist: begin anew from there."""
    hold = 128
    """Come to rest and stay there; in every request for as long as it holds."""
    try_again = 256
    guide = 512
    """Go to the given place, if the loop was started with a guide."""
    no_guide = 1024
    """Follow no guide."""
    explain = 2048
    """Give the reason as a text too."""
    brake = 4096
    """Only the next braking twist is wanted, as by `Stepper.brake`."""


class Mark(IntFlag):
    """What an answer says about the loop."""

    begun = 1
    """The loop began anew with this answer."""
    undone = 2
    """Answers that the robot did not execute were taken back."""
    still = 4
    """The object is at rest, and nothing is planned or sent that moves it."""
    unrecorded = 8
    """The recorder could not keep up with an earlier step."""


ENGINES: Final = ("interpreted", "compiled")
"""How the step was computed; the number is the place in this tuple."""

_CODES: Final = {"u16": "H", "u32": "I", "u64": "Q", "f64": "d", "text": "s"}


@dataclass(frozen=True)
class Field:
    """One member of a frame.

    Attributes:
        name: its name.
        kind: ``u16``, ``u32``, ``u64``, ``f64`` or ``text`` (bytes).
        meaning: what it is, with its unit.
        count: how many numbers it has for each problem: a number, or the name of a size.
        since: first version that has it.
    """

    name: str
    kind: str
    meaning: str
    count: int | str = 1
    since: int = 1

    def size(self, sizes: dict[str, int]) -> int:
        """Return the number of bytes."""
        count = sizes[self.count] if isinstance(self.count, str) else self.count
        return count * struct.calcsize(f"<{_CODES[self.kind]}")


_HEAD: Final = (
    Field("length", "u32", "bytes of the whole frame"),
    Field("version", "u16", "version of the frame"),
    Field("kind", "u16", "kind of the frame"),
    Field("session", "u64", "the beginning that this belongs to; 0: none yet"),
    Field("sequence", "u64", "number of the request, growing; its answer has the same"),
)

REQUEST: Final = (
    *_HEAD,
    Field("acted", "u64", "sequence of the answer that the robot executes; 0: none"),
    Field("problem", "u64", "digest of the problem that the client knows; 0: any"),
    Field("followed", "u32", "periods of that answer's stop that the robot has executed"),
    Field("flags", "u32", "what the request contains and asks for"),
    Field("coordinates", "u32", "entries of the posture"),
    Field("contact", "u32", "reserved, 0"),
    Field("age", "f64", "age of the posture [s]"),
    Field("dt", "f64", "for how long the twist will be executed, and each of its stop [s]"),
    Field("pose", "f64", "measured contact frame in the world, row-major 4 x 4 [m]", 16),
    Field("twist", "f64", "measured twist of the last period [m/s, rad/s]", 6),
    Field("guide", "f64", "place to go to, row-major 4 x 4 [m]", 16),
    Field("promise", "f64", "expected cost there, or one of the values for unknown [points]"),
    Field("posture", "f64", "the state, in the order of the coordinates [rad]", "coordinates"),
    Field("observed", "f64", "1 for entries that the sensors see, else 0", "coordinates"),
)

ANSWER: Final = (
    *_HEAD,
    Field("engine", "u16", "how the step was computed: 0 interpreted, 1 compiled"),
    Field("drawn", "u16", "phase of the guide; 0: none"),
    Field("status", "u32", "status of the step"),
    Field("causes", "u32", "bits by cause: inputs or answers that were not used, and why"),
    Field("reason", "u32", "number of the reason, see the table of reasons; 0: none"),
    Field("marks", "u32", "what is to be known about the loop"),
    Field("coordinates", "u32", "entries of the posture"),
    Field("rows", "u32", "number of rows"),
    Field("knots", "u32", "number of knots of the stop"),
    Field("computed", "f64", "time that the step took [s]"),
    Field("twist", "f64", "send this: velocity at the contact frame [m/s, rad/s]", 6),
    Field("pose", "f64", "contact frame that the step used, row-major 4 x 4 [m]", 16),
    Field("posture_rate", "f64", "how the model person follows [rad/s]", "coordinates"),
    Field("fault", "f64", "how the robot deviates, and by how much", 2),
    Field("frames", "f64", "comparison of pose and posture, see ergoqp.step.frames_check", 6),
    Field("cost", "f64", "V of the posture [points]"),
    Field("gain", "f64", "predicted improvement within one second at full speed [points]"),
    Field("margins", "f64", "distance of each row to its nearer end, in its unit", "rows"),
    Field("slack", "f64", "violation of each row in the QP, in its unit per second", "rows"),
    Field("multipliers", "f64", "multiplier of each row in the QP", "rows"),
    Field("locked", "f64", "1 for joints that are held at their end", "coordinates"),
    Field("outside", "f64", "1 for rows that are outside and coming back", "rows"),
    Field("residuals", "f64", "qp, contact, accepted", 3),
    Field(
        "times",
        "f64",
        "when each knot of the stop is due, from the twist on [s]; the first `knots` count",
        KNOTS,
    ),
    Field("stop", "f64", "twist of each knot [m/s, rad/s]; the last one is zero", KNOTS * 6),
    Field("speed", "f64", "limits of the twist, per axis [m/s, rad/s]", 6),
    Field("acceleration", "f64", "limits of its change, per axis [m/s^2, rad/s^2]", 6),
    Field("longest_dt", "f64", "longest time for which a twist may be executed [s]"),
    Field("text", "text", "the reason in words, if it was asked for; UTF-8", TEXT),
)

HEAD: Final = struct.Struct("<IHHQQ")
"""What all frames begin with."""

REQUEST_HEAD: Final = struct.Struct("<IHHQQQQIIIIdd")
"""The request up to and with ``dt``."""

ANSWER_HEAD: Final = struct.Struct("<IHHQQHHIIIIIIId")
"""The answer up to and with ``computed``."""


class Frame:
    """Layout of a frame for a problem: offsets of its fields, and views of a buffer.

    Attributes:
        at: slice of bytes of each field, by name.
        length: bytes of the whole frame.
    """

    def __init__(self, fields: tuple[Field, ...], coordinates: int, rows: int) -> None:
        """Compute the offsets; every number lies at a multiple of its size."""
        sizes, start = {"coordinates": coordinates, "rows": rows}, 0
        self.fields, self.at = fields, dict[str, slice]()
        for field in fields:
            size = field.size(sizes)
            self.at[field.name] = slice(start, start + size)
            start += size
        self.length = start

    def numbers(self, buffer: Any, first: str, last: str | None = None) -> np.ndarray:
        """Return a view of the doubles of one field, or of those from one to another."""
        begin, end = self.at[first].start, self.at[last or first].stop
        return np.frombuffer(buffer, "<f8", (end - begin) // 8, begin)


def request_frame(coordinates: int) -> Frame:
    """Return the layout of a request."""
    return Frame(REQUEST, coordinates, 0)


def answer_frame(coordinates: int, rows: int) -> Frame:
    """Return the layout of an answer."""
    return Frame(ANSWER, coordinates, rows)


def schema() -> dict[str, Any]:
    """Return the description of all frames: numbers, texts and lists alone, ready for JSON.

    Example:
        >>> from ergoqp.service.schema import schema
        >>> schema()["version"], schema()["request"][0]["name"]
        (1, 'length')
    """

    def listed(fields: tuple[Field, ...]) -> list[dict[str, Any]]:
        return [dict(vars(field)) for field in fields]

    def named(kinds: Any) -> dict[str, int]:
        return {each.name: int(each) for each in kinds}

    return {
        "version": VERSION,
        "spoken": list(SPOKEN),
        "byte_order": "little",
        "knots": KNOTS,
        "longest_frame": LONGEST,
        "engines": list(ENGINES),
        "requests": named(Ask),
        "answers": named(Tell),
        "flags": named(Flag),
        "marks": named(Mark),
        "request": listed(REQUEST),
        "answer": listed(ANSWER),
    }


def note(kind: Tell, sequence: int, text: str, session: int = 0) -> bytes:
    """Return an answer without numbers: ``described``, ``unknown`` or ``refused``, with its text.

    It is the head of an answer, and the text.
    """
    body = text.encode()
    if kind is not Tell.described:
        body = body[: TEXT - 1].ljust(TEXT, b"\0")
    length = ANSWER_HEAD.size + len(body)
    zeros = (0,) * (len(ANSWER_HEAD.unpack(bytes(ANSWER_HEAD.size))) - 5)
    return ANSWER_HEAD.pack(length, VERSION, kind, session, sequence, *zeros) + body
