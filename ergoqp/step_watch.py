"""Whether the robot does what it was sent: measured motion against declared motion, and a name for what does not fit.

Measured and sent motion are compared since the object last came to stand still. What a declared robot may differ by is no
fault: what it has not done yet, its gain error, the noise of its pose. Each measured pose says between which ends the constant
difference of the two must lie, axis by axis; when the ends of two moments leave no room, by more than `UNIT`, something was
done that was not declared. A reported twist is compared by its integral; what scatters from sample to sample, up to half
the speed limit, is noise.

After a fault, and after the object was not allowed to move, it comes to rest and starts again from rest only. While it is not
enabled, whatever moves it is no fault.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

import casadi as ca
import numpy as np

from ergoqp.linear import Shape, dense, largest
from ergoqp.rigid import turned
from ergoqp.step_causes import Cause
from ergoqp.step_faults import Fault, fault_of
from ergoqp.step_history import owes
from ergoqp.step_parts import count, joined, split

if TYPE_CHECKING:
    from ergoqp.problem import Problem

UNIT: Final = np.repeat([0.001, np.radians(0.2)], 3)
"""Difference of measured and declared motion that is none yet, per axis (6,) [m, rad]."""

CALM: Final = 0.5
"""For how long the object stands still after a fault, beside the time that the robot is declared to be late [s]."""

_MEMORY: Final = 0.3
"""How far back the motion is looked at to name a fault [s]."""

_WIDE: Final = 1e3
"""Further apart than anything [m, rad]."""

_FORGETS: Final = 0.5
"""Standing still, a reported twist is summed over so long: what a sensor reads at rest adds up to nothing [s]."""

_CERTAIN: Final = 6.0
"""Noise of a reported twist counts as none up to so many standard deviations of its sum."""


_COMPARED: Final = {
    "apart": (6, 1),  # measured motion less sent motion, by the pose
    "least": (6, 1),  # ends of their constant difference
    "most": (6, 1),
    "calm": (1, 1),  # for how long the object has stood still, as far as is seen
    "halted": (1, 1),  # 1 until it has come to rest
    "rests": (1, 1),  # how often the comparison was begun
}
_REPORTED: Final = {
    "drift": (6, 1),  # measured motion less sent motion, by the reported twist
    "path": (2, 1),  # how far it went, and turned, since it stood still
    "blur": (6, 1),  # variance of the drift, and the last sample
    "surprise": (6, 1),
    "due": (6, 2),  # what a declared robot still owed when this was begun, along each axis and against it
    "rested": (1, 1),  # what ``rests`` was then
}
_NAMED: Final = {
    "moved": (6, 3),  # since there is a fault: sent motion, measured motion, change of the sent twist
    "last": (6, 1),  # the sent twist before the last one
    "fit": (5, 1),  # sums of the products of `moved`
}
_SAID: Final = {
    "signs": (2, 1),  # above 1 where the integral says that there is a fault; above 0 [m/s, rad/s] where one sample does
    "fault": (2, 1),  # a `Fault` and its amount
}
_STORY: Final = {**_REPORTED, **_NAMED}
TOLD_SO_FAR: Final = 8
"""What `missed` needs of the story: its first entries."""
_SIZES: Final = (
    {**_COMPARED, **_STORY, **_SAID}
    | dict.fromkeys(("executed", "sent", "up", "down", "slowest", "fastest", "went"), (6, 1))
    | dict.fromkeys(("pose", "stored"), (4, 4))
    | {"unsure": (6, 2)}
)


def watch_blocks(problem: Problem) -> dict[str, dict[str, tuple[int, int]]]:
    """Return the blocks of the state that watch the robot, and their parts; all zero at the start."""
    # The fastest that may have been held on to, along each axis and against it: since the last measured pose; of a late robot,
    # in which a hold shows little by little and so does not stand out, since it stood still.
    held = {"held": (6, 2)} if problem.robot.longest_hold else {}
    # Turns do not commute: differences of neighbouring noisy poses would add up to a random walk. How the object was turned by
    # what was sent since it stood still.
    turn = {"turned": (3, 3)} if problem.robot.pose_noise_deg else {}
    # For the same reason: by which angle the object was turned by what was sent since it was measured, if not by that.
    blind = {"blind": (1, 1)} if owes(problem) and not turn else {}
    return {"compared": _COMPARED | held | turn | blind, "story": _STORY, "said": _SAID}


def watch(problem: Problem, given: Mapping[str, ca.MX], shape: Shape) -> tuple[dict[str, ca.MX], ca.MX]:
    """Return `watch_blocks` after the last period, and the causes why the step can only brake.

    What a reported twist shows counts from the next step on.

    Args:
        problem: the task.
        given: the blocks before, by name, and ``pose``, ``stored`` (4, 4) each, ``started``, ``measured``, ``told`` (0 or 1),
            ``executed``, ``sent`` (6,), ``lasted`` [s], ``slowest``, ``fastest`` (6,): twists of a robot that does no more
            than it was sent, ``up``, ``down`` (6,): what the declared robot may still owe, ``parked`` (0 or 1), ``stop``
            (1: the object may not move now), ``enable`` (0 or 1), ``period`` [s], ``causes`` so far, and where the robot may be
            late ``unsure`` (6, 2): how far the object may be from where it is reckoned.
        shape: how functions are written, see `ergoqp.linear`.
    """
    compare, explain = shape(_compared(problem)), _explained(problem)
    compared, faulty, causes, went, rests = compare.call([given[name] for name in compare.name_in()])
    # Where no twist is reported and nothing is wrong, there is nothing to explain.
    inputs = [ca.MX.sym(explain.name_in(i), explain.sparsity_in(i)) for i in range(explain.n_in())]
    was = dict(zip(explain.name_in(), inputs, strict=True))
    story = was["story"]
    if owes(problem):
        # What a late robot did in this period nobody knows, so the sum of what it did begins anew.
        anew = {name: ca.MX(ca.DM.zeros(*_REPORTED[name])) for name in ("drift", "path", "blur")}
        anew["due"] = ca.horzcat(was["up"], was["down"])
        story = joined(_STORY, split(_STORY, story) | anew)
    quiet = ca.Function("quiet", inputs, [story, ca.MX(ca.DM.zeros(count(_SAID)))])
    choose = ca.Function.if_else("explain_or_not", shape(explain), quiet)
    facts = {**given, "went": went, "faulty": faulty, "now_rests": rests}
    story, said = choose.call([ca.logic_or(faulty, given["told"]), *(facts[name] for name in was)])
    return {"compared": compared, "story": story, "said": said}, causes


def taken_over(problem: Problem, twist: np.ndarray) -> dict[str, np.ndarray]:
    """Return the blocks of an object that moves already at `twist` (6,): what its robot owes nobody has measured."""
    sizes = watch_blocks(problem)
    blocks = {name: {part: np.zeros(size) for part, size in block.items()} for name, block in sizes.items()}
    blocks["compared"]["least"] -= _WIDE
    blocks["compared"]["most"] += _WIDE
    late = problem.robot.dead_time + problem.robot.lag
    blocks["story"]["due"] = late * np.stack([np.maximum(twist, 0), np.maximum(-twist, 0)], axis=1)
    return {name: np.concatenate([part.ravel(order="F") for part in block.values()]) for name, block in blocks.items()}


def missed(said: ca.SX, begin: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return whether what the robot reported so far shows a fault, or one is not over; and what it has missed until then.

    The second (6,) [m, rad] is not 0 in the first step that knows of a fault, and no more than the way since it stood still.

    Args:
        said: block of the state.
        begin: first `TOLD_SO_FAR` entries of the story.
    """
    now, drift, path = split(_SAID, said), begin[:6], begin[6:]
    signs, fault = now["signs"], now["fault"][0]
    way = ca.vertcat(*[path[0]] * 3, *[path[1]] * 3)
    first = ca.logic_and(signs[0] > 1, ca.logic_and(signs[1] <= 0, fault < 0.5))
    known = ca.logic_or(ca.logic_or(signs[0] > 1, signs[1] > 0), fault > 0.5)
    return known, first * ca.fmax(ca.fmin(drift, way), -way)


