"""What lies between the plan and the object: the mean that is sent, what a declared robot has not done of it, where it lands.

The limits are kept by the planned ("virtual") twist u, a line from period to period, which nothing that is measured ever changes.
Sent is the mean of u over the last W seconds, at the end of the period that it is sent for: every convex limit holds for a mean
too, its acceleration is at most that of u, and its jerk (u'(t) - u'(t - W)) / W at most 2 a / W.

A measured pose shows the object as it was `dead_time` seconds ago, and a robot that lags has not done all of what it was sent
before that. Of a twist sent at age x, the share exp(-max(x - dead_time, 0) / lag) is still to come, so the object lands at the
measured pose moved by all of these, and by what the mean still holds of u.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import casadi as ca
import numpy as np

from ergoqp.limits import UnderWay
from ergoqp.rigid import exp_rotation

if TYPE_CHECKING:
    from ergoqp.problem import Problem

FAR: Final = 1e3
"""Age of what was before the first step: older than anything counts [s]."""

_SPARE: Final = 2
"""The history holds its seconds at periods of this fraction of the problem's, on average."""


@dataclass(frozen=True)
class History:
    """How much of the past the step keeps.

    Attributes:
        planned: how many planned twists, newest first.
        sent: how many sent ones.
    """

    planned: int
    sent: int

    @classmethod
    def of(cls, problem: Problem) -> History:
        """Return what the mean and the declared robot of a problem need."""

        def periods(seconds: float) -> int:
            return int(np.ceil(_SPARE * seconds / problem.dt)) + 1 if seconds else 0

        return cls(1 + periods(problem.average), 1 + periods(problem.robot.dead_time))

    @property
    def ages(self) -> int:
        """How many ends of periods, the present one not counted."""
        return max(self.planned - 1, self.sent)


def history_sizes(problem: Problem) -> dict[str, tuple[int, int]]:
    """Return the shape of every part of the state that is history; see `initial_history`."""
    history = History.of(problem)
    sizes = {"planned": (6, history.planned), "sent": (6, history.sent), "ages": (history.ages, 1)}
    if problem.robot.lag:
        sizes["tail"] = (6, 2)
    return sizes | ({"owed": (6, 1)} if _late(problem) else {})


def _late(problem: Problem) -> bool:
    """Whether the declared robot leaves anything of what was sent for later."""
    return bool(problem.robot.dead_time or problem.robot.lag)


def way_size(problem: Problem) -> int:
    """Return how many numbers `under_way_of` reads."""
    history = History.of(problem)
    pieces = (history.planned if problem.average else 0) + (history.sent if _late(problem) else 0)
    return 6 + 7 * pieces + (12 if problem.robot.lag else 0) + (1 if _late(problem) else 0)


def under_way_of(problem: Problem, way: Any) -> UnderWay:
    """Return what is under way from its numbers, the output ``way`` of `way_function`."""
    kind, history, robot = type(way), History.of(problem), problem.robot
    pieces = (history.planned if problem.average else 0) + (history.sent if _late(problem) else 0)
    ends = np.cumsum([6, 6 * pieces, pieces, 12 if robot.lag else 0, 1 if _late(problem) else 0]).tolist()
    total, twists, seconds, tail, turn = (way[start:end] for start, end in zip([0, *ends], ends, strict=False))
    return UnderWay(
        total,
        ca.reshape(twists, 6, pieces) if pieces else kind(6, 0),
        seconds,
        ca.reshape(tail, 6, 2) if robot.lag else None,
        turn if _late(problem) else None,
        robot.gain_error,
        robot.noise,
        robot.longest_hold,
    )


def way_function(problem: Problem) -> ca.Function:
    """Return ``(history parts, dt) -> (way, owed (6,), begun (6,), own, up (6,), down (6,))``.

    ``way`` is what is under way, for `under_way_of`; ``owed`` the displacement of it that was sent. The twist that is sent with
    a planned one u is ``begun + own u``. ``up`` and ``down`` are the largest displacements along and against each axis that the
    robot may still owe.
    """
    history, W = History.of(problem), problem.average
    part = {name: ca.MX.sym(name, *size) for name, size in history_sizes(problem).items()}
    dt = ca.MX.sym("dt")
    ends = ca.vertcat(0, part["ages"])
    pieces, seconds = [], []
    begun, own = ca.MX(ca.DM.zeros(6)), ca.MX(1.0)
    if W:
        own, weights, left = _mean(ends[: history.planned], dt, W)
        begun = part["planned"] @ weights
        pieces, seconds = [part["planned"]], [left]
    ahead = up = down = ca.MX(ca.DM.zeros(6))
    total = part["planned"] @ seconds[0] if W else ahead
    tail = turn = None
    if _late(problem):
        dead, lag = problem.robot.dead_time, problem.robot.lag
        remaining = _remaining(ends[: history.sent], ends[1 : history.sent + 1], dead, lag)
        ahead = part["sent"] @ remaining
        up, down = (ca.fmax(way, 0) @ remaining for way in (part["sent"], -part["sent"]))
        turn = ca.sqrt(ca.sum1(part["sent"][3:, :] ** 2)) @ remaining
        if lag:
            tail = part["tail"]
            up, down = up + tail[:, 0], down + tail[:, 1]
            ahead += tail[:, 0] - tail[:, 1]
            turn += ca.norm_2(tail[3:, 0] + tail[3:, 1])
        total = total + ahead
        pieces, seconds = [*pieces, part["sent"]], [*seconds, remaining]
    way = ca.vertcat(
        total,
        *(ca.vec(ca.horzcat(*pieces)), ca.vertcat(*seconds)) if pieces else (),
        *(() if tail is None else (ca.vec(tail),)),
        *(() if turn is None else (turn,)),
    )
    outputs = [ca.densify(each) for each in (way, ahead, begun, own, up, down)]
    names = [*part, "dt"]
    return ca.Function("way", [*part.values(), dt], outputs, names, ["way", "owes", "begun", "own", "up", "down"])


