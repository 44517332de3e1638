"""Whether the robot does what it was sent: measured motion against declared motion.

What does not fit gets a name.

Measured and sent motion are compared since the object last came to stand still. What a declared
robot may differ by is no fault: what it has not done yet, its gain error, the noise of its pose.
Each measured pose says between which ends the constant difference of the two must lie, axis by
axis; when the ends of two moments leave no room, by more than `UNIT`, something was done that was
not declared. A reported twist is compared by its integral; what scatters from sample to sample, up
to half the speed limit, is noise.

After a fault, and after the object was not allowed to move, it comes to rest and starts again from
rest only. While it is not enabled, whatever moves it is no fault.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.expressions.linear import Shape, by_name, dense, is_set
from ergoqp.expressions.rigid import turned
from ergoqp.problem.robot import DeclaredRobot
from ergoqp.step.answer.causes import Cause
from ergoqp.step.model import StepModel
from ergoqp.step.packing import count, joined, split
from ergoqp.step.robot_watch.explained import explained_function
from ergoqp.step.robot_watch.memory import (
    ACCOUNT,
    COMPARED,
    REPORTED,
    SAID,
    STORY,
    UNIT,
    leap_beyond,
    length,
)

CALM: Final = 0.5
"""How long the object stands still after a fault, beside the robot's declared lateness [s]."""

_WIDE: Final = 1e3
"""Further apart than anything [m, rad]."""


def watch(model: StepModel, known: Mapping[str, ca.MX], shape: Shape) -> dict[str, ca.MX]:
    """Return the blocks ``compared``, ``story`` and ``said`` after the last period, and ``causes``.

    Those are why the step can only brake.

    What a reported twist shows counts from the next step on.

    Args:
        model: of the step.
        known: the blocks before, by name, and ``pose``, ``stored`` (4, 4) each, ``started``,
            ``measured``, ``told`` (0 or 1), ``executed``, ``sent`` (6,), ``lasted`` [s],
            ``slowest``, ``fastest`` (6,): twists of a robot that does no more than it was sent,
            ``up``, ``down`` (6,): what the declared robot may still owe, ``parked`` (0 or 1),
            ``stop`` (1: the object may not move now), ``enable`` (0 or 1), ``period`` [s],
            ``causes`` so far, and where the robot may be late ``unsure`` (6, 2): how far the object
            may be from where it is reckoned.
        shape: how functions are written, see `ergoqp.expressions.linear`.
    """
    compare, explain = shape(_compared(model)), explained_function(model)
    found = by_name(compare, known)
    # Where no twist is reported and nothing is wrong, there is nothing to explain.
    inputs = [ca.MX.sym(explain.name_in(i), explain.sparsity_in(i)) for i in range(explain.n_in())]
    was = dict(zip(explain.name_in(), inputs, strict=True))
    story = was["story"]
    if model.problem.robot.owes:
        # What a late robot did in this period nobody knows, so the sum of what it did begins anew.
        anew = {name: ca.MX(ca.DM.zeros(*REPORTED[name])) for name in ("drift", "path", "blur")}
        anew["due"] = ca.horzcat(was["up"], was["down"])
        story = joined(STORY, split(STORY, story) | anew)
    quiet = ca.Function("quiet", inputs, [story, ca.MX(ca.DM.zeros(count(SAID)))])
    choose = ca.Function.if_else("explain_or_not", shape(explain), quiet)
    facts = {**known, **found}
    speaks = ca.logic_or(found["faulty"], known["told"])
    story, said = choose.call([speaks, *(facts[name] for name in was)])
    return {
        "compared": found["next_compared"],
        "story": story,
        "said": said,
        "causes": found["all_causes"],
    }


def taken_over(model: StepModel, twist: np.ndarray) -> dict[str, np.ndarray]:
    """Return the blocks of an object that moves already at `twist` (6,).

    What its robot owes nobody has measured.
    """
    blocks = {
        name: {part: np.zeros(size) for part, size in block.items()}
        for name, block in model.blocks.items()
    }
    blocks["compared"]["least"] -= _WIDE
    blocks["compared"]["most"] += _WIDE
    late = model.problem.robot.dead_time + model.problem.robot.lag
    blocks["story"]["due"] = late * np.stack([np.maximum(twist, 0), np.maximum(-twist, 0)], axis=1)
    blocks["account"]["short"] = blocks["story"]["due"]
    return {
        name: np.concatenate([part.ravel(order="F") for part in block.values()])
        for name, block in blocks.items()
    }