def _symbols(problem: Problem, *names: str) -> dict[str, ca.SX]:
    sizes = _SIZES | {name: (count(block), 1) for name, block in watch_blocks(problem).items()}
    return {name: ca.SX.sym(name, *sizes.get(name, (1, 1))) for name in names}


def _compared(problem: Problem) -> ca.Function:
    """Compare the poses: ``(...) -> (compared, whether there is a fault, causes, motion of the pose (6,), rests)``.

    An interpreter pays for every scalar here in every step, so what is not needed to see a fault is in `_explained`.
    """
    robot, stretch = problem.robot, 1 + problem.robot.gain_error
    names = ("pose", "stored", "started", "measured", "sent", "lasted", "slowest", "fastest", "up", "down", "parked", "stop")
    given = _symbols(problem, *names, "enable", "period", "compared", "said", "causes", *(["unsure"] if owes(problem) else []))
    sizes = watch_blocks(problem)["compared"]
    now = given | split(sizes, given["compared"]) | split(_SAID, given["said"])
    parked, enabled, noise = now["parked"], now["enable"] > 0.5, ca.DM(robot.noise)
    done = now["sent"] * (now["lasted"] * now["started"])
    went = now["started"] * _difference(now["stored"], now["pose"])
    apart, least, most = now["apart"] + went - done, now["least"], now["most"]
    block, gone = {}, ca.SX(6, 1)
    if robot.longest_hold and not owes(problem):
        reach = ca.fmax(now["held"], ca.horzcat(now["sent"], -now["sent"]))
        block["held"] = ca.if_else(now["measured"], 0, reach)
        gone = now["measured"] * _held(problem, _leap(now, went), reach)
        apart -= gone
        # A hold that does not stand out of the noise is not taken off, and what is taken off may be noise in part.
        noise *= 3
    if "blind" in sizes:
        # Two ways with the same end, of which one is as far behind as that, differ by the area between them.
        turn = now["blind"] + ca.norm_2(done[3:])
        block["blind"] = ca.if_else(now["measured"], 0, turn)
        area = now["measured"] * (now["blind"] > 0) * turn * ca.norm_2(ca.fmax(now["unsure"][3:, 0], now["unsure"][3:, 1]))
        least, most = least - ca.vertcat(0, 0, 0, area, area, area), most + ca.vertcat(0, 0, 0, area, area, area)
    # Where the comparison begins, the pose is as far off as it may be; how it was turned since then is known but for noise.
    at_begin = noise
    if "turned" in sizes:
        sent_to = ca.if_else(now["started"], turned(done[3:] + gone[3:], now["turned"]), now["pose"][:3, :3])
        apart[3:] = _rotation(sent_to, now["pose"][:3, :3])
        at_begin = ca.vertcat(noise[:3], 0, 0, 0)
        # The error of the pose at the begin turns with the object, so it may lie along any axis.
        noise = ca.vertcat(noise[:3], (1 + np.sqrt(3)) * noise[3:])
    below = above = ca.SX(6, 1)
    if owes(problem):
        below, above = below + stretch * now["down"], above + stretch * now["up"]
    if robot.longest_hold and owes(problem):
        hold = stretch * robot.longest_hold * ca.fmax(now["held"], ca.horzcat(now["sent"], -now["sent"]))
        below, above = below + hold[:, 0], above + hold[:, 1]
    if robot.gain_error:
        # A shift is along what was sent; what is left of a turn turns with the object.
        spread = robot.gain_error * ca.vertcat(ca.fabs(done[:3]), *[ca.norm_2(done[3:])] * 3)
        least, most = least - spread, most + spread
    unseen = _WIDE * (1 - now["measured"])
    low, high = apart - noise - below - unseen, apart + noise + above + unseen
    beyond = ca.fmax(ca.fmax(least, low) - ca.fmin(most, high), 0) * ca.DM(1 / UNIT)
    by_pose = ca.logic_and(ca.fmax(ca.sumsqr(beyond[:3]), ca.sumsqr(beyond[3:])) > 1, enabled)
    found = ca.logic_or(by_pose, ca.logic_or(now["signs"][0] > 1, now["signs"][1] > 0))
    # The difference counts anew from where the object comes to stand still, and from where it was seen to move there.
    comes_to_rest = ca.logic_and(parked, ca.logic_or(now["calm"] <= 0, found))
    anew = ca.logic_or(comes_to_rest, ca.logic_not(enabled))
    least = ca.if_else(anew, -(at_begin + below + unseen), ca.fmax(least, low))
    most = ca.if_else(anew, at_begin + above + unseen, ca.fmin(most, high))
    if "turned" in sizes:
        block["turned"] = ca.if_else(anew, now["pose"][:3, :3], sent_to)
    if robot.longest_hold and owes(problem):
        # What it held on to before it came to rest still counts in this comparison, and no more in the next one.
        block["held"] = ca.fmax(now["held"] * (1 - comes_to_rest), ca.horzcat(now["sent"], -now["sent"]))

    calm = ca.logic_and(parked, ca.logic_not(found)) * (now["calm"] + now["period"])
    over = calm >= CALM + robot.dead_time + 3 * robot.lag
    faulty = ca.logic_or(found, ca.logic_and(now["fault"][0] > 0.5, ca.logic_not(over)))
    halted = ca.logic_or(ca.logic_or(faulty, now["stop"]), ca.logic_and(now["halted"], ca.logic_not(parked)))
    rests = now["rests"] + anew
    block |= dict(zip(_COMPARED, (apart * (1 - anew), least, most, calm, halted, rests), strict=True))
    resting = ca.logic_and(halted, ca.logic_not(ca.logic_or(faulty, now["stop"])))
    causes = now["causes"] + 2.0**Cause.robot * faulty + 2.0**Cause.halted * resting
    outputs = ca.cse(dense([joined(sizes, block), faulty, causes, went, rests]))
    return ca.Function("compared_poses", list(given.values()), outputs, list(given), [f"o{i}" for i in range(len(outputs))])


