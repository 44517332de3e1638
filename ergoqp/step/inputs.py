"""What goes into a step and comes out of it, by name.

Every input is judged before anything is computed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.expressions.linear import Shape, dense, is_set
from ergoqp.expressions.rigid import exp_rotation, is_rigid, normalised
from ergoqp.problem.problem import Problem
from ergoqp.step.causes import Cause
from ergoqp.step.counted import way_of
from ergoqp.step.history import owes
from ergoqp.step.parts import count
from ergoqp.step.state import state_sizes
from ergoqp.step.story import watch_blocks
from ergoqp.step.watch import reckoned, watch
from ergoqp.step.way import UnderWay, under_way

INPUTS: Final = (
    "posture",
    "observed",
    "pose",
    "has_pose",
    "executed",
    "has_twist",
    "dt",
    "age",
    "frame",
    "enable",
    "ask",
    "state",
)

OUTPUTS: Final = (
    "twist",
    "pose_used",
    "next_state",
    "posture_rate",
    "status",
    "causes",
    "fault",
    "cost",
    "gain",
    "margins",
    "slack",
    "multipliers",
    "locked",
    "outside",
    "residuals",
)


def input_sizes(problem: Problem, guided: bool = False) -> dict[str, tuple[int, int]]:
    """Return the shape of every input of the step."""
    n = len(problem.coordinates)
    sizes = {
        "posture": (n, 1),
        "observed": (n, 1),
        "pose": (4, 4),
        "executed": (6, 1),
        "state": (count(state_sizes(problem, guided)), 1),
    }
    return {name: sizes.get(name, (1, 1)) for name in INPUTS}


@dataclass(frozen=True)
class Known:
    """What a step goes by, all of it usable numbers.

    Attributes:
        posture: (n,) [rad].
        pose: contact frame as measured, or as far as it is known (4, 4).
        landed: where it comes to rest if the planned twist were zero from now on (4, 4).
        previous: twist that was planned for the end of the last period (6,).
        dt: period [s].
        way: what is under way, as `ergoqp.step.counted.split_way` reads it.
        under_way: the same, in its parts.
        causes: why the step can only brake, by `Cause`; 0 if it can do more.
        started: 1 once a pose is known.
        watched: the blocks of `ergoqp.step.watch.watch_blocks`, and how unsure the pose is.
    """

    posture: ca.MX
    pose: ca.MX
    landed: ca.MX
    previous: ca.MX
    dt: ca.MX
    way: ca.MX
    under_way: UnderWay
    causes: ca.MX
    started: ca.MX
    watched: dict[str, ca.MX]


def known_of(
    problem: Problem, raw: Mapping[str, ca.MX], state: Mapping[str, ca.MX], shape: Shape
) -> Known:
    """Judge every input; replace what cannot be used by what was known before.

    So no NaN goes further.

    Args:
        problem: the task.
        raw: `INPUTS` as they came.
        state: the parts of the state, see `ergoqp.step.state`.
        shape: how functions are written, see `ergoqp.expressions.linear`.
    """
    seen = is_set(raw["observed"])
    usable = ca.logic_and(seen, ca.fabs(raw["posture"]) <= problem.response.largest)
    posture = ca.if_else(usable, raw["posture"], ca.DM(stand_in(problem)))
    # Every entry is unseen or plausible.
    posture_ok = ca.sum1(usable - seen) > -0.5

    found = under_way(problem, state["history"], raw["dt"], shape)
    given = {**state, **raw, **vars(found), "period": found.dt, "posture_ok": posture_ok}
    read = shape(_read_function(problem))
    moved, account, started, measured, told, stop, causes = read(
        *(given[name] for name in read.name_in())
    )
    pose = _pose(problem, measured, raw["pose"], state["started"], state["stored"], moved, posture)
    given |= {"pose": pose, "measured": measured, "told": told, "stop": stop}
    watched, causes = watch(problem, given | {"causes": causes}, shape)
    watched["account"] = account
    unsure = None
    if owes(problem):
        # Of what was under way when the object was seen last, any share may have been done already:
        # it is integrated as if none had.
        unsure = ca.if_else(measured, 0, state["unsure"])
        seen_now = ca.logic_or(measured, ca.logic_not(is_set(state["started"])))
        watched["unsure"] = ca.if_else(seen_now, ca.horzcat(found.up, found.down), state["unsure"])
    landed, way = way_of(problem, found, pose, unsure, shape)
    return Known(
        posture, pose, landed, found.previous, found.dt, way, found, causes, started, watched
    )


def _read_function(problem: Problem) -> ca.Function:
    """Judge all inputs but the posture.

    Returns:
        Function that gives the displacement of the last period as far as it is known and the next
        account of it (see `ergoqp.step.watch.reckoned`), whether a pose is known from now on,
        whether one was measured, whether a twist was reported, whether the object may not move, and
        the causes so far.
    """
    inputs = {
        name: size
        for name, size in input_sizes(problem).items()
        if name not in ("posture", "observed", "state")
    }
    own = dict.fromkeys(("sent", "changed"), (6, 1))
    own |= dict.fromkeys(
        ("started", "lasted", "period", "dt_ok", "posture_ok", "fits", "parked", "idled"), (1, 1)
    )
    own |= {name: (count(watch_blocks(problem)[name]), 1) for name in ("said", "account")}
    raw = {name: ca.SX.sym(name, *size) for name, size in (inputs | own).items()}
    has_pose, has_twist, started, frame = (
        is_set(raw[name]) for name in ("has_pose", "has_twist", "started", "frame")
    )
    pose_ok, twist_ok = is_rigid(raw["pose"]), ca.sumsqr(raw["executed"]) < 1e4
    age_ok, fresh = raw["age"] >= 0, raw["age"] <= problem.control.max_age
    measured, told = ca.logic_and(has_pose, pose_ok), ca.logic_and(has_twist, twist_ok)

    reported = {
        "executed": ca.if_else(told, raw["executed"], 0),
        "told": told,
        "measured": measured,
    }
    moved, account = reckoned(problem, raw | reported)
    anchors = ca.logic_or(measured, ca.logic_and(frame, raw["posture_ok"]))
    unmeasured = ca.logic_and(problem.robot.needs_pose, ca.logic_not(measured))
    disabled = ca.logic_not(is_set(raw["enable"]))
    bad = {
        Cause.posture: ca.logic_and(ca.logic_not(raw["posture_ok"]), frame),
        Cause.pose: ca.logic_and(has_pose, ca.logic_not(pose_ok)),
        Cause.twist: ca.logic_and(has_twist, ca.logic_not(twist_ok)),
        Cause.dt: ca.logic_not(raw["dt_ok"]),
        Cause.age: ca.logic_not(age_ok),
        Cause.disabled: disabled,
        Cause.no_frame: ca.logic_not(frame),
        Cause.too_old: ca.logic_and(age_ok, ca.logic_not(fresh)),
        Cause.unmeasured: unmeasured,
        Cause.asked: is_set(raw["ask"]),
        Cause.long_period: raw["period"] > problem.longest_period * (1 + 1e-9),
        Cause.short_periods: ca.logic_not(raw["fits"]),
    }
    causes = sum((2.0**cause * flag for cause, flag in bad.items()), ca.SX(0))
    outputs = [
        moved,
        account,
        ca.logic_or(started, anchors),
        measured,
        told,
        ca.logic_or(disabled, unmeasured),
        causes,
    ]
    return ca.Function(
        "read",
        list(raw.values()),
        ca.cse(dense(outputs)),
        list(raw),
        [f"out_{i}" for i in range(len(outputs))],
    )


def _pose(
    problem: Problem,
    measured: ca.MX,
    pose: ca.MX,
    started: ca.MX,
    stored: ca.MX,
    moved: ca.MX,
    posture: ca.MX,
) -> ca.MX:
    """The measured pose, else the last one moved on, or at the first step the posture's contact."""
    sx = ca.SX.sym("stored", 4, 4), ca.SX.sym("moved", 6)
    on = ca.Function("moved_on", sx, [exp_rotation(*sx)])
    inputs = [
        ca.MX.sym("pose", 4, 4),
        ca.MX.sym("started"),
        ca.MX.sym("stored", 4, 4),
        ca.MX.sym("moved", 6),
    ]
    inputs.append(ca.MX.sym("posture", posture.numel()))
    by_posture = ca.Function(
        "by_posture", inputs, [ca.densify(problem.response.contact()(inputs[4])[0])]
    )
    followed = ca.Function("followed", inputs, [ca.densify(on(inputs[2], inputs[3]))])
    integrated = ca.Function.if_else("integrated", followed, by_posture)(inputs[1], *inputs)
    unmeasured = ca.Function("unmeasured", inputs, [integrated])
    exact = ca.Function("exact", [sx[0]], [ca.densify(normalised(sx[0]))])
    as_measured = ca.Function("as_measured", inputs, [exact(inputs[0])])
    return ca.Function.if_else("pose_known", as_measured, unmeasured)(
        measured, pose, started, stored, moved, posture
    )


def stand_in(problem: Problem) -> np.ndarray:
    """Posture for joints that are not seen: the response's comfort posture, where it has one."""
    return np.asarray(
        getattr(problem.response, "comfort", np.zeros(len(problem.coordinates))), dtype=float
    )
