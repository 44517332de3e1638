"""The motion between the plan and the object: averaging, declared delay and lag.

The planned twist u keeps the limits. It is linear in time from period to period, and no measurement
changes it. The step sends the mean of u over the last W seconds, at the end of the period that it
is sent for. A mean keeps every convex limit too. Its acceleration is at most that of u, and its
jerk (u'(t) - u'(t - W)) / W is at most 2 a / W.

A measured pose shows the object as it was `dead_time` seconds ago, and a robot that lags has not
done all of what it was sent before that. Of a twist sent at age x, the share exp(-max(x -
dead_time, 0) / lag) is still to come. So the landing pose is the measured pose moved by all of
these shares, and by the part of u that the mean has not sent yet.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ergoqp.expressions.linear import Shape, by_name, dense, vectors, written_out
from ergoqp.step.model import StepModel
from ergoqp.step.packing import count, split
from ergoqp.step.under_way.ages import weights_function
from ergoqp.step.under_way.history import remaining_seconds


@dataclass(frozen=True)
class UnderWay:
    """The motion of the object from its measured pose to the landing pose.

    The object comes to rest there if the planned twist is zero from now on.

    Attributes:
        total: displacement (6,) [m, rad].
        twists: the pieces of the motion under way (6, k).
        seconds: for how long each piece still acts (k,) [s].
        weights: weights of the planned twists in the mean, which are the first pieces (n,). None:
            every twist is sent as planned.
        tail: part of what is older than the pieces, positive and negative (6, 2) [m, rad]. None:
            zero.
        clung: what a lagging robot may still have to do of one hold of older twists, along each
            axis and against it (6, 2) [m, rad]. None: zero.
        turn: largest angle of the part that the robot may have done already [rad]. None: zero.
        owed: displacement of the part that was sent (6,) [m, rad].
        up: largest displacement that the robot may still do along each axis (6,) [m, rad].
        down: the same against each axis (6,) [m, rad].
        previous: twist that was planned last (6,).
        sent: twist that was sent last (6,).
        lasted: how long it was sent [s].
        changed: decrease of `owed` since a period ago (6,) [m, rad].
        slowest: smallest twist (6,) in the last period of a robot that does no more than it was
            sent.
        fastest: its largest twist (6,).
        swift: its largest possible speed now, along each axis and against it (6, 2). None: that of
            the sent twists.
        dt: period [s].
        dt_ok: whether the given period was usable.
        aged: ages of the ends of the earlier periods at the end of this one, as many as are kept
            (k,) [s].
        idled: how long everything will have stood still then, if it does [s].
        begun: part of the sent twist that does not depend on the new plan (6,).
        own: share of the new planned twist in the sent twist.
        fits: whether the history is still long enough after the period. It is not if periods are
            too short.
        parked: whether only zeros were planned and sent for at least W and the dead time.
    """

    total: ca.MX
    twists: ca.MX
    seconds: ca.MX
    weights: ca.MX | None
    tail: ca.MX | None
    clung: ca.MX | None
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

    @property
    def parts(self) -> dict[str, ca.MX]:
        """All parts that are not None, by name."""
        return {name: part for name, part in vars(self).items() if part is not None}


def under_way(model: StepModel, history: ca.MX, dt: ca.MX, shape: Shape = vectors) -> UnderWay:
    """Return the motion under way at the start of a period.

    Args:
        model: model of the step.
        history: the history as one vector of `History.sizes`.
        dt: given period; if it is not usable, that of the problem is used [s].
        shape: how functions are written, see `ergoqp.expressions.linear`.
    """
    sizes = model.history.sizes
    symbols = ca.MX.sym("history", count(sizes)), ca.MX.sym("dt")
    parts = _under_way(model, split(sizes, symbols[0]), symbols[1]).parts
    outputs = [ca.densify(part) for part in parts.values()]
    found = written_out(shape(ca.Function("under_way", symbols, outputs)), history, dt)
    every: dict[str, Any] = dict.fromkeys(UnderWay.__dataclass_fields__)
    return UnderWay(**{**every, **dict(zip(parts, found, strict=True))})


def _under_way(model: StepModel, part: Mapping[str, ca.MX], dt: ca.MX) -> UnderWay:
    W, robot, lag = model.problem.average, model.problem.robot, model.problem.robot.lag
    by_ages = by_name(weights_function(model), {**part, "dt": dt})
    of_plan, remaining = by_ages["of_plan"], by_ages["remaining"]
    pieces, seconds = [], []
    begun = owed = up = down = total = ca.MX(ca.DM.zeros(6))
    if W:
        sums = part["planned"] @ of_plan
        begun, total = sums[:, 0], sums[:, 1]
        pieces, seconds = [part["planned"]], [of_plan[:, 1]]
    tail = turn = swift = None
    if robot.owes:
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
        fastest, slowest = (
            ca.fmax(fastest, part["swift"][:, 0]),
            ca.fmin(slowest, -part["swift"][:, 1]),
        )
    stretch = 1 + robot.gain_error
    return UnderWay(
        total=total,
        twists=ca.horzcat(*pieces) if pieces else ca.MX(6, 0),
        seconds=ca.vertcat(*seconds) if seconds else ca.MX(0, 1),
        weights=by_ages["present"] if W else None,
        tail=tail,
        clung=part.get("clung"),
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
        dt=by_ages["period"],
        dt_ok=by_ages["dt_ok"],
        aged=by_ages["aged"],
        idled=by_ages["idled"],
        begun=begun,
        own=by_ages["own"],
        fits=by_ages["fits"],
        parked=by_ages["parked"],
    )


def _extremes(twists: ca.MX) -> tuple[ca.MX, ca.MX]:
    """Return the smallest and the largest entry of each row, zero included."""
    given = ca.SX.sym("twists", *twists.shape)
    low = high = ca.SX(twists.shape[0], 1)
    for twist in ca.horzsplit(given):
        low, high = ca.fmin(low, twist), ca.fmax(high, twist)
    low, high = ca.Function("extremes", [given], dense([low, high])).call([twists])
    return low, high


def next_history(
    model: StepModel, history: ca.MX, found: UnderWay, planned: ca.MX, sent: ca.MX, still: ca.MX
) -> list[ca.MX]:
    """Return the history after a period, as pieces to be stacked.

    Args:
        model: model of the step.
        history: the history before, as one vector of `History.sizes`.
        found: the motion under way at the start of the period.
        planned: twist that was planned for the end of the period (6,).
        sent: twist that was sent for it (6,).
        still: 1 if both are zero.
    """
    kept, robot = model.history, model.problem.robot
    first = 6 * kept.planned
    after = [planned, history[: first - 6], sent, history[first : first + 6 * kept.sent - 6]]
    after += [found.dt, *([found.aged] if kept.ages > 1 else []), still * found.idled]
    if lag := robot.lag:
        dt = found.dt
        # The oldest twist leaves the history; what is still to come of it goes on decaying.
        part = split(kept.sizes, history)
        gone, ends = part["sent"][:, -1], ca.vertcat(0, part["ages"])
        seconds = remaining_seconds(
            ends[kept.sent - 1] + dt, ends[kept.sent] + dt, robot.dead_time, lag
        )
        fades = ca.exp(-dt / lag) * part["tail"]
        after.append(ca.vec(fades + seconds * ca.horzcat(ca.fmax(gone, 0), ca.fmax(-gone, 0))))
        assert found.swift is not None
        after.append(ca.vec(found.swift))
        if hold := robot.longest_hold:
            # What a hold of the oldest leaves decays as slowly, and there is only one hold.
            left = lag * (1 - np.exp(-hold / lag)) * ca.horzcat(ca.fmax(gone, 0), ca.fmax(-gone, 0))
            after.append(ca.vec(ca.fmax(ca.exp(-dt / lag) * part["clung"], left)))
    return [*after, found.owed] if robot.owes else after