def _explained(problem: Problem) -> ca.Function:
    """``(...) -> (story, said)``: what a reported twist shows, and the name of a fault, made anew at every step."""
    names = ("told", "faulty", "started", "measured", "went", "executed", "sent", "lasted", "slowest", "fastest", "up", "down")
    given = _symbols(problem, *names, "parked", "now_rests", "story", "said")
    told, faulty = given["told"] > 0.5, given["faulty"] > 0.5
    now = given | split(_STORY, given["story"]) | split(_SAID, given["said"])
    reported, signs = _reported(problem, now)
    signs = ca.if_else(told, signs, 0)
    kept = {name: now[name] for name in _REPORTED}
    if owes(problem):
        kept |= {name: ca.SX(*_REPORTED[name]) for name in ("drift", "blur", "path")}
        kept["due"] = ca.horzcat(now["up"], now["down"])
    told_now = ca.if_else(told, joined(_REPORTED, reported), joined(_REPORTED, kept))
    named = _named(problem, now, signs[1])
    fault = ca.if_else(faulty, named.pop("fault"), 0)
    story = ca.vertcat(told_now, joined(_NAMED, named))
    outputs = ca.cse(dense([story, ca.vertcat(signs, fault)]))
    return ca.Function("explained", list(given.values()), outputs, list(given), ["next_story", "next_said"])