def reckoned(robot: DeclaredRobot, given: Mapping[str, ca.SX]) -> tuple[ca.SX, ca.SX]:
    """Return the last period's motion (6,), as far as it is known where no pose is measured.

    The next account is returned with it.

    The declared motion is integrated, not the noise of what is reported of it. Once that has shown
    a fault, what is reported is: as far as it was sent, in this period or before, since a robot
    that is late does later what it did not do before; and what was integrated too much until then
    is taken back. So nothing that is reported leads further than what was sent.

    Args:
        robot: as declared.
        given: blocks ``account`` and ``said`` of the state, ``sent``, ``changed``, ``executed``
            (6,), ``lasted`` [s], and ``told``, ``measured``, ``started``, ``parked`` (0 or 1), and
            for how long nothing has been sent ``idled`` [s].
    """
    now = dict(given) | split(ACCOUNT, given["account"]) | split(SAID, given["said"])
    known = ca.logic_or(
        ca.logic_or(now["signs"][0] > 1, now["signs"][1] > 0), is_set(now["fault"][0])
    )
    declared = now["sent"] * now["lasted"] + now["changed"]
    # Before it is known where the object is, nobody knows for how long it has moved either.
    sent = (1 + robot.gain_error) * now["started"] * now["sent"] * now["lasted"]
    most = now["short"] + ca.fmax(ca.horzcat(sent, -sent), 0)
    way = ca.if_else(now["told"], now["executed"] * now["lasted"], declared)
    parts = ca.fmin(ca.fmax(ca.horzcat(way, -way), 0), most)
    done = parts[:, 0] - parts[:, 1]
    moved = ca.if_else(ca.logic_and(now["told"], known), done - now["ahead"], declared)
    forgiven = now["idled"] >= CALM + robot.dead_time + 3 * robot.lag
    over = ca.logic_or(forgiven, ca.logic_and(now["parked"], ca.logic_not(known)))
    short = ca.if_else(over, 0, most - parts)
    anew = ca.logic_or(ca.logic_or(over, now["measured"]), ca.logic_not(now["started"]))
    ahead = ca.if_else(anew, 0, now["ahead"] + moved - done)
    return moved, joined(ACCOUNT, {"short": short, "ahead": ahead})


def _compared(model: StepModel) -> ca.Function:
    """Compare the poses.

    The function is ``(...) -> (next_compared, faulty, all_causes, went, now_rests)``: the block,
    whether there is a fault, causes, motion of the pose (6,), and how often it came to rest.

    An interpreter pays for every scalar here in every step, so what is not needed to see a fault is
    in `ergoqp.step.robot_watch.explained`.
    """
    robot, stretch = model.problem.robot, 1 + model.problem.robot.gain_error
    names = (
        "pose",
        "stored",
        "started",
        "measured",
        "sent",
        "lasted",
        "slowest",
        "fastest",
        "up",
        "down",
        "parked",
        "stop",
        "enable",
        "period",
        "compared",
        "said",
        "causes",
    )
    given = model.symbols((*names, *(("unsure",) if robot.owes else ())))
    sizes = model.blocks["compared"]
    now = given | split(sizes, given["compared"]) | split(SAID, given["said"])
    parked, enabled, noise = now["parked"], is_set(now["enable"]), ca.DM(robot.noise)
    done = now["sent"] * (now["lasted"] * now["started"])
    went = now["started"] * _difference(now["stored"], now["pose"])
    apart, least, most = now["apart"] + went - done, now["least"], now["most"]
    block, gone, slip = {}, ca.SX(6, 1), ca.SX(6, 1)
    if robot.longest_hold and not robot.owes:
        reach = ca.fmax(now["held"], ca.horzcat(now["sent"], -now["sent"]))
        block["held"] = ca.if_else(now["measured"], 0, reach)
        gone = now["measured"] * _held(robot, leap_beyond(now, went), reach)
        apart -= gone
        # A hold that does not stand out of the noise is not taken off, and what is taken off may be
        # noise in part.
        longest = stretch * robot.longest_hold * ca.fmax(reach[:, 0], reach[:, 1])
        slip = ca.fmax(now["slip"], ca.fmin(longest, 4 * noise))
    if "blind" in sizes:
        # Two ways with the same end, of which one is as far behind as that, differ by the area
        # between them.
        turn = now["blind"] + ca.norm_2(done[3:])
        block["blind"] = ca.if_else(now["measured"], 0, turn)
        area = (
            now["measured"]
            * (now["blind"] > 0)
            * turn
            * ca.norm_2(ca.fmax(now["unsure"][3:, 0], now["unsure"][3:, 1]))
        )
        least, most = (
            least - ca.vertcat(0, 0, 0, area, area, area),
            most + ca.vertcat(0, 0, 0, area, area, area),
        )
    # Where the comparison begins, the pose is as far off as it may be; how it was turned since then
    # is known but for noise.
    at_begin, sent_to = noise, now["pose"][:3, :3]
    if "turned" in sizes:
        sent_to = ca.if_else(
            now["started"], turned(done[3:] + gone[3:], now["turned"]), now["pose"][:3, :3]
        )
        apart[3:] = _rotation(sent_to, now["pose"][:3, :3])
        at_begin = ca.vertcat(noise[:3], 0, 0, 0)
        # The error of the pose at the begin turns with the object, so it may lie along any axis.
        noise = ca.vertcat(noise[:3], (1 + np.sqrt(3)) * noise[3:])
    below = above = ca.SX(6, 1)
    if robot.owes:
        below, above = below + stretch * now["down"], above + stretch * now["up"]
    if robot.longest_hold and robot.owes:
        hold = (
            stretch
            * robot.longest_hold
            * ca.fmax(now["held"], ca.horzcat(now["sent"], -now["sent"]))
        )
        below, above = below + hold[:, 0], above + hold[:, 1]
    if robot.gain_error:
        # A shift is along what was sent; what is left of a turn turns with the object.
        spread = robot.gain_error * ca.vertcat(ca.fabs(done[:3]), *[ca.norm_2(done[3:])] * 3)
        least, most = least - spread, most + spread
    unseen = _WIDE * (1 - now["measured"])
    low, high = apart - noise - below - unseen, apart + noise + above + unseen
    beyond = ca.fmax(ca.fmax(least, low) - ca.fmin(most, high) - slip, 0) * ca.DM(1 / UNIT)
    by_pose = ca.logic_and(ca.fmax(ca.sumsqr(beyond[:3]), ca.sumsqr(beyond[3:])) > 1, enabled)
    found = ca.logic_or(by_pose, ca.logic_or(now["signs"][0] > 1, now["signs"][1] > 0))
    # The difference counts anew from where the object is seen to stand still, and from where it was
    # seen to move there. Where it is not seen to stand, what it was before is still to be compared.
    comes_to_rest = ca.logic_and(parked, ca.logic_or(now["calm"] <= 0, found))
    begins = ca.logic_and(
        ca.logic_and(parked, now["measured"]), ca.logic_or(ca.logic_not(now["begun"]), found)
    )
    anew = ca.logic_or(begins, ca.logic_not(enabled))
    least = ca.if_else(anew, -(at_begin + below + unseen), ca.fmax(least, low))
    most = ca.if_else(anew, at_begin + above + unseen, ca.fmin(most, high))
    if "slip" in sizes:
        block["slip"] = ca.if_else(anew, 0, slip)
    if "turned" in sizes:
        block["turned"] = ca.if_else(anew, now["pose"][:3, :3], sent_to)
    if robot.longest_hold and robot.owes:
        # What it held on to before it came to rest still counts in this comparison, and no more in
        # the next one.
        block["held"] = ca.fmax(now["held"] * (1 - begins), ca.horzcat(now["sent"], -now["sent"]))

    calm = ca.logic_and(parked, ca.logic_not(found)) * (now["calm"] + now["period"])
    over = calm >= CALM + robot.dead_time + 3 * robot.lag
    faulty = ca.logic_or(found, ca.logic_and(is_set(now["fault"][0]), ca.logic_not(over)))
    halted = ca.logic_or(
        ca.logic_or(faulty, now["stop"]), ca.logic_and(now["halted"], ca.logic_not(parked))
    )
    rests = now["rests"] + ca.logic_or(comes_to_rest, ca.logic_not(enabled))
    begun = ca.logic_and(parked, ca.logic_or(now["begun"], begins))
    block |= dict(
        zip(COMPARED, (apart * (1 - anew), least, most, calm, halted, rests, begun), strict=True)
    )
    resting = ca.logic_and(halted, ca.logic_not(ca.logic_or(faulty, now["stop"])))
    causes = now["causes"] + 2.0**Cause.robot * faulty + 2.0**Cause.halted * resting
    outputs = ca.cse(dense([joined(sizes, block), faulty, causes, went, rests]))
    named = ["next_compared", "faulty", "all_causes", "went", "now_rests"]
    return ca.Function("compared_poses", list(given.values()), outputs, list(given), named)


