"""What a reported twist shows of a robot, and the name of its fault.

This runs only where a twist is reported or something is wrong.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.expressions.linear import dense, is_set, largest
from ergoqp.expressions.rigid import turned
from ergoqp.problem.problem import Problem
from ergoqp.step.model import StepModel
from ergoqp.step.packing import joined, split
from ergoqp.step.robot_watch.faults import Fault, fault_of
from ergoqp.step.robot_watch.memory import (
    NAMED,
    REPORTED,
    SAID,
    STORY,
    UNIT,
    leap_beyond,
    length,
)

_MEMORY: Final = 0.3
"""Time of motion from which a fault is named [s]."""

_AT_REST: Final = 5.0
"""After this time with a fault the motion before it is forgotten [s]."""

_FORGETS: Final = 0.5
"""Time over which a reported twist is summed while the object stands still [s].

So the readings of a sensor at rest do not add up.
"""

_CERTAIN: Final = 6.0
"""The noise of a reported twist is ignored up to this many standard deviations of its sum."""


_TAKEN_BACK: Final = 0.25
"""Share of the changes of a pose at rest from which they count as noise; of noise it is half."""

_CHANGES: Final = 5.0
"""So many squares of the largest change are needed to tell noise from a jump."""

_SPARE: Final = 1.25
"""The noise to declare is this many times half the largest change that was seen."""


_EARLY: Final = 0.75
"""A difference counts from this share of `UNIT` on, beyond the noise.