def _reported(problem: Problem, now: Mapping[str, ca.SX]) -> tuple[dict[str, ca.SX], ca.SX]:
    """Compare the integral of the reported twist with what was sent: what to keep of it, and the signs of a fault."""
    gain, unit = problem.robot.gain_error, ca.DM(UNIT)
    sent, lasted = now["sent"], now["lasted"] * now["started"]
    fresh = now["now_rests"] > now["rested"]
    keeps = ca.if_else(now["parked"] > 0.5, ca.fmax(0, 1 - now["lasted"] / _FORGETS), 1)
    surprise = now["executed"] - sent
    # Noise scatters around what was sent, what is wrong goes on: so only the change from sample to sample counts as noise.
    credible = ca.DM(0.5 * np.repeat([problem.twist_limit.linear_speed, problem.twist_limit.angular_speed], 3))
    scatter = ca.fmin(ca.fabs(surprise - now["surprise"]), credible) * lasted
    gone = ca.vertcat(ca.norm_2(sent[:3]), ca.norm_2(sent[3:])) * lasted
    summed = {"drift": surprise * lasted, "blur": scatter**2 / 2, "path": gone}
    # Standing still everything counts anew, but what a late robot still owes then.
    drift, blur, path = (ca.if_else(fresh, 0, keeps * now[name] + part) for name, part in summed.items())
    due = ca.if_else(fresh, ca.horzcat(now["up"], now["down"]), now["due"])
    # A twist may be reported as it is at the end of the period, and not as its mean: an integral of samples is off by half
    # a period.
    slack = _CERTAIN * ca.sqrt(blur) + problem.dt / 2 * ca.fabs(sent)
    slack += gain * ca.vertcat(*[path[0]] * 3, *[path[1]] * 3)
    stretch = 1 + gain
    late = ca.fmax(drift - stretch * (now["down"] + due[:, 0]), -drift - stretch * (now["up"] + due[:, 1]))
    by_twist = _size((late - slack) / unit)
    if owes(problem):
        # What it is sent does not say yet how fast it is, only how fast it can be.
        surprise = _leap(now, now["executed"] * lasted) / ca.fmax(lasted, 1e-9)
    strikes = _size((ca.fabs(surprise) * lasted - slack) / unit) > 1
    strike = ca.if_else(strikes, ca.norm_2(surprise), 0)
    kept = {"drift": drift, "path": path, "blur": blur, "surprise": now["executed"] - sent, "due": due}
    return kept | {"rested": now["now_rests"]}, ca.vertcat(by_twist, strike)


