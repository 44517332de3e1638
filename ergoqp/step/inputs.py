"""Inputs and outputs of a step by name, and the check of every input.

Inputs are checked before anything is computed.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import casadi as ca

from ergoqp.arguments import of_package
from ergoqp.expressions.linear import Shape, by_name, dense, is_set
from ergoqp.expressions.rigid import exp_rotation, is_rigid, normalised
from ergoqp.step.answer.causes import Cause
from ergoqp.step.frames_check import BEYOND, FRAMES
from ergoqp.step.model import StepModel
from ergoqp.step.packing import split
from ergoqp.step.under_way.history import CLOCK_ROUNDING
from ergoqp.step.under_way.motion import UnderWay

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
    "frames",
    "cost",
    "gain",
    "margins",
    "slack",
    "multipliers",
    "locked",
    "outside",
    "residuals",
    "astray",
    "amiss",
)


def read_inputs(
    model: StepModel, given: Mapping[str, ca.MX], found: UnderWay, shape: Shape
) -> dict[str, ca.MX]:
    """Check every input, and replace unusable ones by what was known before.

    So no NaN goes further.

    Args:
        model: model of the step.
        given: `INPUTS` as they came, and the parts of the state.
        found: the motion under way.
        shape: how functions are written, see `ergoqp.expressions.linear`.

    Returns:
        The usable numbers for the step: ``posture``; ``pose`` as measured, or as far as it is
        known; ``previous``, the twist that was planned last; ``dt``; whether a pose was
        ``measured``; whether a pose is known from now on (``next_started``); whether a twist is
        ``told``; whether posture and pose can be compared (``compares``); whether the object has to
        ``stop``; ``causes`` why the step can only brake, by `Cause`; and everything else that was
        given.
    """
    seen = is_set(given["observed"])
    last = ca.if_else(is_set(given["frame"]), given["posture"], given["last_posture"])
    usable = ca.logic_and(seen, ca.fabs(last) <= model.problem.response.largest)
    posture = ca.if_else(usable, last, model.stand_in)
    # Every entry is unseen or plausible.
    posture_ok = ca.sum1(usable - seen) > -0.5
    known = {**given, **found.parts, "period": found.dt, "posture_ok": posture_ok}
    read = by_name(shape(_read_function(model)), known, written=True)
    pose = _pose(model, given, read["measured"], read["moved"], posture)
    known |= read | {"posture": posture, "pose": pose}
    if not of_package(model.problem.response):
        # Without a usable contact frame the pose stays unknown, see `_pose`.
        placed = pose[3, 3]
        known["next_started"] *= placed
        known["causes"] += 2.0**Cause.term * (1 - placed)
    if model.problem.robot.owes:
        # When the object was measured last, any share of the motion under way may have been done
        # already. It is integrated as if none was.
        known["doubt"] = ca.if_else(read["measured"], 0, given["unsure"])
    return known


_READ: Final = ("pose", "has_pose", "executed", "has_twist", "age", "frame", "enable", "ask")
_KEPT: Final = (
    "sent",
    "changed",
    "started",
    "lasted",
    "period",
    "dt_ok",
    "posture_ok",
    "fits",
    "on_hold",
)


def _read_function(model: StepModel) -> ca.Function:
    """Check all inputs except the posture.

    Returns:
        Function that gives ``moved``, the displacement of the last period as far as it is known,
        and the other results of `read_inputs`.
    """
    problem = model.problem
    raw = model.symbols((*_READ, *_KEPT, *(("frames",) if model.compares else ())))
    has_pose, has_twist, started, frame = (
        is_set(raw[name]) for name in ("has_pose", "has_twist", "started", "frame")
    )
    pose_ok, twist_ok = is_rigid(raw["pose"]), ca.sumsqr(raw["executed"]) < 1e4
    age_ok, fresh = raw["age"] >= -CLOCK_ROUNDING, raw["age"] <= problem.control.max_age
    measured, told = ca.logic_and(has_pose, pose_ok), ca.logic_and(has_twist, twist_ok)

    # What was sent is integrated, and never the noisy report: see `ergoqp.step.robot_watch.watch`.
    moved = raw["sent"] * raw["lasted"] + raw["changed"]
    anchors = ca.logic_or(measured, ca.logic_and(frame, raw["posture_ok"]))
    unmeasured = ca.logic_and(problem.robot.needs_pose, ca.logic_not(measured))
    disabled = ca.logic_or(ca.logic_not(is_set(raw["enable"])), is_set(raw["on_hold"]))
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
    if model.compares:
        bad[Cause.frames] = split(FRAMES, raw["frames"])["beyond"] >= BEYOND
    causes = sum((2.0**cause * flag for cause, flag in bad.items()), ca.SX(0))
    outputs = {
        "moved": moved,
        "next_started": ca.logic_or(started, anchors),
        "measured": measured,
        "told": told,
        "stop": ca.logic_or(disabled, unmeasured),
        "causes": causes,
    }
    if model.compares:
        sees = ca.logic_and(ca.logic_and(frame, raw["posture_ok"]), fresh)
        waited = split(FRAMES, raw["frames"])["wait"] <= 1e-9
        outputs["compares"] = ca.logic_and(ca.logic_and(measured, sees), waited)
    parts = ca.cse(dense(list(outputs.values())))
    return ca.Function("read", list(raw.values()), parts, list(raw), list(outputs))


def _pose(
    model: StepModel,
    given: Mapping[str, ca.MX],
    measured: ca.MX,
    moved: ca.MX,
    posture: ca.MX,
) -> ca.MX:
    """Return the measured pose, or the last one moved on.

    At the first step it is the contact frame of the posture.
    """
    sx = ca.SX.sym("stored", 4, 4), ca.SX.sym("moved", 6)
    on = ca.Function("moved_on", sx, [exp_rotation(*sx)])
    inputs = [
        ca.MX.sym("pose", 4, 4),
        ca.MX.sym("started"),
        ca.MX.sym("stored", 4, 4),
        ca.MX.sym("moved", 6),
    ]
    inputs.append(ca.MX.sym("posture", posture.numel()))
    first = model.response.contact()(inputs[4])[0]
    if not of_package(model.problem.response):
        # A matrix of zeros stands for a pose that is not usable.
        rigid = ca.Function("rigid", [sx[0]], [is_rigid(sx[0])])(first)
        first = ca.if_else(rigid, first, 0)
    by_posture = ca.Function("by_posture", inputs, [ca.densify(first)])
    followed = ca.Function("followed", inputs, [ca.densify(on(inputs[2], inputs[3]))])
    integrated = ca.Function.if_else("integrated", followed, by_posture)(inputs[1], *inputs)
    unmeasured = ca.Function("unmeasured", inputs, [integrated])
    exact = ca.Function("exact", [sx[0]], [ca.densify(normalised(sx[0]))])
    as_measured = ca.Function("as_measured", inputs, [exact(inputs[0])])
    return ca.Function.if_else("pose_known", as_measured, unmeasured)(
        measured, given["pose"], given["started"], given["stored"], moved, posture
    )
