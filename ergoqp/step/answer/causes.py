"""Status and causes of a step, as the numbers that the step's function gives."""

from __future__ import annotations

from enum import IntEnum


class Status(IntEnum):
    """Status of a step; the order is the order of precedence.

    Example:
        >>> from ergoqp.step.answer.causes import Status
        >>> [status.name for status in Status]
        ['optimal', 'settled', 'relaxed', 'recovering', 'braking', 'invalid']
    """

    optimal = 0
    settled = 1
    relaxed = 2
    recovering = 3
    braking = 4
    invalid = 5


class Cause(IntEnum):
    """Why a step did not use its inputs or its answer: bits of the output ``causes``."""

    posture = 0
    pose = 1
    twist = 2
    dt = 3
    age = 4
    disabled = 5
    no_frame = 6
    too_old = 7
    not_solved = 8
    not_certified = 9
    robot = 10
    unmeasured = 11
    halted = 12
    asked = 13
    long_period = 14
    short_periods = 15
    latched = 16
    no_way_out = 17
    term = 18
    frames = 19
