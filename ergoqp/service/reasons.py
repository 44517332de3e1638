"""Why a step is as it is, as one number, and the table of what the numbers mean."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from ergoqp.step.answer import Step
from ergoqp.step.causes import Cause, Fault, Status

CAUSE, FAULT, OUTSIDE, GIVES_WAY, DRAWN, SETTLED = (kind << 16 for kind in range(1, 7))
"""Kinds of reasons; the cause, fault, row or phase is added."""

_CAUSES: Final = {
    Cause.posture: "the posture is not usable",
    Cause.pose: "the pose is not finite, over 100 m away or not a rigid motion",
    Cause.twist: "the measured twist is not finite or huge",
    Cause.dt: "dt is out of range",
    Cause.age: "the age is out of range",
    Cause.disabled: "not enabled, or on hold",
    Cause.no_frame: "no posture arrived",
    Cause.too_old: "the posture is too old",
    Cause.not_solved: "the QP was not solved",
    Cause.not_certified: "no twist but braking keeps every limit",
    Cause.robot: "the robot deviates from its declaration",
    Cause.unmeasured: "no pose, and the robot is declared to move otherwise than it is sent",
    Cause.halted: "comes to rest before it moves again",
    Cause.asked: "braking was asked for",
    Cause.long_period: "dt is longer than is certified",
    Cause.short_periods: "the last periods were much shorter than the loop's",
    Cause.latched: "at rest after a fault of the robot, until a pose is measured or try again",
    Cause.no_way_out: "the object is outside, and no straight way leads back",
    Cause.term: "a term of the problem gives no number",
    Cause.frames: "pose and posture are further apart than any honest person",
}

_FAULTS: Final = {
    Fault.stands_still: "the robot stands still",
    Fault.factor: "the robot moves by another factor than it is sent",
    Fault.another_axis: "the robot moves along another axis",
    Fault.late: "the robot is late",
    Fault.unasked: "the robot moves although nothing was sent",
    Fault.pose_jumps: "the measured position jumps",
    Fault.pose_turns: "the measured orientation jumps",
    Fault.speed_jumps: "the measured speed jumps",
    Fault.position_scatters: "the measured position scatters at rest",
    Fault.orientation_scatters: "the measured orientation scatters at rest",
}

_PHASES: Final = {
    1: "drawn toward the given place",
    2: "at the given place, waiting for the person",
    4: "drawn back to where it was better than at the given place",
}


def reason_code(step: Step, status: Status, causes: int) -> int:
    """Return the number of a step's main reason; 0 for a plain optimal step."""
    if status >= Status.braking:
        if causes >> Cause.robot & 1 and (fault := int(step.account("fault")[0])):
            return FAULT + fault
        return CAUSE + (causes & -causes).bit_length() - 1 if causes else 0
    if status == Status.recovering:
        return OUTSIDE + int(np.argmax(step.account("outside")))
    if status == Status.relaxed:
        return GIVES_WAY + int(np.argmax(step.account("slack")))
    if step.drawn:
        return DRAWN + step.drawn
    return SETTLED if status == Status.settled else 0


def reason_table(rows: Sequence[str]) -> dict[int, str]:
    """Return what each number means for a problem with these rows."""
    return {
        0: "",
        **{CAUSE + cause: text for cause, text in _CAUSES.items()},
        **{FAULT + fault: text for fault, text in _FAULTS.items()},
        **{OUTSIDE + i: f"outside, coming back: {name}" for i, name in enumerate(rows)},
        **{GIVES_WAY + i: f"gives way: {name}" for i, name in enumerate(rows)},
        **{DRAWN + phase: text for phase, text in _PHASES.items()},
        SETTLED: "at rest: moving would gain too little",
    }