So noise does not hide it up to `UNIT`.
"""


def explained_function(model: StepModel) -> ca.Function:
    """Return ``(...) -> (story, said)``: what a reported twist shows, and the name of a fault.

    The name is computed again at every step.
    """
    names = (
        "told",
        "faulty",
        "started",
        "measured",
        "went",
        "excess",
        "executed",
        "sent",
        "lasted",
        "slowest",
        "fastest",
        "up",
        "down",
        "parked",
        "enable",
        "now_rests",
        "now_seen",
        "stored",
        "pose",
        "story",
        "said",
    )
    problem, robot = model.problem, model.problem.robot
    holds = robot.longest_hold > 0 and robot.owes
    given = model.symbols((*names, *(("compared",) if holds else ())))
    # One sample over a period that is too long shows nothing: the noise of that time exceeds a
    # fault.
    told = ca.logic_and(is_set(given["told"]), given["lasted"] <= 3 * problem.dt * (1 + 1e-9))
    faulty = is_set(given["faulty"])
    now = given | split(STORY, given["story"]) | split(SAID, given["said"])
    if holds:
        now |= {"held": split(model.blocks["compared"], given["compared"])["held"]}
    reported, signs = _reported(problem, now)
    # Motion while the object is not enabled is no fault.
    signs = ca.if_else(ca.logic_and(told, is_set(given["enable"])), signs, 0)
    kept = {name: now[name] for name in REPORTED}
    if robot.owes:
        kept |= {name: ca.SX(*REPORTED[name]) for name in ("drift", "blur", "path")}
        kept["due"] = ca.horzcat(now["up"], now["down"])
    led = _led_aside(now)
    reported, kept = reported | led, kept | led
    told_now = ca.if_else(told, joined(REPORTED, reported), joined(REPORTED, kept))
    named = _named(problem, now, signs[1])
    fault = ca.if_else(faulty, named.pop("fault"), 0)
    story = ca.vertcat(told_now, joined(NAMED, named))
    outputs = ca.cse(dense([story, ca.vertcat(signs, fault)]))
    return ca.Function(
        "explained", list(given.values()), outputs, list(given), ["next_story", "next_said"]
    )


def _reported(problem: Problem, now: Mapping[str, ca.SX]) -> tuple[dict[str, ca.SX], ca.SX]:
    """Compare the integral of the reported twist with what was sent.

    Return the data to keep, and the signs of a fault.
    """
    gain, unit = problem.robot.gain_error, ca.DM(UNIT)
    sent, lasted = now["sent"], now["lasted"] * now["started"]
    fresh = now["now_rests"] > now["rested"]
    keeps = ca.if_else(is_set(now["parked"]), ca.fmax(0, 1 - now["lasted"] / _FORGETS), 1)
    surprise = now["executed"] - sent
    # Noise scatters around what was sent, a fault persists. So only the change from sample to
    # sample counts as noise, and of this only the part that the next sample reverts. The changes of
    # a late robot are steady. With few samples this part may be zero by chance, so the noise is at
    # least that of the second differences, in which a steady change does not count either.
    credible = ca.DM(
        0.5 * np.repeat([problem.twist_limit.linear_speed, problem.twist_limit.angular_speed], 3)
    )
    change = ca.fmax(-credible, ca.fmin(credible, surprise - now["surprise"][:, 0]))
    back = -change * now["surprise"][:, 1]
    gone = ca.vertcat(ca.norm_2(sent[:3]), ca.norm_2(sent[3:])) * lasted
    blurs = ca.horzcat(back, (change - now["surprise"][:, 1]) ** 2 / 6) * lasted**2
    summed = {"drift": surprise * lasted, "blur": blurs, "path": gone}
    # Where the comparison begins all sums restart, except what a late robot still owes then.
    drift, blur, path = (
        ca.if_else(fresh, 0, keeps * now[name] + part) for name, part in summed.items()
    )
    due = ca.if_else(fresh, ca.horzcat(now["up"], now["down"]), now["due"])
    # A twist may be reported at the end of the period, not as its mean. So the integral of the
    # samples may be wrong by half a period.
    slack = _CERTAIN * ca.sqrt(ca.fmax(blur[:, 0], blur[:, 1])) + problem.dt / 2 * ca.fabs(sent)
    slack += gain * ca.vertcat(*[path[0]] * 3, *[path[1]] * 3)
    stretch = 1 + gain
    unheard = ca.SX(6, 1)
    if "held" in now:
        # The motion during a late call was not reported.
        reach = ca.fmax(now["held"], ca.horzcat(sent, -sent))
        unheard = stretch * problem.robot.longest_hold * ca.fmax(reach[:, 0], reach[:, 1])
    late = ca.fmax(
        drift - stretch * (now["down"] + due[:, 0]), -drift - stretch * (now["up"] + due[:, 1])
    )
    by_twist = length((late - slack - unheard) / (_EARLY * unit))
    if problem.robot.owes:
        # The sent twists give only the largest possible speed of a late robot.
        surprise = leap_beyond(now, now["executed"] * lasted) / ca.fmax(lasted, 1e-9)
    strikes = length((ca.fabs(surprise) * lasted - slack) / unit) > 1
    strike = ca.if_else(strikes, ca.norm_2(surprise), 0)
    kept = {
        "drift": drift,
        "path": path,
        "blur": blur,
        "surprise": ca.horzcat(now["executed"] - sent, change),
        "due": due,
    }
    return kept | {"rested": now["now_rests"]}, ca.vertcat(by_twist, strike)


def _led_aside(now: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
    """Return how far the reported twist leads from the computed pose since one was measured."""
    fresh, before, after = now["now_seen"] >= now["since"], now["stored"], now["pose"]
    told = ca.logic_and(now["told"], ca.logic_and(now["started"], ca.logic_not(now["measured"])))
    way = now["executed"] * now["lasted"]
    aside = ca.if_else(fresh, 0, now["aside"])
    aside += ca.if_else(told, way[:3] - now["went"][:3], 0)
    also = ca.if_else(fresh, ca.SX.eye(3), now["turned_aside"])
    turned_aside = ca.if_else(told, after[:3, :3].T @ turned(way[3:], before[:3, :3]) @ also, also)
    # |R - I| = sqrt(8) sin(angle / 2)
    sine = ca.sqrt(ca.sumsqr(ca.vec(turned_aside - ca.SX.eye(3))) / 8)
    angle = 2 * ca.asin(ca.fmin(sine, 1))
    off = ca.vertcat(ca.fmax(aside, 0), ca.fmax(-aside, 0), angle)
    farthest = ca.fmax(off, ca.if_else(fresh, 0, now["farthest"]))
    return {
        "aside": aside,
        "turned_aside": turned_aside,
        "farthest": farthest,
        "since": now["now_seen"] + 1,
    }


def _named(problem: Problem, now: Mapping[str, ca.SX], strike: ca.SX) -> dict[str, ca.SX]:
    """Return the name of the fault that fits best to the motion since the fault began."""
    sent, lasted, forget = (
        now["sent"],
        now["lasted"] * now["started"],
        ca.fmax(0, 1 - now["lasted"] / _MEMORY),
    )
    done, told = sent * lasted, now["executed"] * lasted
    seen = ca.if_else(
        is_set(now["measured"]), now["went"], ca.if_else(is_set(now["told"]), told, done)
    )
    changed = ca.if_else(is_set(now["fault"][0]), sent - now["last"], 0)
    # Motion before this fault does not count.
    goes_on = forget * is_set(now["fault"][0])
    moved = goes_on * now["moved"] + ca.horzcat(done, seen, changed)
    Y, y, s = ca.horzsplit(moved / ca.repmat(ca.DM(UNIT / UNIT[0]), 1, 3))
    products = ca.vertcat(ca.dot(Y, Y), ca.dot(Y, s), ca.dot(s, s), ca.dot(Y, y), ca.dot(s, y))
    fit = goes_on * now["fit"] + products
    leap = leap_beyond(now, now["went"])
    shift, turn = (
        ca.vertcat(int(Fault.pose_jumps), ca.norm_2(leap[:3])),
        ca.vertcat(int(Fault.pose_turns), ca.norm_2(leap[3:])),
    )
    far = (ca.fabs(leap) - 2 * ca.DM(problem.robot.noise)) / ca.DM(UNIT)
    jumps = ca.logic_and(ca.logic_and(now["measured"], now["started"]), length(far) > 1)
    # A sudden fault keeps its name, because a second jump is usually the return of the first. Any
    # other is estimated when it begins, from its first motion, and at rest if it goes on there. So
    # its sentence stays.
    sudden = now["fault"][0] >= int(Fault.pose_jumps)
    since = ca.if_else(is_set(now["fault"][0]), now["named_for"], 0)
    named_for = since + now["lasted"]
    passes = (ca.logic_and(since < time, named_for >= time) for time in (_MEMORY, _AT_REST))
    again = ca.logic_or(since <= 0, ca.logic_or(*passes))
    fault = ca.if_else(strike > 0, ca.vertcat(int(Fault.speed_jumps), strike), fault_of(fit, Y, y))
    fault = ca.if_else(jumps, ca.if_else(largest(far[:3]) >= largest(far[3:]), shift, turn), fault)
    fault = ca.if_else(ca.logic_or(sudden, ca.logic_not(again)), now["fault"], fault)
    worst = ca.fmax(now["excess"], ca.if_else(since > 0, now["worst"], 0))
    scatter, kept = _scatter(problem, now, worst)
    fault = ca.if_else(is_set(scatter[0]), scatter, fault)
    kept |= {"named_for": named_for, "worst": worst}
    return kept | {"moved": moved, "last": sent, "fit": fit, "fault": fault}


def _scatter(
    problem: Problem, now: Mapping[str, ca.SX], worst: ca.SX
) -> tuple[ca.SX, dict[str, ca.SX]]:
    """Return the fault (2,) of a pose that scatters more than is declared, and what is kept of it.

    Scatter is what is taken back from pose to pose while the object stands still. Nothing but the
    name follows from this estimate: no limit and no tolerance does.
    """
    still = ca.logic_and(now["parked"], now["measured"])
    change = ca.if_else(still, now["went"], 0)
    halves = [slice(0, 3), slice(3, 6)]
    back = ca.vertcat(*(-ca.dot(change[half], now["shaken"][half]) for half in halves))
    squares = now["squares"] + ca.vertcat(*(ca.sumsqr(change[half]) for half in halves))
    taken_back = now["taken_back"] + back
    largest_yet = ca.vertcat(*(ca.mmax(ca.fabs(change[half])) for half in halves))
    widest = ca.fmax(now["widest"], largest_yet)
    scatters = ca.logic_and(taken_back > _TAKEN_BACK * squares, squares > _CHANGES * widest**2)
    noise = _SPARE * widest / 2
    found = ca.SX(2, 1)
    kinds = (Fault.position_scatters, Fault.orientation_scatters)
    explained = [
        largest(worst[half] / ca.fmax(2 * noise[i], 1e-12)) <= 1 for i, half in enumerate(halves)
    ]
    small = [ca.sumsqr(worst[half] / ca.DM(UNIT[half])) <= 1 for half in halves]
    for i, kind in enumerate(kinds):
        by_this = ca.logic_and(ca.logic_and(scatters[i], explained[i]), ca.logic_not(small[i]))
        rest = ca.logic_or(small[1 - i], ca.logic_and(scatters[1 - i], explained[1 - i]))
        found = ca.if_else(ca.logic_and(by_this, rest), ca.vertcat(int(kind), noise[i]), found)
    kept = {"shaken": change, "taken_back": taken_back, "squares": squares, "widest": widest}
    return found, kept
