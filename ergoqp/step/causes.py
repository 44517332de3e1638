"""Status and causes of a step, and the faults of a robot: as numbers, and in sentences."""

from __future__ import annotations

from enum import IntEnum
from typing import Final

import casadi as ca
import numpy as np


class Status(IntEnum):
    """Status of a step; the order is the order of precedence.

    Example:
        >>> from ergoqp.step.causes import Status
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


_SAME: Final = 0.005
"""A factor this close to 1 counts as 1."""

_ON_TIME: Final = 1e-3
"""A lateness of less than this is none [s]."""

_CLOSE: Final = 0.2
"""A factor this close to 1 is said to a hundredth, others to a tenth."""

_ROUNDED_FROM: Final = 20.0
"""From here on a lateness is said in tens [ms]."""


class Fault(IntEnum):
    """How the robot differs from its declaration.

    The amount beside it is a factor, or has the unit of `FAULT_UNITS`.
    """

    none = 0
    stands_still = 1
    factor = 2
    another_axis = 3
    late = 4
    unasked = 5
    pose_jumps = 6
    pose_turns = 7
    speed_jumps = 8
    position_scatters = 9
    orientation_scatters = 10


FAULT_UNITS: Final = {
    Fault.late: "s",
    Fault.pose_jumps: "m",
    Fault.pose_turns: "rad",
    Fault.speed_jumps: "m/s, rad/s",
    Fault.position_scatters: "m",
    Fault.orientation_scatters: "rad",
}
"""Units of the amounts; those of other faults are a factor, or 0."""


def fault_of(fit: ca.SX, Y: ca.SX, y: ca.SX) -> ca.SX:
    """Return the `Fault` and its amount (2,) that fits best to recent motion: y = g Y - late s."""
    YY, Ys, ss, Yy, sy = ca.vertsplit(fit)
    det = YY * ss - Ys**2
    sound = det > 1e-6 * YY * ss
    share = Yy / ca.fmax(YY, 1e-18)
    gain = ca.if_else(sound, (Yy * ss - sy * Ys) / ca.if_else(sound, det, 1), share)
    late = ca.if_else(sound, -(YY * sy - Ys * Yy) / ca.if_else(sound, det, 1), 0)
    along = ca.dot(y, Y) / ca.fmax(ca.dot(Y, Y), 1e-18)
    aside = ca.norm_2(y - along * Y) > 0.5 * ca.norm_2(Y)
    is_late = ca.logic_and(late > _ON_TIME, late * ca.sqrt(ss) > ca.fabs(gain - 1) * ca.sqrt(YY))
    still = ca.fabs(gain) < 0.15
    other = ca.if_else(
        still, ca.vertcat(int(Fault.stands_still), 0), ca.vertcat(int(Fault.factor), gain)
    )
    other = ca.if_else(is_late, ca.vertcat(int(Fault.late), late), other)
    other = ca.if_else(aside, ca.vertcat(int(Fault.another_axis), 0), other)
    return ca.if_else(ca.dot(y, y) >= YY / 1e-6, ca.vertcat(int(Fault.unasked), 0), other)


def fault_sentence(kind: int, amount: float) -> str:
    """Return the sentence of a fault.

    Amounts are rounded, so that the sentence is the same each time the robot does the same.
    """
    late = 1e3 * amount
    late = round(late, -1) if late >= _ROUNDED_FROM else late
    factor = f"{amount:.2f}" if abs(amount - 1) < _CLOSE else f"{amount:.1f}"
    if kind == Fault.factor and abs(amount - 1) < _SAME:
        return "robot: drifts from what was sent"
    if kind == Fault.factor and amount < 0:
        return f"robot: moves backward, {-amount:.1f} times what was sent"
    noise = _rounded_up(np.degrees(amount) if kind == Fault.orientation_scatters else amount)
    return {
        Fault.stands_still: "robot: stands still",
        Fault.factor: f"robot: moves {factor} times what was sent{_entry('gain_error')}",
        Fault.another_axis: "robot: moves along another axis",
        Fault.unasked: "robot: moves although nothing was sent",
        Fault.late: f"robot: late by {late:.0f} ms{_entry('delay, lag')}",
        Fault.pose_jumps: f"robot: pose jumps by {1e3 * amount:.3g} mm",
        Fault.pose_turns: f"robot: pose jumps by {np.degrees(amount):.3g} deg",
        Fault.speed_jumps: "robot: speed jumps",
        Fault.position_scatters: (
            f"robot: the measured position scatters by {1e3 * noise:g} mm at rest"
            f"{_entry(f'pose_noise = {noise:g}')}"
        ),
        Fault.orientation_scatters: (
            f"robot: the measured orientation scatters by {noise:g} deg at rest"
            f"{_entry(f'pose_noise_deg = {noise:g}')}"
        ),
    }.get(Fault(kind), "")


def _entry(name: str) -> str:
    return f" (if it always does, declare [robot] {name})"


def _rounded_up(amount: float) -> float:
    """Return the next of 1, 2, 5, 10, 20, ... times a power of ten, so that a sentence stays."""
    if not 0 < amount < np.inf:
        return 0.0
    power = 10.0 ** np.floor(np.log10(amount))
    step = next(step for step in (1, 2, 5, 10) if step * power >= amount * (1 - 1e-9))
    return float(f"{step * power:.1g}")
