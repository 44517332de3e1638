"""The fault watch: the measured motion against the declared motion of the robot.

What a reported twist shows of a robot, and the name of its fault. This runs only where a twist is
reported or something is wrong.

A difference that the declaration does not explain is a fault and gets a name.

Measured and sent motion are compared since the object last came to stand still. It is no fault if
they differ by what a declared robot has not done yet, by its gain error, or by the noise of its
pose. Each measured pose bounds the constant difference of the two motions, axis by axis. If the
bounds of two moments exclude each other by more than `UNIT`, the robot did something that was not
declared. A reported twist is compared by its integral; scatter from sample to sample, up to half
the speed limit, counts as noise.

After a fault, and after the object was not allowed to move, it comes to rest and starts again only
from rest. While it is not enabled, no motion is a fault.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import casadi as ca
import numpy as np

from ergoqp.expressions import Shape, call_by_name, is_set, largest, turned
from ergoqp.step.causes import Cause, Fault, fault_of
from ergoqp.step.layout import (
    ASTRAY,
    COMPARED,
    NAMED,
    REPORTED,
    SAID,
    STORY,
    UNIT,
    count,
    joined,
    leap_beyond,
    length,
    split,
)
from ergoqp.step.model import Signals, StepModel

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
    robot = model.problem.robot
    holds = robot.longest_hold > 0 and robot.owes
    now = model.symbols()
    # One sample over a period that is too long shows nothing: the noise of that time exceeds a
    # fault.
    told = ca.logic_and(is_set(now["told"]), now["lasted"] <= 3 * now["task_dt"] * (1 + 1e-9))
    faulty = is_set(now["faulty"])
    now |= split(STORY, now["story"]) | split(SAID, now["said"])
    if holds:
        now["held"] = split(model.blocks["compared"], now["compared"])["held"]
    reported, signs = _reported(model, now)
    # Motion while the object is not enabled is no fault.
    signs = ca.if_else(ca.logic_and(told, is_set(now["enable"])), signs, 0)
    kept = {name: now[name] for name in REPORTED}
    if robot.owes:
        kept |= {name: ca.SX(*REPORTED[name]) for name in ("drift", "blur", "path")}
        kept["due"] = ca.horzcat(now["up"], now["down"])
    led = _led_aside(now)
    reported, kept = reported | led, kept | led
    told_now = ca.if_else(told, joined(REPORTED, reported), joined(REPORTED, kept))
    named = _named(model, now, signs[1])
    fault = ca.if_else(faulty, named.pop("fault"), 0)
    story = ca.vertcat(told_now, joined(NAMED, named))
    said = ca.vertcat(signs, fault)
    return now.function("explained", {"next_story": story, "next_said": said})


def _reported(model: StepModel, now: Signals) -> tuple[dict[str, ca.SX], ca.SX]:
    """Compare the integral of the reported twist with what was sent.

    Return the data to keep, and the signs of a fault.
    """
    robot, unit = model.robot(now), ca.DM(UNIT)
    gain = robot.gain_error
    sent, lasted = now["sent"], now["lasted"] * now["started"]
    fresh = now["now_rests"] > now["rested"]
    keeps = ca.if_else(is_set(now["parked"]), ca.fmax(0, 1 - now["lasted"] / _FORGETS), 1)
    surprise = now["executed"] - sent
    # Noise scatters around what was sent, a fault persists. So only the change from sample to
    # sample counts as noise, and of this only the part that the next sample reverts. The changes of
    # a late robot are steady. With few samples this part may be zero by chance, so the noise is at
    # least that of the second differences, in which a steady change does not count either.
    credible = robot.credible
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
    slack = _CERTAIN * ca.sqrt(ca.fmax(blur[:, 0], blur[:, 1])) + now["task_dt"] / 2 * ca.fabs(sent)
    slack += gain * ca.vertcat(*[path[0]] * 3, *[path[1]] * 3)
    stretch = 1 + gain
    unreported = ca.SX(6, 1)
    if "held" in now:
        # The motion during a late call was not reported.
        reach = ca.fmax(now["held"], ca.horzcat(sent, -sent))
        unreported = stretch * robot.longest_hold * ca.fmax(reach[:, 0], reach[:, 1])
    late = ca.fmax(
        drift - stretch * (now["down"] + due[:, 0]), -drift - stretch * (now["up"] + due[:, 1])
    )
    by_twist = length((late - slack - unreported) / (_EARLY * unit))
    if model.problem.robot.owes:
        # The sent twists give only the largest possible speed of a late robot.
        surprise = leap_beyond(now, now["executed"] * lasted) / ca.fmax(lasted, 1e-9)
    strikes = length((ca.fabs(surprise) * lasted - slack) / unit) > 1
    strike = ca.if_else(strikes, ca.norm_2(surprise), 0)
    last = ca.horzcat(now["executed"] - sent, change)
    kept = {"drift": drift, "path": path, "blur": blur, "surprise": last, "due": due}
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
    led = {"aside": aside, "turned_aside": turned_aside, "farthest": farthest}
    return led | {"since": now["now_seen"] + 1}


def _named(model: StepModel, now: Signals, strike: ca.SX) -> dict[str, ca.SX]:
    """Return the name of the fault that fits best to the motion since the fault began."""
    sent = now["sent"]
    lasted = now["lasted"] * now["started"]
    forget = ca.fmax(0, 1 - now["lasted"] / _MEMORY)
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
    shift = ca.vertcat(int(Fault.pose_jumps), ca.norm_2(leap[:3]))
    turn = ca.vertcat(int(Fault.pose_turns), ca.norm_2(leap[3:]))
    far = (ca.fabs(leap) - 2 * model.robot(now).noise) / ca.DM(UNIT)
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
    scatter, kept = _scatter(now, worst)
    fault = ca.if_else(is_set(scatter[0]), scatter, fault)
    kept |= {"named_for": named_for, "worst": worst}
    return kept | {"moved": moved, "last": sent, "fit": fit, "fault": fault}


def _scatter(now: Mapping[str, ca.SX], worst: ca.SX) -> tuple[ca.SX, dict[str, ca.SX]]:
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


CALM: Final = 0.5
"""How long the object stands still after a fault, in addition to the declared delays [s]."""

_WIDE: Final = 1e3
"""Larger than any difference [m, rad]."""

_THIRD_ORDER: Final = 0.25
"""Share of the parts of second order that covers all higher ones."""

_AROUND: Final = 1.4
"""Where measured and sent turn are this far apart, they are compared anew from there [rad]."""


def watch(model: StepModel, signals: Mapping[str, ca.MX], shape: Shape) -> dict[str, ca.MX]:
    """Return the blocks ``compared``, ``story`` and ``said`` after the last period, and ``causes``.

    The causes say why the step can only brake. A reported twist counts from the next step on.

    Args:
        model: model of the step.
        signals: the blocks before, by name, and ``pose``, ``stored`` (4, 4) each, ``started``,
            ``measured``, ``told`` (0 or 1), ``executed``, ``sent`` (6,), ``lasted`` [s],
            ``slowest``, ``fastest`` (6,): twists of a robot that does no more than it was sent,
            ``up``, ``down`` (6,): what the declared robot may still owe, ``parked`` (0 or 1),
            ``stop`` (1: the object may not move now), ``enable`` (0 or 1), ``period`` [s],
            ``causes`` so far, and if the robot may be late ``unsure`` (6, 2): how far the object
            may be from its computed pose.
        shape: how functions are written, see `ergoqp.expressions`.
    """
    compare, explain = _compared(model), explained_function(model)
    found = call_by_name(compare, signals)
    # Without a reported twist or a fault there is nothing to explain.
    was = dict(zip(explain.name_in(), explain.mx_in(), strict=True))
    story = was["story"]
    if model.problem.robot.owes:
        # The motion of a late robot in this period is unknown, so its sum starts again.
        anew = {name: ca.MX(ca.DM.zeros(*REPORTED[name])) for name in ("drift", "path", "blur")}
        anew["due"] = ca.horzcat(was["up"], was["down"])
        story = joined(STORY, split(STORY, story) | anew)
    quiet = ca.Function("quiet", list(was.values()), [story, ca.MX(ca.DM.zeros(count(SAID)))])
    choose = ca.Function.if_else("explain_or_not", shape(explain), quiet)
    facts = {**signals, **found}
    speaks = model.if_needed(ca.logic_or(found["faulty"], signals["told"]))
    story, said = choose.call([speaks, *(facts[name] for name in was)])
    return {
        "compared": found["next_compared"],
        "story": story,
        "said": said,
        "causes": found["all_causes"],
        "astray": _astray(model, signals, found["next_compared"], story),
    }


def _astray(model: StepModel, signals: Mapping[str, ca.MX], compared: ca.MX, story: ca.MX) -> ca.MX:
    """Return how far the object may be from its computed pose (7,), see `ASTRAY`.

    After a fault without a measured pose the object may be anywhere between what was sent and what
    was reported. A pose that was taken from a posture is as far off as is declared.
    """
    if not model.problem.moves_pose:
        return ca.MX(ca.DM.zeros(ASTRAY))
    now, first = split(model.blocks["compared"], compared), model.numbers(signals)["robot_first"]
    return now["doubted"] * split(STORY, story)["farthest"] + now["presumed"] * first


def taken_over(model: StepModel, twist: np.ndarray) -> dict[str, np.ndarray]:
    """Return the blocks of an object that already moves at `twist` (6,).

    What its robot still owes has not been measured.
    """
    blocks = {
        name: {part: np.zeros(size) for part, size in block.items()}
        for name, block in model.blocks.items()
    }
    blocks["compared"]["least"] -= _WIDE
    blocks["compared"]["most"] += _WIDE
    late = model.problem.robot.dead_time + model.problem.robot.lag
    blocks["story"]["due"] = late * np.stack([np.maximum(twist, 0), np.maximum(-twist, 0)], axis=1)
    return {
        name: np.concatenate([part.ravel(order="F") for part in block.values()])
        for name, block in blocks.items()
    }


def _compared(model: StepModel) -> ca.Function:
    """Return the function that compares the poses.

    It is ``(...) -> (next_compared, faulty, all_causes, went, now_rests, now_seen, excess)``: the
    block, whether there is a fault, the causes, the motion of the pose (6,), how often it came to
    rest, how often it was measured, and by how much (6,) it differs from what is declared.

    An interpreter pays for every scalar here in every step. So everything that is not needed to
    detect a fault is in `ergoqp.step.faults`.
    """
    now, robot = model.symbols(), model.problem.robot
    given = model.robot(now)
    stretch = 1 + given.gain_error
    sizes = model.blocks["compared"]
    now |= split(sizes, now["compared"]) | split(SAID, now["said"])
    parked, enabled, noise = now["parked"], is_set(now["enable"]), ca.SX(given.noise)
    done = now["sent"] * (now["lasted"] * now["started"])
    went = now["started"] * _difference(now["stored"], now["pose"])
    apart, least, most = now["apart"] + went - done, now["least"], now["most"]
    block, gone, slip = {}, ca.SX(6, 1), ca.SX(6, 1)
    if robot.longest_hold and not robot.owes:
        reach = ca.fmax(now["held"], ca.horzcat(now["sent"], -now["sent"]))
        block["held"] = ca.if_else(now["measured"], 0, reach)
        gone = now["measured"] * _held(given, leap_beyond(now, went), reach)
        apart -= gone
        # A hold that does not exceed the noise is not subtracted, and what is subtracted may be
        # noise in part.
        longest = stretch * given.longest_hold * ca.fmax(reach[:, 0], reach[:, 1])
        slip = ca.fmax(now["slip"], ca.fmin(longest, 4 * noise))
    if "blind" in sizes:
        # Two paths to the same end, one of them this far behind, differ by the area between them.
        turn = now["blind"] + ca.norm_2(done[3:])
        block["blind"] = ca.if_else(now["measured"], 0, turn)
        unsure = ca.norm_2(ca.fmax(now["unsure"][3:, 0], now["unsure"][3:, 1]))
        area = now["measured"] * (now["blind"] > 0) * turn * unsure
        aside = ca.vertcat(0, 0, 0, area, area, area)
        least, most = least - aside, most + aside
    # At the start of the comparison the pose has its full error; the turn since then is known up to
    # noise.
    at_begin, sent = noise, ca.SX.eye(3)
    begun = present = now["pose"][:3, :3]
    if "turned" in sizes:
        # In the axes of the turn that was sent. An error that is already present turns with the
        # object: it stays the same in these axes, and would be a fault in those of the world.
        sent = ca.if_else(now["started"], turned(done[3:] + gone[3:], now["turned"]), ca.SX.eye(3))
        begun = ca.if_else(now["started"], now["turned_from"], present)
        apart[3:] = sent.T @ _rotation(sent @ begun, present)
        # In these axes the error of a pose may be along any axis, but that of the first one.
        noise = ca.vertcat(noise[:3], np.sqrt(3) * noise[3:])
    below = above = ca.SX(6, 1)
    if robot.owes:
        below, above = below + stretch * now["down"], above + stretch * now["up"]
    # Where the comparison begins, its axes are those of the world.
    below_begin, above_begin = ca.SX(below), ca.SX(above)
    if "turned" in sizes:
        below[3:], above[3:] = _in_axes(sent, below[3:], above[3:])
        if robot.owes:
            if robot.gain_error:
                # What is owed is that of a robot that is turned by the difference.
                aside = _mixed(ca.fmax(below[3:], above[3:]), apart[3:])
                aside = aside / 2 + _mixed(aside, apart[3:]) / 11
                below[3:], above[3:] = below[3:] + aside, above[3:] + aside
            block["area"] = now["area"] + sent.T @ _area(now, done)
            drift = stretch**2 * block["area"]
            # One after the other, what is owed and this drift add up but for their cross product.
            mixed = _mixed(ca.fmax(below[3:], above[3:]), drift) / 2
            mixed += _THIRD_ORDER * (ca.fabs(drift) + mixed)
            below[3:] += ca.fmax(drift, 0) + mixed
            above[3:] += ca.fmax(-drift, 0) + mixed
            block["area"] = ca.if_else(now["started"], block["area"], 0)
    if robot.longest_hold and robot.owes:
        # Along any axis of a turn: it was somewhere on the way.
        reach = ca.fmax(now["held"], ca.horzcat(now["sent"], -now["sent"]))
        hold = stretch * given.longest_hold * reach
        if "turned" in sizes:
            hold[3:, :] = ca.norm_2(ca.fmax(hold[3:, 0], hold[3:, 1]))
        below, above = below + hold[:, 0], above + hold[:, 1]
        below_begin, above_begin = below_begin + hold[:, 0], above_begin + hold[:, 1]
    if robot.gain_error:
        spread = ca.fabs(done)
        if "turned" in sizes:
            spread[3:] = _spread(sent.T @ done[3:], apart[3:])
        else:
            # The error of a shift is along what was sent; that of a turn turns with the object.
            spread[3:] = ca.norm_2(done[3:])
        least, most = least - given.gain_error * spread, most + given.gain_error * spread
    unseen = _WIDE * (1 - now["measured"])
    low, high = apart - noise - below - unseen, apart + noise + above + unseen
    excess = ca.fmax(ca.fmax(least, low) - ca.fmin(most, high) - slip, 0)
    beyond = excess * ca.DM(1 / UNIT)
    by_pose = ca.logic_and(ca.fmax(ca.sumsqr(beyond[:3]), ca.sumsqr(beyond[3:])) > 1, enabled)
    found = ca.logic_or(by_pose, ca.logic_or(now["signs"][0] > 1, now["signs"][1] > 0))
    # The comparison starts again where the object is measured standing still, and after a fault
    # there. Where it is not measured standing, the motion before is still to be compared.
    comes_to_rest = ca.logic_and(parked, ca.logic_or(now["calm"] <= 0, found))
    may_begin = ca.logic_or(ca.logic_not(now["begun"]), found)
    begins = ca.logic_and(ca.logic_and(parked, now["measured"]), may_begin)
    anew = ca.logic_or(begins, ca.logic_not(enabled))
    again = anew
    if "turned" in sizes:
        # A turn of more than this is no measure of an error any more: it may lead around.
        around = ca.logic_or(anew, ca.sumsqr(apart[3:]) > _AROUND**2)
        again = ca.vertcat(*[anew] * 3, *[around] * 3)
        block["turned"] = ca.if_else(around, ca.SX.eye(3), sent)
        block["turned_from"] = ca.if_else(around, present, begun)
        if "area" in sizes:
            block["area"] = ca.if_else(around, 0, block["area"])
    least = ca.if_else(again, -(at_begin + below_begin + unseen), ca.fmax(least, low))
    most = ca.if_else(again, at_begin + above_begin + unseen, ca.fmin(most, high))
    if "slip" in sizes:
        block["slip"] = ca.if_else(anew, 0, slip)
    if robot.longest_hold and robot.owes:
        # A hold before the object came to rest counts in this comparison, but not in the next.
        block["held"] = ca.fmax(now["held"] * (1 - begins), ca.horzcat(now["sent"], -now["sent"]))

    calm = ca.logic_and(parked, ca.logic_not(found)) * (now["calm"] + now["period"])
    over = calm >= CALM + given.dead_time + 3 * given.lag
    faulty = ca.logic_or(found, ca.logic_and(is_set(now["fault"][0]), ca.logic_not(over)))
    # Without a measured pose nobody knows where a robot is that did something else. What it reports
    # is no ground to move again on.
    unseen_now = ca.logic_not(now["measured"]) if model.problem.moves_pose else ca.SX(0)
    latched = ca.logic_and(unseen_now, ca.logic_or(found, now["latched"]))
    doubted = ca.logic_and(unseen_now, ca.logic_or(found, now["doubted"]))
    presumed = ca.logic_and(unseen_now, ca.logic_or(ca.logic_not(now["started"]), now["presumed"]))
    stops = ca.logic_or(ca.logic_or(faulty, latched), now["stop"])
    halted = ca.logic_or(stops, ca.logic_and(now["halted"], ca.logic_not(parked)))
    rests = now["rests"] + ca.logic_or(comes_to_rest, ca.logic_not(enabled))
    begun = ca.logic_and(parked, ca.logic_or(now["begun"], begins))
    seen = now["seen"] + now["measured"]
    kept = (apart * (1 - again), least, most, calm, halted, rests, begun)
    block |= dict(zip(COMPARED, (*kept, seen, latched, doubted, presumed), strict=True))
    resting = ca.logic_and(halted, ca.logic_not(stops))
    waiting = ca.logic_and(latched, ca.logic_not(faulty))
    causes = now["causes"] + 2.0**Cause.robot * faulty + 2.0**Cause.halted * resting
    causes += 2.0**Cause.latched * waiting
    found = {"next_compared": joined(sizes, block), "faulty": faulty, "all_causes": causes}
    found |= {"went": went, "now_rests": rests, "now_seen": seen, "excess": excess}
    return now.function("compared_poses", found)


def _difference(before: ca.SX, after: ca.SX) -> ca.SX:
    """Return the displacement (6,) along the world's axes that leads from one pose to another."""
    return ca.vertcat(after[:3, 3] - before[:3, 3], _rotation(before, after))


