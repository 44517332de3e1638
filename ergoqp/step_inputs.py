"""What goes into a step and comes out of it, by name; and the judgement of every input before anything is computed."""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, Final

import casadi as ca
import numpy as np

from ergoqp.rest import STATES
from ergoqp.rigid import is_rigid

if TYPE_CHECKING:
    from ergoqp.problem import Problem


class Status(IntEnum):
    """What a step did; the order is the order of precedence."""

    optimal = 0
    settled = 1
    relaxed = 2
    recovering = 3
    braking = 4
    invalid = 5


class Cause(IntEnum):
    """Why a step did not use its inputs or its answer; bits of the function's output ``causes``."""

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


INPUTS: Final = (
    *("posture", "observed", "pose", "has_pose", "stored_pose", "started", "executed", "sent", "dt", "age"),
    *("frame", "enable", "rest"),
)

OUTPUTS: Final = (
    *("twist", "pose_used", "next_pose", "posture_rate", "next_rest", "status", "causes", "cost", "gain", "margins"),
    *("slack", "multipliers", "locked", "outside", "residuals"),
)


def input_sizes(problem: Problem) -> dict[str, tuple[int, int]]:
    """Return the shape of every input of the step."""
    n = len(problem.coordinates)
    sizes = {"posture": (n, 1), "observed": (n, 1), "pose": (4, 4), "stored_pose": (4, 4), "executed": (6, 1), "sent": (6, 1)}
    return {name: (1, 1) for name in INPUTS} | sizes | {"rest": (STATES, 1)}


def checked(problem: Problem) -> ca.Function:
    """Judge every input; replace what cannot be used by what was known before, so that no NaN goes further.

    Returns:
        Function of `INPUTS` that gives (posture, pose, previous twist, dt, whether all of it can be used, causes).
    """
    n = len(problem.coordinates)
    raw = {name: ca.MX.sym(name, *size) for name, size in input_sizes(problem).items()}
    seen = raw["observed"] > 0.5
    plausible = ca.fabs(raw["posture"]) <= problem.response.largest
    usable = ca.logic_and(seen, plausible)
    known = ca.if_else(usable, raw["posture"], ca.DM(stand_in(problem)))
    # Every entry is unseen or plausible.
    posture_ok = ca.sum1(usable - seen) > -0.5
    judged = _judged(problem)
    pose, unanchored, previous, dt, fine, causes = judged(posture_ok, *(raw[name] for name in judged.name_in()[1:]))

    # Only the first step without a measured pose asks where the contact is by the posture.
    q, held = ca.MX.sym("q", n), ca.MX.sym("pose", 4, 4)
    by_posture = ca.Function("by_posture", [q, held], [problem.response.contact()(q)[0]])
    as_known = ca.Function("as_known", [q, held], [held])
    pose = ca.Function.if_else("anchor", by_posture, as_known)(unanchored, known, pose)
    return ca.Function("checked", list(raw.values()), [known, ca.densify(pose), previous, dt, fine, causes])


def _judged(problem: Problem) -> ca.Function:
    """All inputs but the posture: (pose, whether it has to come from the posture, previous, dt, usable, causes)."""
    sizes = {"posture_ok": (1, 1)} | input_sizes(problem)
    for array in ("posture", "observed", "rest"):
        sizes.pop(array)
    raw = {name: ca.SX.sym(name, *size) for name, size in sizes.items()}
    pose_ok = is_rigid(raw["pose"])
    twist_ok = ca.sumsqr(raw["executed"]) < 1e4
    dt_ok = ca.logic_and(raw["dt"] >= 1e-5, raw["dt"] <= 0.5)
    age_ok = raw["age"] >= 0
    fresh = raw["age"] <= problem.control.max_age
    given = ca.logic_and(raw["has_pose"] > 0.5, pose_ok)
    pose = ca.if_else(given, raw["pose"], raw["stored_pose"])
    unanchored = ca.logic_not(ca.logic_or(given, raw["started"] > 0.5))
    bad = {
        Cause.posture: ca.logic_and(ca.logic_not(raw["posture_ok"]), raw["frame"] > 0.5),
        Cause.pose: ca.logic_and(raw["has_pose"] > 0.5, ca.logic_not(pose_ok)),
        Cause.twist: ca.logic_not(twist_ok),
        Cause.dt: ca.logic_not(dt_ok),
        Cause.age: ca.logic_not(age_ok),
        Cause.disabled: raw["enable"] < 0.5,
        Cause.no_frame: raw["frame"] < 0.5,
        Cause.too_old: ca.logic_and(age_ok, ca.logic_not(fresh)),
    }
    causes = sum((2.0**cause * flag for cause, flag in bad.items()), ca.SX(0))
    previous, dt = ca.if_else(twist_ok, raw["executed"], raw["sent"]), ca.if_else(dt_ok, raw["dt"], problem.dt)
    outputs = [ca.densify(pose), unanchored, previous, dt, causes < 0.5, causes]
    return ca.Function("judged", list(raw.values()), outputs, list(raw), [f"{name}_out" for name in _JUDGED])


_JUDGED: Final = ("pose", "unanchored", "previous", "dt", "usable", "causes")


def stand_in(problem: Problem) -> np.ndarray:
    """Posture that stands in for joints that are not seen: the comfort posture, where the response has one."""
    return np.asarray(getattr(problem.response, "comfort", np.zeros(len(problem.coordinates))), dtype=float)