def _mean(ages: ca.MX, dt: ca.MX, W: float) -> tuple[ca.MX, ca.MX, ca.MX]:
    """The mean of the plan over W seconds as weights of its twists.

    Returns:
        At the end of this period: weight of the new twist, and of those before (n,). And now: seconds for which each of them still
        acts when it is not yet sent (n,), the half of this period that leads away from the last one included.
    """
    n = ages.numel()
    near, far = _segments(ages + dt, W)
    # The last twist is taken to have been there for ever: before the first step the plan was at rest.
    rest = W - ca.fmin(ages[n - 1] + dt, W)
    first = ca.fmin(dt, W)
    own = first * (2 - first / dt) / (2 * W)
    before = ca.vertcat(first * (first / dt) / 2, ca.MX(ca.DM.zeros(n - 1)))
    weights = (before + ca.vertcat(near, 0) + ca.vertcat(0, far) + ca.vertcat(ca.DM.zeros(n - 1), rest)) / W

    start, end = ca.fmin(ages[:-1], W), ca.fmin(ages[1:], W)
    share = (end - start) / ca.fmax(ages[1:] - ages[:-1], 1e-9)
    now, then = 1 - start / W, 1 - end / W
    mixed = now + 2 * then
    later = (end - start) / 6 * share * mixed
    sooner = (end - start) / 6 * (2 * now + then + mixed) - later
    oldest = (W - ca.fmin(ages[n - 1], W)) ** 2 / (2 * W)
    ahead = ca.vertcat(dt / 2, ca.DM.zeros(n - 1)) + ca.vertcat(sooner, oldest) + ca.vertcat(0, later)
    return own, weights, ahead


def _segments(ages: ca.MX, W: float) -> tuple[ca.MX, ca.MX]:
    """Integral of a line over the part of each segment that is younger than W, as weights of its younger and older end."""
    start, end = ca.fmin(ages[:-1], W), ca.fmin(ages[1:], W)
    length = end - start
    share = length / ca.fmax(ages[1:] - ages[:-1], 1e-9)
    return length * (2 - share) / 2, length * share / 2


def _remaining(younger: Any, older: Any, dead: float, lag: float) -> Any:
    """Seconds for which twists sent between two ages still act."""
    seconds = ca.fmin(older, dead) - ca.fmin(younger, dead)
    if lag:
        seconds += lag * (ca.exp(-ca.fmax(younger - dead, 0) / lag) - ca.exp(-ca.fmax(older - dead, 0) / lag))
    return seconds


def next_history(problem: Problem, part: Mapping[str, Any], planned: Any, sent: Any, owed: Any, dt: Any) -> dict[str, Any]:
    """Return the history after a period `dt` [s] with a planned and a sent twist (6,).

    Args:
        problem: the task.
        part: the history before.
        planned: twist that was planned for the end of the period.
        sent: twist that was sent for it.
        owed: displacement (6,) of what was sent before and not done at its begin [m, rad].
        dt: period [s].
    """
    history, kind = History.of(problem), type(part["planned"])
    older = [part["ages"][: history.ages - 1] + dt] if history.ages > 1 else []
    ages = ca.vertcat(dt, *older)
    after = {
        "planned": ca.horzcat(planned, part["planned"][:, :-1]),
        "sent": ca.horzcat(sent, part["sent"][:, :-1]),
        "ages": ca.fmin(ages, FAR),
    }
    if lag := problem.robot.lag:
        # The oldest leaves the history; what it has still to do goes on fading.
        gone, ends = part["sent"][:, -1], ca.vertcat(0, part["ages"])
        m = history.sent
        seconds = _remaining(ends[m - 1] + dt, ends[m] + dt, problem.robot.dead_time, lag)
        fades = ca.exp(-dt / lag) * part["tail"]
        after["tail"] = fades + seconds * ca.horzcat(ca.fmax(gone, 0), ca.fmax(-gone, 0))
    if _late(problem):
        after["owed"] = owed
    return {name: ca.densify(kind(value)) for name, value in after.items()}


def holds_all(problem: Problem, ages: Any, dt: Any) -> Any:
    """Return whether the history still reaches far enough back after a period `dt` [s]: it does not if periods are too short."""
    history = History.of(problem)
    needed = [(history.planned - 3, problem.average), (history.sent - 2, problem.robot.dead_time)]
    enough = [ages[last] + dt >= seconds for last, seconds in needed if seconds]
    found = type(ages)(1)
    for one in enough:
        found = ca.logic_and(found, one)
    return found


def landed(pose: Any, way: Any) -> Any:
    """Return where the object lands: its pose (4, 4) moved by what is under way."""
    return exp_rotation(pose, way[:6])


def initial_history(problem: Problem, twist: np.ndarray) -> dict[str, np.ndarray]:
    """Return the history of an object that has moved at `twist` (6,) for ever."""
    parts = {name: np.zeros(size) for name, size in history_sizes(problem).items()}
    parts["planned"][:], parts["sent"][:], parts["ages"][:] = twist[:, None], twist[:, None], FAR
    return parts
