"""The frames between a client and `ergoqp relay`, which executes twists and their stops.

They are declared like those of the service, see `ergoqp.service.schema`, and have one size.
"""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import Final

from ergoqp.service.schema import KNOTS, TEXT, Field, Frame

RELAY_VERSION: Final = 1
"""Version of the frames of the relay."""


class RelayAsk(IntEnum):
    """Kind of a frame to the relay."""

    status = 1
    """What is executed? It is a head alone."""
    execute = 2
    """Execute this twist, and its stop."""


class RelayTell(IntEnum):
    """Kind of an answer of the relay."""

    status = 1
    accepted = 2
    refused = 3
    """The frame is not executed; code and text say why. What was executed before goes on."""


class Base(IntEnum):
    """What a twist continues from."""

    continues = 1
    """From the answer ``acted`` after ``followed`` periods of its stop."""
    rest = 2
    """From rest."""
    motion = 3
    """From the motion ``from``: it takes over."""


class Why(IntEnum):
    """Why the relay refuses a frame."""

    none = 0
    frame = 1
    """Version, kind or length."""
    numbers = 2
    """A number is not finite or out of range."""
    limits = 3
    """The twist or its stop exceeds the frame's own speed or acceleration."""
    base = 4
    """It does not continue from what is executed."""
    moves = 5
    """It begins at rest, and the output moves."""
    motion = 6
    """It takes over, and the output moves otherwise."""
    taken = 7
    """Another client is connected."""
    ends = 8
    """The relay was told to end."""


_HEAD: Final = (
    Field("length", "u32", "bytes of the whole frame"),
    Field("version", "u16", "version of the frame"),
    Field("kind", "u16", "kind of the frame"),
    Field("number", "u64", "number of the frame, growing; its answer has the same"),
)

EXECUTE: Final = (
    *_HEAD,
    Field("session", "u64", "session of the service's answer"),
    Field("sequence", "u64", "sequence of the service's answer"),
    Field("acted", "u64", "sequence of the answer that it continues from; 0: none"),
    Field("followed", "u32", "periods of that answer's stop that it continues after"),
    Field("base", "u32", "what it continues from"),
    Field("knots", "u32", "number of knots of the stop"),
    Field("reserved", "u32", "0"),
    Field("dt", "f64", "period in which the twist is reached [s]"),
    Field("acceleration", "f64", "limits of the output [m/s^2, rad/s^2]", 6),
    Field("speed", "f64", "limits of the output [m/s, rad/s]", 6),
    Field("from", "f64", "the motion that it takes over [m/s, rad/s]", 6),
    Field("twist", "f64", "the twist [m/s, rad/s]", 6),
    Field("times", "f64", "when each knot of the stop is due, from the twist on [s]", KNOTS),
    Field("stop", "f64", "twist of each knot [m/s, rad/s]; the last one is zero", KNOTS * 6),
)

TOLD: Final = (
    *_HEAD,
    Field("session", "u64", "session of the answer that is executed; 0: none"),
    Field("sequence", "u64", "sequence of the answer that is executed"),
    Field("begun", "u32", "periods of its stop that have begun"),
    Field("why", "u32", "why a frame is refused; 0: it is not"),
    Field("stands", "u32", "1 if the output is zero until a frame is accepted"),
    Field("reserved", "u32", "0"),
    Field("twist", "f64", "present output [m/s, rad/s]", 6),
    Field("text", "text", "why a frame is refused, in words; UTF-8", TEXT),
)

RELAY_HEAD: Final = struct.Struct("<IHHQ")
"""What all frames of the relay begin with."""

EXECUTE_HEAD: Final = struct.Struct("<IHHQQQQIIIId")
"""A frame to execute, up to and with ``dt``."""

TOLD_HEAD: Final = struct.Struct("<IHHQQQIIII")
"""An answer up to and with ``reserved``."""

DATAGRAM: Final = struct.Struct("<Qd6d")
"""What the robot's driver gets: number, time since the start of the relay [s], twist."""


def execute_frame() -> Frame:
    """Return the layout of a frame to execute."""
    return Frame(EXECUTE, 0, 0)


def told_frame() -> Frame:
    """Return the layout of an answer of the relay."""
    return Frame(TOLD, 0, 0)
