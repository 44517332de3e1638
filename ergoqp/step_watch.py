"""Whether the robot does what it was sent: measured motion against declared motion, and a name for what does not fit.

Measured and sent motion are compared since the object last stood still. What a declared robot may differ by is no fault: what it
has not done yet, its gain error, the noise of its pose. Each measured pose says between which ends the constant difference of
the two must lie, axis by axis; when the ends of two moments leave no room, by more than `UNIT`, something was done that was not
declared. A reported twist is compared by its integral; what scatters from sample to sample, up to half the speed limit, is noise.

After a fault, and after the object was not allowed to move, it comes to rest and starts again from rest only.
"""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, Any, Final

import casadi as ca
import numpy as np

from ergoqp.linear import dense, largest

if TYPE_CHECKING:
    from ergoqp.problem import Problem

UNIT: Final = np.repeat([0.001, np.radians(0.2)], 3)
"""Difference of measured and declared motion that is none yet, per axis (6,) [m, rad]."""

CALM: Final = 0.5
"""For how long the object stands still after a fault, beside the time that the robot is declared to be late [s]."""

_MEMORY: Final = 0.3
"""How far back the motion is looked at to name a fault [s]."""

_CERTAIN: Final = 6.0
"""Noise of a reported twist counts as none up to so many standard deviations of its sum."""


class Fault(IntEnum):
    """What the robot does other than declared; the amount beside it is a factor, seconds, metres or radians."""

    none = 0
    stands_still = 1
    factor = 2
    another_axis = 3
    late = 4
    pose_jumps = 5
    pose_turns = 6
    speed_jumps = 7


WATCH: Final = {
    "apart": (6, 1),  # measured motion less sent motion, by the pose
    "least": (6, 1),  # ends of their constant difference
    "most": (6, 1),
    "drift": (6, 1),  # the same by the reported twist, its variance, and the last sample
    "blur": (6, 1),
    "surprise": (6, 1),
    "path": (2, 1),  # how far it went, and turned, since it stood still
    "moved": (6, 3),  # of late: sent motion, measured motion, change of the sent twist
    "fit": (5, 1),  # sums of their products
    "last": (6, 1),  # the sent twist before the last one
    "fault": (2, 1),  # a `Fault` and its amount
    "calm": (1, 1),  # for how long the object has stood still
    "halted": (1, 1),  # 1 until it has come to rest
}
"""Parts of the state that watch the robot; all zero at the start."""


