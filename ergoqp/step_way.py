"""What lies between the plan and the object: the mean that is sent, what a declared robot has not done of it, where it lands.

The limits are kept by the planned ("virtual") twist u, a line from period to period, which nothing that is measured ever
changes. Sent is the mean of u over the last W seconds, at the end of the period that it is sent for: every convex limit
holds for a mean too, its acceleration is at most that of u, and its jerk (u'(t) - u'(t - W)) / W at most 2 a / W.

A measured pose shows the object as it was `dead_time` seconds ago, and a robot that lags has not done all of what it was sent
before that. Of a twist sent at age x, the share exp(-max(x - dead_time, 0) / lag) is still to come, so the object lands at the
measured pose moved by all of these, and by what the mean still holds of u.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import casadi as ca
import numpy as np

from ergoqp.errors import ProblemError
from ergoqp.limits import Situation
from ergoqp.linear import Shape, dense, vectors, written_out
from ergoqp.rigid import shifted
from ergoqp.step_history import LONGEST_DT, SHORTEST_DT, History, history_sizes, owes, remaining_seconds
from ergoqp.step_parts import count, split
from ergoqp.step_stop import Stop

if TYPE_CHECKING:
    from ergoqp.problem import Problem

_SLIGHT: Final = 0.1
"""Sine of the least angle at which the slope of a bent row is known."""

_AT_ALL: Final = 1e-9
"""What has stood still for less has not stood still [s]."""


def _counts(problem: Problem) -> int:
    """How many hard rows have less than their distance to count on."""
    robot = problem.robot
    uncounted = problem.average or owes(problem) or robot.noise.any() or robot.longest_hold
    return len(hard_names(problem)) if uncounted else 0


def hard_names(problem: Problem) -> tuple[str, ...]:
    """Return the names of the rows on the object side."""
    return tuple(name for limit in problem.row_limits if limit.hard for name in limit.names)


def way_size(problem: Problem) -> int:
    """Return how many numbers say what is under way: see `split_way`."""
    return sum(_sizes(problem))


def _sizes(problem: Problem) -> list[int]:
    """Sizes of the parts of that vector, in the order of `Way`."""
    count, held = _counts(problem), problem.robot.longest_hold > 0
    if not count:
        return [6]
    return [6, count, count, *([1] if _turns(problem) else []), *([count, count, 1] if held else [])]


def _turns(problem: Problem) -> bool:
    """Whether the object may be turned otherwise than it lands."""
    return owes(problem) or bool(problem.robot.pose_noise_deg)


@dataclass(frozen=True)
class Way:
    """What is under way, for `ergoqp.limits.Situation`.

    Attributes:
        ahead: displacement (6,) [m, rad].
        lost: what cannot be counted on of the distance to the (lower, upper) ends, by hard limit.
        turn: angle that a robot may have done already, and by which its pose may be mistaken [rad]; None: there is none.
        lost_held: as `lost`, where the robot holds on once with what is under way, if that is declared.
        turn_held: and as `turn`.
    """

    ahead: Any
    lost: dict[str, tuple[Any, Any]]
    turn: Any
    lost_held: dict[str, tuple[Any, Any]]
    turn_held: Any


def split_way(problem: Problem, way: Any) -> Way:
    """Return what is under way from the vector that `way_of` makes of it."""
    ends = np.cumsum([0, *_sizes(problem)]).tolist()
    ahead, *parts = (way[start:end] for start, end in pairwise(ends))
    if not parts:
        return Way(ahead, {}, None, {}, None)
    lost, turn = _by_limit(problem, *parts[:2]), parts[2] if _turns(problem) else None
    if not problem.robot.longest_hold:
        return Way(ahead, lost, turn, lost, turn)
    return Way(ahead, lost, turn, _by_limit(problem, *parts[-3:-1]), parts[-1])


def _by_limit(problem: Problem, below: Any, above: Any) -> dict[str, tuple[Any, Any]]:
    found, start = {}, 0
    for limit in problem.row_limits:
        if limit.hard:
            end = start + len(limit.names)
            found[limit.names[0]] = below[start:end], above[start:end]
            start = end
    return found


@dataclass(frozen=True)
class UnderWay:
    """The object's motion between where it was measured and where it comes to rest if the planned twist were zero from now on.

    Attributes:
        total: displacement (6,) [m, rad].
        twists: what is under way, piece by piece (6, k).
        seconds: for how long each piece still acts (k,) [s].
        weights: of the planned ones, the first of them, in the mean (n,); None: every twist is sent as planned.
        tail: of what is older than the pieces: positive and negative parts (6, 2) [m, rad]; None: nothing is.
        turn: largest angle of the part that a robot may have done already [rad]; None: there is none.
        owed: displacement of the part that was sent (6,) [m, rad].
        up: the most that the robot may still move along each axis (6,) [m, rad].
        down: and against it (6,) [m, rad].
        previous: twist that was planned last (6,).
        sent: and the one that was sent (6,).
        lasted: for how long [s].
        changed: displacement by which less is owed than a period ago (6,) [m, rad].
        slowest: least twist (6,) in the last period of a robot that does no more than it was sent.
        fastest: its greatest (6,).
        swift: how fast it can be now, along each axis and against it (6, 2); None: as fast as it was sent.
        dt: period [s].
        dt_ok: whether that is what was given.
        aged: ages of the ends of the periods before, at the end of this one, as many as are kept (k,) [s].
        idled: for how long all will have stood still then, if it does [s].
        begun: twist that is sent however the plan goes on (6,).
        own: share of the planned twist that is sent beside it.
        fits: whether the history still reaches far enough back after the period: it does not if periods are too short.
        parked: whether nothing was planned and nothing sent for as long as the history reaches.
    """

    total: ca.MX
    twists: ca.MX
    seconds: ca.MX
    weights: ca.MX | None
    tail: ca.MX | None
    turn: ca.MX | None
    owed: ca.MX
    up: ca.MX
    down: ca.MX
    previous: ca.MX
    sent: ca.MX
    lasted: ca.MX
    changed: ca.MX
    slowest: ca.MX
    fastest: ca.MX
    swift: ca.MX | None
    dt: ca.MX
    dt_ok: ca.MX
    aged: ca.MX
    idled: ca.MX
    begun: ca.MX
    own: ca.MX
    fits: ca.MX
    parked: ca.MX


def under_way(problem: Problem, history: ca.MX, dt: ca.MX, shape: Shape = vectors) -> UnderWay:
    """Return what is under way at the begin of a period.

    Args:
        problem: the task.
        history: as one vector of `history_sizes`.
        dt: period as it was given; what is none is taken for the problem's [s].
        shape: how functions are written, see `ergoqp.linear`.
    """
    sizes = history_sizes(problem)
    symbols = ca.MX.sym("history", count(sizes)), ca.MX.sym("dt")
    parts = vars(_under_way(problem, split(sizes, symbols[0]), symbols[1]))
    present = [name for name, part in parts.items() if part is not None]
    function = ca.Function("under_way", symbols, [ca.densify(parts[name]) for name in present])
    found = written_out(shape(function), history, dt)
    return UnderWay(**(dict.fromkeys(parts) | dict(zip(present, found, strict=True))))  # pyright: ignore[reportArgumentType]


def _under_way(problem: Problem, part: Mapping[str, ca.MX], dt: ca.MX) -> UnderWay:
    W, robot, lag = problem.average, problem.robot, problem.robot.lag
    by_ages = _weights(problem)(part["ages"], part["idle"], dt)
    own, of_plan, now, remaining, period, dt_ok, aged, idled, fits, parked = by_ages
    pieces, seconds = [], []
    begun = owed = up = down = total = ca.MX(ca.DM.zeros(6))
    if W:
        sums = part["planned"] @ of_plan
        begun, total = sums[:, 0], sums[:, 1]
        pieces, seconds = [part["planned"]], [of_plan[:, 1]]
    tail = turn = swift = None
    if owes(problem):
        owed = part["sent"] @ remaining
        up, down = (ca.fmax(way, 0) @ remaining for way in (part["sent"], -part["sent"]))
        turn = ca.sqrt(ca.sum1(part["sent"][3:, :] ** 2)) @ remaining
        if lag:
            tail = part["tail"]
            up, down = up + tail[:, 0], down + tail[:, 1]
            owed += tail[:, 0] - tail[:, 1]
            turn += ca.norm_2(tail[3:, 0] + tail[3:, 1])
        total = total + owed
        pieces, seconds = [*pieces, part["sent"]], [*seconds, remaining]
    slowest, fastest = _extremes(part["sent"])
    if lag:
        swift = ca.horzcat(fastest, -slowest) + part["tail"] / lag
        fastest, slowest = ca.fmax(fastest, part["swift"][:, 0]), ca.fmin(slowest, -part["swift"][:, 1])
    stretch = 1 + robot.gain_error
    return UnderWay(
        total=total,
        twists=ca.horzcat(*pieces) if pieces else ca.MX(6, 0),
        seconds=ca.vertcat(*seconds) if seconds else ca.MX(0, 1),
        weights=now if W else None,
        tail=tail,
        turn=turn,
        owed=owed,
        up=up,
        down=down,
        previous=part["planned"][:, 0],
        sent=part["sent"][:, 0],
        lasted=part["ages"][0],
        changed=part["owed"] - owed if "owed" in part else owed,
        slowest=stretch * slowest,
        fastest=stretch * fastest,
        swift=swift,
        dt=period,
        dt_ok=dt_ok,
        aged=aged,
        idled=idled,
        begun=begun,
        own=own,
        fits=fits,
        parked=parked,
    )


def _weights(problem: Problem) -> ca.Function:
    """What follows from the ages alone, in scalars.

    Returns:
        Function ``(ages, idle, dt) -> (own, (weights at the end of this period, seconds) (n, 2), weights now (n,), seconds for
        which what was sent still acts (k,), dt, dt_ok, ages at the end of this period, idled, fits, parked)``.
    """
    history, W, robot = History.of(problem), problem.average, problem.robot
    ages, idle, given = ca.SX.sym("ages", history.ages), ca.SX.sym("idle"), ca.SX.sym("dt")
    dt_ok = ca.logic_and(given >= SHORTEST_DT, given <= LONGEST_DT)
    dt = ca.if_else(dt_ok, given, problem.dt)
    ends, n = ca.vertcat(0, ages), history.planned
    own, of_plan, now, remaining = ca.SX(1), ca.SX(n, 2), ca.SX(n, 1), ca.SX(history.sent, 1)
    if W:
        own, weights, now, left = _mean(ends[:n], dt, W)
        of_plan = ca.horzcat(weights, left)
    if owes(problem):
        remaining = remaining_seconds(ends[: history.sent], ends[1 : history.sent + 1], robot.dead_time, robot.lag)
    parked = idle >= max(W, robot.dead_time, _AT_ALL)
    outputs = [own, of_plan, now, remaining, dt, dt_ok, (ages + dt)[: history.ages - 1], idle + dt]
    outputs += [_holds_all(problem, ages, dt), parked]
    return ca.Function("weights", [ages, idle, given], ca.cse(dense(outputs)))


def _extremes(twists: ca.MX) -> tuple[ca.MX, ca.MX]:
    """Return the least and the greatest entry of each row, of them and zero."""
    given = ca.SX.sym("twists", *twists.shape)
    low = high = ca.SX(twists.shape[0], 1)
    for twist in ca.horzsplit(given):
        low, high = ca.fmin(low, twist), ca.fmax(high, twist)
    low, high = ca.Function("extremes", [given], dense([low, high])).call([twists])
    return low, high


def way_of(problem: Problem, found: UnderWay, pose: ca.MX, shape: Shape = vectors) -> tuple[ca.MX, ca.MX]:
    """Return (where the object lands (4, 4), what is under way as numbers, see `split_way`).

    A robot is declared by its upper ends: any share of each piece may be done already. So a piece that leads away from an
    end is not counted on, and one that leads to it counts in full.

    Args:
        problem: the task.
        found: what is under way.
        pose: as measured, or as far as it is known (4, 4).
        shape: how functions are written, see `ergoqp.linear`.
    """
    if not _counts(problem):
        return pose, found.total
    given = {name: part for name, part in vars(found).items() if name in _PARTS and part is not None}
    symbols = {name: ca.MX.sym(name, part.sparsity()) for name, part in given.items()}
    at = ca.MX.sym("pose", 4, 4)
    function = ca.Function("way", [at, *symbols.values()], _counted(problem, at, symbols))
    landed, way = written_out(shape(function), pose, *given.values())
    return landed, way


_PARTS: Final = ("total", "twists", "seconds", "weights", "tail", "turn")


def _counted(problem: Problem, pose: ca.MX, found: Mapping[str, ca.MX]) -> list[ca.MX]:
    robot = problem.robot
    landed, rows = _hard_rows(problem)(pose, found["total"])
    done = rows @ found["twists"]
    # Of each piece, what leads to the upper ends, and to the lower ones.
    toward = ca.fmax(done, 0)
    toward = ca.vertcat(toward, toward - done)
    sums, many = toward @ found["seconds"], rows.shape[0]
    if "tail" in found:
        tail, ahead, back = found["tail"], ca.fmax(rows, 0), ca.fmax(-rows, 0)
        sums += ca.vertcat(ahead @ tail[:, 0] + back @ tail[:, 1], ahead @ tail[:, 1] + back @ tail[:, 0])
    # A piece that leads to one end is not counted on at the other.
    up, down = sums[:many], sums[many:]
    below, above = up, down
    if "weights" in found:
        # What a mean that still rises toward the last planned twist adds, see `ergoqp.step_stop.Stop`.
        n = found["weights"].numel()
        rise = ca.fmax(ca.repmat(toward[:, 0], 1, n) - toward[:, :n], 0) @ (Stop.of(problem).longest * found["weights"])
        below, above = below + rise[many:], above + rise[:many] + ca.DM(_bent_rise(problem))
    if robot.gain_error:
        below, above = below + robot.gain_error * down, above + robot.gain_error * up
    if robot.noise.any():
        aside = ca.fabs(rows) @ ca.DM(robot.noise)
        below, above = below + aside, above + aside
    parts = [found["total"], below, above]
    # A turn that is measured with an error is one that may have been done, or not.
    turn = found.get("turn", 0) + ca.MX(np.linalg.norm(robot.noise[3:]))
    if _turns(problem):
        parts.append(turn)
    if robot.longest_hold:
        hold = robot.longest_hold * (1 + robot.gain_error)
        angles = ca.sqrt(ca.sum1(found["twists"][3:, :] ** 2))
        parts += [below + hold * _most(-done), above + hold * _most(done), turn + hold * _most(angles)]
    return [landed, ca.densify(ca.vertcat(*parts))]


def _bent_rise(problem: Problem) -> list[float]:
    """By how much more than along its slope a mean that rises can lead to the end of each hard row that bends, at most."""
    law = Stop.of(problem)
    turn = law.longest * law.average / 2 * float(np.linalg.norm(law.limit.acceleration[3:]))
    hard = (limit for limit in problem.row_limits if limit.hard)
    return [turn**2 / (2 * _SLIGHT) * bool(getattr(limit, "bend", 0.0)) for limit in hard for _ in limit.names]


def _most(values: ca.MX) -> ca.MX:
    """The largest positive entry of each row."""
    most = ca.MX(ca.DM.zeros(values.shape[0]))
    for column in ca.horzsplit(values):
        most = ca.fmax(most, column)
    return most


def _hard_rows(problem: Problem) -> ca.Function:
    """``(pose, displacement under way (6,)) -> (where it lands, matrices of the hard rows there (h, 6))``."""
    n = len(problem.coordinates)
    pose, total = ca.SX.sym("pose", 4, 4), ca.SX.sym("total", 6)
    posture, S = ca.SX.sym("posture", n), ca.SX.sym("S", n, 6)
    landed = shifted(pose, total)
    situation = Situation(posture, ca.SX.ones(n), landed, S, ca.SX(6, 1), ca.SX(6, 1), surface=problem.surface)
    rows = ca.densify(ca.vertcat(*(limit.rows(situation).matrix for limit in problem.row_limits if limit.hard)))
    if ca.depends_on(rows, ca.vertcat(posture, ca.vec(S))):
        names = ", ".join(hard_names(problem))
        raise ProblemError(f"limits: got a hard row among {names} that follows the posture, allowed rows of the object only")
    return ca.Function("hard_rows", [pose, total], [ca.densify(landed), rows])


def _mean(ages: ca.SX, dt: ca.SX, W: float) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """The mean of the plan over W seconds as weights of its twists.

    Returns:
        At the end of this period: weight of the new twist, and of those before (n,). And now: their weights (n,), and the
        seconds for which each of them still acts when it is not yet sent (n,), the half of this period that leads away from
        the last one included.
    """
    n = ages.numel()
    length, share = _segments(ages + dt, W)
    far = length * share / 2
    # The last twist is taken to have been there for ever: before the first step the plan was at rest.
    rest = W - ca.fmin(ages[n - 1] + dt, W)
    first = ca.fmin(dt, W)
    own = first * (2 - first / dt) / (2 * W)
    before = ca.vertcat(first * (first / dt) / 2, ca.SX(n - 1, 1))
    weights = (before + ca.vertcat(length - far, rest) + ca.vertcat(0, far)) / W

    length, share = _segments(ages, W)
    far, before = length * share / 2, W - ca.fmin(ages[n - 1], W)
    present = (ca.vertcat(length - far, before) + ca.vertcat(0, far)) / W
    left = 1 - ca.fmin(ages, W) / W
    now, then, sixth = left[:-1], left[1:], length / 6
    later = sixth * share * (now + 2 * then)
    sooner = 3 * sixth * (now + then) - later
    oldest = before**2 / (2 * W)
    ahead = ca.vertcat(dt / 2, ca.SX(n - 1, 1)) + ca.vertcat(sooner, oldest) + ca.vertcat(0, later)
    return own, weights, present, ahead


def _segments(ages: ca.SX, W: float) -> tuple[ca.SX, ca.SX]:
    """Return how much of each segment between two ages is younger than W [s], and as a share of it."""
    ends = ca.fmin(ages, W)
    length = ends[1:] - ends[:-1]
    # Segments of before the first step have no length at all.
    return length, length / (ages[1:] - ages[:-1] + 1e-30)


def _holds_all(problem: Problem, ages: ca.SX, dt: ca.SX) -> ca.SX:
    history = History.of(problem)
    needed = [(history.planned - 3, problem.average), (history.sent - 2, problem.robot.dead_time)]
    found = ca.SX(1)
    for last, seconds in needed:
        if seconds:
            found = ca.logic_and(found, ages[last] + dt >= seconds)
    return found
