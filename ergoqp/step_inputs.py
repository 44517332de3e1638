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
    """Judge every input; replace what cannot be used by what was known before, so that no NaN goes further."""
    raw = {name: ca.SX.sym(name, *size) for name, size in input_sizes(problem).items()}
    seen = raw["observed"] > 0.5
    plausible = ca.fabs(raw["posture"]) <= problem.response.largest
    posture_ok = ca.sum1(ca.if_else(seen, plausible, 1)) >= len(problem.coordinates) - 0.5
    pose_ok = is_rigid(raw["pose"])
    twist_ok = ca.sumsqr(raw["executed"]) < 1e4
    dt_ok = ca.logic_and(raw["dt"] >= 1e-5, raw["dt"] <= 0.5)
    age_ok = raw["age"] >= 0
    fresh = raw["age"] <= problem.control.max_age

    comfort = ca.SX(ca.DM(stand_in(problem)))
    known = ca.if_else(ca.logic_and(seen, plausible), raw["posture"], comfort)
    from_posture = problem.response.contact()(known)[0]
    given = ca.logic_and(raw["has_pose"] > 0.5, pose_ok)
    stored = ca.if_else(raw["started"] > 0.5, raw["stored_pose"], from_posture)
    pose = ca.if_else(given, raw["pose"], stored)
    previous = ca.if_else(twist_ok, raw["executed"], raw["sent"])
    dt = ca.if_else(dt_ok, raw["dt"], problem.dt)

    bad = {
        Cause.posture: ca.logic_and(ca.logic_not(posture_ok), raw["frame"] > 0.5),
        Cause.pose: ca.logic_and(raw["has_pose"] > 0.5, ca.logic_not(pose_ok)),
        Cause.twist: ca.logic_not(twist_ok),
        Cause.dt: ca.logic_not(dt_ok),
        Cause.age: ca.logic_not(age_ok),
        Cause.disabled: raw["enable"] < 0.5,
        Cause.no_frame: raw["frame"] < 0.5,
        Cause.too_old: ca.logic_and(age_ok, ca.logic_not(fresh)),
    }
    causes = sum((2.0**cause * flag for cause, flag in bad.items()), ca.SX(0))
    return ca.Function("checked", list(raw.values()), [known, ca.densify(pose), previous, dt, causes < 0.5, causes])


def stand_in(problem: Problem) -> np.ndarray:
    """Posture that stands in for joints that are not seen: the comfort posture, where the response has one."""
    return np.asarray(getattr(problem.response, "comfort", np.zeros(len(problem.coordinates))), dtype=float)