def watch_function(problem: Problem) -> ca.Function:
    """Return what the watch makes of the last period.

    The function takes `WATCH` and ``pose``, ``stored`` (4, 4) each, ``started``, ``measured``, ``told`` (0 or 1), ``executed``,
    ``sent`` (6,), ``lasted`` [s], ``slowest``, ``fastest`` (6,): twists that a robot does which does no more than it was sent, ``up``,
    ``down`` (6,): what the declared robot may still owe, ``parked`` (0 or 1), ``stop`` (1: the object may not move now), ``dt``. It gives `WATCH` and whether there is a fault.
    """
    robot = problem.robot
    sizes = {"pose": (4, 4), "stored": (4, 4), "executed": (6, 1), "sent": (6, 1), "up": (6, 1), "down": (6, 1)}
    sizes |= {"slowest": (6, 1), "fastest": (6, 1)}
    one = ("started", "measured", "told", "lasted", "parked", "stop", "dt")
    was = {name: ca.SX.sym(name, *size) for name, size in WATCH.items()}
    now = {name: ca.SX.sym(name, *size) for name, size in (sizes | dict.fromkeys(one, (1, 1))).items()}
    started, measured, told, parked = (now[name] > 0.5 for name in ("started", "measured", "told", "parked"))
    sent, lasted = now["sent"], ca.if_else(started, now["lasted"], 0)
    unit, noise = ca.DM(UNIT), ca.DM(robot.noise)
    done = sent * lasted
    went = ca.if_else(started, _difference(now["stored"], now["pose"]), 0)
    # Beyond what it can have done in this period, whatever it still owed.
    leap = ca.fmax(went - now["fastest"] * lasted, 0) + ca.fmin(went - now["slowest"] * lasted, 0)
    held = _held(leap, sent, robot.longest_hold)
    beside, leap = went - done - held, leap - held
    surprise = ca.if_else(told, now["executed"] - sent, 0)

    lengths = ca.vertcat(ca.norm_2(done[:3]), ca.norm_2(done[3:]))
    spread = robot.gain_error * ca.vertcat(*[lengths[0]] * 3, *[lengths[1]] * 3)
    stretch = 1 + robot.gain_error
    up, down = stretch * now["up"], stretch * now["down"]
    apart = ca.if_else(parked, 0, was["apart"] + beside)
    low, high = apart - down - noise, apart + up + noise
    least = ca.if_else(parked, low, ca.if_else(measured, ca.fmax(was["least"] - spread, low), was["least"] - spread))
    most = ca.if_else(parked, high, ca.if_else(measured, ca.fmin(was["most"] + spread, high), was["most"] + spread))
    by_pose = largest((least - most) / unit)

    # Noise scatters around what was sent, what is wrong goes on: so only the change from sample to sample counts as noise.
    credible = ca.DM(0.5 * np.repeat([problem.twist_limit.linear_speed, problem.twist_limit.angular_speed], 3))
    scatter = ca.fmin(ca.fabs(surprise - was["surprise"]), credible) * lasted
    drift, blur, path = (ca.if_else(parked, 0, was[name]) for name in ("drift", "blur", "path"))
    drift, blur, path = drift + surprise * lasted, blur + scatter**2 / 2, path + lengths
    way = robot.gain_error * ca.vertcat(*[path[0]] * 3, *[path[1]] * 3)
    # A twist may be reported as it is at the end of the period, and not as its mean.
    slack = _CERTAIN * ca.sqrt(blur) + way + problem.dt * ca.fabs(sent)
    by_twist = ca.if_else(told, largest((ca.fmax(drift - down, -drift - up) - slack) / unit), 0)

    jump = ca.fabs(leap) / unit
    jumps = ca.logic_and(ca.logic_and(measured, started), largest(jump - 2 * noise / unit) > 1)
    strikes = ca.logic_and(told, largest((ca.fabs(surprise) * lasted - slack) / unit) > 1)
    found = ca.logic_or(ca.logic_or(ca.logic_and(measured, by_pose > 1), by_twist > 1), ca.logic_or(jumps, strikes))

    forget = ca.fmax(0, 1 - lasted / _MEMORY)
    seen = ca.if_else(measured, went, done + surprise * lasted)
    news = ca.horzcat(done, seen, sent - was["last"])
    moved = forget * was["moved"] + news
    weighted = moved / ca.repmat(ca.DM(UNIT / UNIT[0]), 1, 3)
    Y, y, s = ca.horzsplit(weighted)
    products = ca.vertcat(ca.dot(Y, Y), ca.dot(Y, s), ca.dot(s, s), ca.dot(Y, y), ca.dot(s, y))
    fit = forget * was["fit"] + products
    known = ca.logic_or(found, was["fault"][0] > 0.5)
    by_size = _name(fit, Y, y)
    shifts, turns = (ca.vertcat(int(kind), ca.norm_2(part)) for kind, part in _halves(leap))
    shift = ca.if_else(largest(jump[:3]) >= largest(jump[3:]), shifts, turns)
    sudden = was["fault"][0] >= int(Fault.pose_jumps)
    fault = ca.if_else(sudden, was["fault"], by_size)
    fault = ca.if_else(jumps, shift, ca.if_else(strikes, ca.vertcat(int(Fault.speed_jumps), ca.norm_2(surprise)), fault))
    calm = ca.if_else(parked, was["calm"] + now["dt"], 0)
    waits = CALM + robot.dead_time + 3 * robot.lag
    over = ca.logic_and(ca.logic_not(found), calm >= waits)
    fault = ca.if_else(ca.logic_and(known, ca.logic_not(over)), fault, 0)
    faulty = fault[0] > 0.5
    halted = ca.logic_or(ca.logic_or(faulty, now["stop"] > 0.5), ca.logic_and(was["halted"] > 0.5, ca.logic_not(parked)))
    after = (apart, least, most, drift, blur, surprise, path, moved, fit, sent, fault, calm, halted)
    outputs = dense([*after, faulty])
    inputs = {**was, **now}
    return ca.Function(
        "watch", list(inputs.values()), ca.cse(outputs), list(inputs), [*(f"next_{name}" for name in WATCH), "faulty"]
    )


