"""Comparison of the measured pose with where the posture has the contact: wrong frames are named.

A pose in millimetres, of another frame or along another axis moves the person somewhere else, and
no limit shows it. Posture and pose are compared every `PERIOD`. What is further apart than honest
people ever are, at `BEYOND` comparisons in a row, brakes (`Cause.frames`). What no error of angles
within `BIAS` and no stature within `STATURE` explains, at `DOUBTED` comparisons in a row, is only
said in the reason.

Frames do not change while people walk. So once posture and pose have agreed for `AGREED`
comparisons, only the wide bounds brake: the person may have stepped aside.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.expressions import call_by_name
from ergoqp.problem.problem import Problem
from ergoqp.step.constants import bounds
from ergoqp.step.model import StepModel

PERIOD: Final = 0.2
"""Time between two comparisons [s]."""

BEYOND: Final = 3
DOUBTED: Final = 4
AGREED: Final = 5
"""Numbers of comparisons."""

_WALKED: Final = (0.9, float(np.radians(90.0)))
"""The same after they have walked."""

BIAS: Final = float(np.radians(7.0))
"""Error of every angle that explains a difference [rad]."""

STATURE: Final = 0.16 / 1.75
"""Error of every length of the person that explains a difference, as a share."""

_UNIT: Final = 10.0
"""From this distance on the unit is wrong, as no robot reaches so far [m]."""

_NEAR: Final = (0.15, float(np.radians(20.0)))
"""A smaller difference is not looked into, which saves time."""

VERDICTS: Final = slice(1, 3)
"""What of it says that frames are wrong."""


def compared_frames(model: StepModel, signals: Mapping[str, ca.MX]) -> ca.MX:
    """Return the next `FRAMES`, as one vector.

    Args:
        model: model of the step, of a person.
        signals: ``posture``, ``observed`` (32,), ``pose`` (4, 4), ``frames``: the block before,
            ``period`` [s], and ``compares``: whether posture and pose can be compared now.
    """
    names = ("posture", "observed", "pose", "frames", "period")
    mx = model.symbols(names, ca.MX)
    posture, observed, pose, block, period = mx.pick(names).values()
    apart = _difference(pose, model.contact(mx, posture), mx["robot_offset"])
    explain = _explained(model)
    fine = ca.Function("near", explain.mx_in(), [ca.MX(ca.DM([1, 1]))])
    explained = ca.Function.if_else("explained", explain, fine)
    looks = ca.logic_or(ca.norm_2(apart[:3]) > _NEAR[0], ca.norm_2(apart[3:]) > _NEAR[1])
    known = [mx[name] for name in explain.name_in()[2:]]
    judge = _judged(model)
    reasons = explained(looks, posture, apart, *known)
    judged = call_by_name(judge, mx, apart=apart, explained=reasons)["judged"]
    # Joints that are not seen are as in comfort here, which shows nothing.
    needed = model.contact_joints
    seen = ca.mmin(observed[needed]) > 0.5 if needed else ca.MX(1)
    after = ca.if_else(seen, judged, block)
    compare = mx.function("compare", {"next_frames": ca.vertcat(PERIOD - period, after[1:])})
    wait = mx.function("wait", {"next_frames": ca.vertcat(block[0] - period, block[1:])})
    choose = ca.Function.if_else("compare_or_wait", compare, wait)
    return choose(signals["compares"], *(signals[name] for name in mx.inputs))


def frames_sentence(problem: Problem, parts: np.ndarray) -> str:
    """Return what is said of the last comparison; empty if nothing.

    Amounts are rounded, so that the sentence does not change with the noise.

    Args:
        problem: the task.
        parts: `FRAMES` (6,).
    """
    _, beyond, doubted, agreed, distance, angle = parts.tolist()
    if beyond < BEYOND and doubted < DOUBTED:
        return ""
    far = _WALKED if agreed >= AGREED and beyond >= BEYOND else bounds(problem)
    apart = f"{distance:.1f} m and {np.degrees(angle) // 10 * 10:.0f} deg"
    said = f"frames: the pose is about {apart} from where the posture has the contact frame"
    if beyond >= BEYOND:
        said += f", allowed {far[0]:.2g} m, {np.degrees(far[1]):.0f} deg or less of both"
    elif problem.frames.spread is None:
        said += ", more than angles 7 deg wrong and a stature 0.16 m wrong explain"
    else:
        said += ", more than at the rests of the calibration"
    if distance > _UNIT:
        return f"{said}: is it in m?"
    if distance / far[0] < angle / far[1]:
        return f"{said}: does x of the contact frame point along the tool?"
    return f"{said}: are base and flange right, and does the person stand at the world's origin?"


def _difference(pose: ca.MX, contact: ca.MX, offset: ca.MX) -> ca.MX:
    """Return how far a measured pose is from that by posture (6,), less what is calibrated.

    The first three entries are a distance [m]. The last three are the difference of the axes of the
    tool, of length 2 sin(angle / 2). The turn about the axis does not count: most grasps leave it
    free, and the wrist's errors add up in it.
    """
    sx = {"pose": ca.SX.sym("pose", 4, 4), "contact": ca.SX.sym("contact", 4, 4)}
    sx["offset"] = ca.SX.sym("offset", 3)
    shift = sx["pose"][:3, 3] - sx["contact"][:3, 3] - sx["offset"]
    axis = sx["pose"][:3, 0] - sx["contact"][:3, 0]
    function = ca.Function("apart", list(sx.values()), [ca.vertcat(shift, axis)])
    return function(pose, contact, offset)


def _explained(model: StepModel) -> ca.Function:
    """Return ``(posture, apart, ...) -> (2,)``: how far errors within the bounds reach, as a share.

    It is the largest change of the contact along the difference, over the difference; of the
    position and of the axis. Below 1 nothing explains the difference.
    """
    mx = model.symbols(("posture", "apart"), ca.MX)
    posture, apart = mx["posture"], mx["apart"]
    contact = model.contact(mx, posture)
    parts = []
    for place, part in ((contact[:3, 3], apart[:3]), (contact[:3, 0], apart[3:])):
        reach = BIAS * ca.norm_1(ca.jtimes(place, posture, part, True))
        if not parts:
            reach += STATURE * ca.fabs(ca.dot(place, part))
        parts.append(reach / ca.fmax(ca.sumsqr(part), 1e-12))
    return mx.function("looked_into", {"explained": ca.vertcat(*parts)})


def _judged(model: StepModel) -> ca.Function:
    """Return ``(frames, apart, explained) -> judged``, the next block."""
    sx = model.symbols(("frames", "apart", "explained"))
    block, apart, explained = sx["frames"], sx["apart"], sx["explained"]
    _, beyond, doubted, agreed, _, _ = ca.vertsplit(block)
    distance = ca.norm_2(apart[:3])
    angle = 2 * ca.asin(ca.fmin(ca.norm_2(apart[3:]) / 2, 1))
    far = ca.vertsplit(sx["robot_apart"])
    outside, walked = (
        (distance / most[0]) ** 2 + (angle / most[1]) ** 2 > 1 for most in (far, _WALKED)
    )
    trusted = agreed >= AGREED
    brakes = ca.if_else(trusted, walked, outside)
    unlikely = ca.logic_or(outside, ca.mmin(explained) < 1)

    def counted(before: ca.SX, more: ca.SX, enough: int) -> ca.SX:
        return ca.if_else(more, ca.fmin(before + 1, enough + 2), ca.fmax(before - 1, 0))

    agrees = ca.if_else(trusted, AGREED, ca.if_else(outside, 0, agreed + 1))
    after = ca.vertcat(
        0,
        counted(beyond, brakes, BEYOND),
        counted(doubted, unlikely, DOUBTED),
        agrees,
        distance,
        angle,
    )
    return sx.function("judged", {"judged": after})