def _named(problem: Problem, now: Mapping[str, ca.SX], strike: ca.SX) -> dict[str, ca.SX]:
    """The name of the fault that fits best to what moved since it is there."""
    sent, lasted, forget = now["sent"], now["lasted"] * now["started"], ca.fmax(0, 1 - now["lasted"] / _MEMORY)
    done, told = sent * lasted, now["executed"] * lasted
    seen = ca.if_else(now["measured"] > 0.5, now["went"], ca.if_else(now["told"] > 0.5, told, done))
    changed = ca.if_else(now["fault"][0] > 0.5, sent - now["last"], 0)
    # What there was to name before this fault is over.
    goes_on = forget * (now["fault"][0] > 0.5)
    moved = goes_on * now["moved"] + ca.horzcat(done, seen, changed)
    Y, y, s = ca.horzsplit(moved / ca.repmat(ca.DM(UNIT / UNIT[0]), 1, 3))
    products = ca.vertcat(ca.dot(Y, Y), ca.dot(Y, s), ca.dot(s, s), ca.dot(Y, y), ca.dot(s, y))
    fit = goes_on * now["fit"] + products
    leap = _leap(now, now["went"])
    shift, turn = ca.vertcat(int(Fault.pose_jumps), ca.norm_2(leap[:3])), ca.vertcat(int(Fault.pose_turns), ca.norm_2(leap[3:]))
    far = (ca.fabs(leap) - 2 * ca.DM(problem.robot.noise)) / ca.DM(UNIT)
    jumps = ca.logic_and(ca.logic_and(now["measured"], now["started"]), _size(far) > 1)
    # What was sudden keeps its name, and what a second sudden thing adds is only its coming back.
    sudden = now["fault"][0] >= int(Fault.pose_jumps)
    fault = ca.if_else(strike > 0, ca.vertcat(int(Fault.speed_jumps), strike), fault_of(fit, Y, y))
    fault = ca.if_else(jumps, ca.if_else(largest(far[:3]) >= largest(far[3:]), shift, turn), fault)
    fault = ca.if_else(sudden, now["fault"], fault)
    return {"moved": moved, "last": sent, "fit": fit, "fault": fault}


def _leap(now: Mapping[str, ca.SX], went: ca.SX) -> ca.SX:
    """By how much (6,) the pose moved beyond what the robot can have done in this period, whatever it still owed."""
    lasted = now["lasted"] * now["started"]
    return ca.fmax(went - now["fastest"] * lasted, 0) + ca.fmin(went - now["slowest"] * lasted, 0)


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


def _size(excess: ca.SX) -> ca.SX:
    """The larger of the lengths of the two halves of a vector (6,), of which only what is positive counts."""
    beyond = ca.fmax(excess, 0)
    return ca.sqrt(ca.fmax(ca.sumsqr(beyond[:3]), ca.sumsqr(beyond[3:])))


def _held(problem: Problem, leap: ca.SX, reach: ca.SX) -> ca.SX:
    """How much of a leap (6,) one declared hold explains, of at most `reach` (6, 2); what may be noise is none."""
    most = problem.robot.longest_hold * (1 + problem.robot.gain_error) * ca.fmax(reach, 0)
    explained = ca.fmax(ca.fmin(leap, most[:, 0]), -most[:, 1])
    stands_out = _size((ca.fabs(leap) - 2 * ca.DM(problem.robot.noise)) / ca.DM(UNIT)) > 1
    return ca.if_else(stands_out, explained, 0)