def _difference(before: ca.SX, after: ca.SX) -> ca.SX:
    """Displacement (6,) along the world's axes that leads from one pose to another."""
    return ca.vertcat(after[:3, 3] - before[:3, 3], _rotation(before, after))


def _rotation(before: ca.SX, after: ca.SX) -> ca.SX:
    """Turn (3,) [rad] that leads from one orientation to another."""
    columns = [(before[:3, i], after[:3, i]) for i in range(3)]
    sines = sum((ca.cross(*pair) for pair in columns), ca.SX(3, 1)) / 2
    trace = sum((ca.dot(*pair) for pair in columns), ca.SX(0))
    sine = ca.sqrt(ca.sumsqr(sines) + 1e-30)
    turn = sines * (ca.atan2(sine, (trace - 1) / 2) / sine)
    # Half a turn has no sine; it is large all the same.
    over = ca.if_else(trace < 1, 1.0, 0.0)
    return ca.vertcat(turn[0] + ca.if_else(turn[0] < 0, -over, over), turn[1:])


def _held(robot: DeclaredRobot, leap: ca.SX, reach: ca.SX) -> ca.SX:
    """How much of a leap (6,) one declared hold explains, of at most `reach` (6, 2).

    Of a leap that may be noise it explains none.
    """
    most = robot.longest_hold * (1 + robot.gain_error) * ca.fmax(reach, 0)
    explained = ca.fmax(ca.fmin(leap, most[:, 0]), -most[:, 1])
    stands_out = length((ca.fabs(leap) - 2 * ca.DM(robot.noise)) / ca.DM(UNIT)) > 1
    return ca.if_else(stands_out, explained, 0)