def _difference(before: ca.SX, after: ca.SX) -> ca.SX:
    """Displacement (6,) along the world's axes that leads from one pose to another."""
    turned = after[:3, :3] @ before[:3, :3].T
    sines = ca.vertcat(turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]) / 2
    cosine = (ca.trace(turned) - 1) / 2
    # Half a turn has no sine; it is large all the same.
    over = ca.if_else(cosine < 0, 1.0, 0.0)
    return ca.vertcat(after[:3, 3] - before[:3, 3], sines[0] + ca.if_else(sines[0] < 0, -over, over), sines[1:])


def _held(leap: ca.SX, sent: ca.SX, hold: float) -> ca.SX:
    """How much of a leap (6,) one declared hold of the last twist explains."""
    if not hold:
        return ca.SX(6, 1)
    explained = ca.fmax(ca.fmin(leap, ca.fmax(0, hold * sent)), ca.fmin(0, hold * sent))
    return ca.if_else(largest(ca.fabs(leap) / ca.DM(UNIT)) > 1, explained, 0)


def _halves(leap: ca.SX) -> tuple[tuple[Fault, ca.SX], tuple[Fault, ca.SX]]:
    return (Fault.pose_jumps, leap[:3]), (Fault.pose_turns, leap[3:])


def _name(fit: ca.SX, Y: ca.SX, y: ca.SX) -> ca.SX:
    """The `Fault` and its amount (2,) that fits best to what moved of late: y = g Y - late s."""
    YY, Ys, ss, Yy, sy = ca.vertsplit(fit)
    det = YY * ss - Ys**2
    sound = det > 1e-6 * YY * ss
    share = Yy / ca.fmax(YY, 1e-18)
    gain = ca.if_else(sound, (Yy * ss - sy * Ys) / ca.if_else(sound, det, 1), share)
    late = ca.if_else(sound, -(YY * sy - Ys * Yy) / ca.if_else(sound, det, 1), 0)
    along = ca.dot(y, Y) / ca.fmax(ca.dot(Y, Y), 1e-18)
    aside = ca.norm_2(y - along * Y) > 0.5 * ca.norm_2(Y)
    is_late = ca.logic_and(late > 0, late * ca.sqrt(ss) > ca.fabs(gain - 1) * ca.sqrt(YY))
    other = ca.if_else(gain < 0.15, ca.vertcat(int(Fault.stands_still), 0), ca.vertcat(int(Fault.factor), gain))
    other = ca.if_else(is_late, ca.vertcat(int(Fault.late), late), other)
    return ca.if_else(aside, ca.vertcat(int(Fault.another_axis), 0), other)


def fault_sentence(kind: int, amount: float) -> str:
    """Return what is said of a fault."""
    return {
        Fault.stands_still: "robot: stands still",
        Fault.factor: f"robot: moves {amount:.2g} times what was sent",
        Fault.another_axis: "robot: moves along another axis",
        Fault.late: f"robot: late by {1e3 * amount:.0f} ms",
        Fault.pose_jumps: f"robot: pose jumps by {1e3 * amount:.3g} mm",
        Fault.pose_turns: f"robot: pose jumps by {np.degrees(amount):.3g} deg",
        Fault.speed_jumps: "robot: speed jumps",
    }.get(Fault(kind), "")


def parked(planned: Any, sent: Any) -> Any:
    """Return whether nothing is planned and nothing was sent for as long as the history reaches."""
    return ca.sumsqr(planned) + ca.sumsqr(sent) <= 0
