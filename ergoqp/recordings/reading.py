"""Options for reading a recording, as the user states them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from ergoqp.errors import InputError
from ergoqp.human import Body
from ergoqp.human.person_file import Marker
from ergoqp.recordings.motion import JointMotion
from ergoqp.recordings.naming import Naming

_ROUNDED: Final = 1e-3  # s


@dataclass(frozen=True)
class Reading:
    """Options for reading a recording; what is None is found from the recording.

    Attributes:
        body: the person.
        shapes: marker -> its place on the body, from a person file.
        subject: the person whose joints are read: the prefix of their names.
        thing: name of the object that the person holds.
        unit: size of the unit of length [m].
        up: the vertical axis.
        naming: names of the joints.
        neutral: time at which the person is straight [s], a recording in which the person is
            straight, or ``"vertical"``.
        window: first and last time [s].
        completed: whether lost markers have been estimated already.
    """

    body: Body | None = None
    shapes: Mapping[str, Marker] = field(default_factory=dict)
    subject: str | None = None
    thing: str | None = None
    unit: float | None = None
    up: str | None = None
    naming: Naming | None = None
    neutral: float | str | JointMotion | None = None
    window: tuple[float, float] | None = None
    completed: bool = False


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