def _rotation(before: ca.SX, after: ca.SX) -> ca.SX:
    """Return the turn (3,) [rad] that leads from one orientation to another."""
    columns = [(before[:3, i], after[:3, i]) for i in range(3)]
    sines = sum((ca.cross(*pair) for pair in columns), ca.SX(3, 1)) / 2
    trace = sum((ca.dot(*pair) for pair in columns), ca.SX(0))
    sine = ca.sqrt(ca.sumsqr(sines) + 1e-30)
    turn = sines * (ca.atan2(sine, (trace - 1) / 2) / sine)
    # Half a turn has a sine of zero but is large.
    over = ca.if_else(trace < 1, 1.0, 0.0)
    return ca.vertcat(turn[0] + ca.if_else(turn[0] < 0, -over, over), turn[1:])


def _in_axes(axes: ca.SX, below: ca.SX, above: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the ends of an interval (3,) around zero, seen in other axes."""
    middle, half = axes.T @ (above - below) / 2, ca.fabs(axes.T) @ (above + below) / 2
    return half - middle, half + middle


def _area(now: Mapping[str, ca.SX], done: ca.SX) -> ca.SX:
    """Return by how much (3,) [rad] the turn that a late robot makes differs in this period.

    Turns do not commute. With what it still owes, it ends beside what was sent, by half the cross
    products of the two: the area between the two ways.
    """
    owed = now["owed"][3:]
    before, did = owed + now["changed"][3:], done[3:] + now["started"] * now["changed"][3:]
    return (ca.cross(owed, did) + ca.cross(before, done[3:])) / 2


def _spread(turn: ca.SX, apart: ca.SX) -> ca.SX:
    """Return the most that a turn (3,) adds per axis to one that is present, of up to 1.5 rad.

    It is the inverse of the left Jacobian of the rotations, with the size of each of its terms.
    """
    aside = ca.cross(apart, turn)
    return ca.fabs(turn) + ca.fabs(aside) / 2 + ca.fabs(ca.cross(apart, aside)) / 11


def _mixed(one: ca.SX, other: ca.SX) -> ca.SX:
    """Return the largest size of each entry of the cross product of turns (3,) of these sizes."""
    a, b = ca.fabs(one), ca.fabs(other)
    return ca.vertcat(*(a[i] * b[j] + a[j] * b[i] for i, j in ((1, 2), (2, 0), (0, 1))))


def _held(robot: Any, leap: ca.SX, reach: ca.SX) -> ca.SX:
    """Return the part of a leap (6,) that one declared hold of at most `reach` (6, 2) explains.

    It is zero for a leap that may be noise.
    """
    most = robot.longest_hold * (1 + robot.gain_error) * ca.fmax(reach, 0)
    explained = ca.fmax(ca.fmin(leap, most[:, 0]), -most[:, 1])
    stands_out = length((ca.fabs(leap) - 2 * robot.noise) / ca.DM(UNIT)) > 1
    return ca.if_else(stands_out, explained, 0)
