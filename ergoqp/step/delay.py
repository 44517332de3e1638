"""The motion between the plan and the object: average, delay and lag, and the landing pose.

Weights of the moving average, and of what a late robot has still to do.

They follow from the ages of the periods alone.

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

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Final

import casadi as ca

from ergoqp.errors import ProblemError
from ergoqp.expressions import Shape, call_by_name, dense, shifted, vectors
from ergoqp.limits import Limit, LimitContext
from ergoqp.step.layout import AT_ALL, LONGEST_DT, SHORTEST_DT, remaining_seconds, split
from ergoqp.step.model import Signals, StepModel
from ergoqp.step.rows import limit_values

_BY_AGES: Final = ("period", "dt_ok", "aged", "idled", "own", "fits", "parked")
"""Parts of the motion under way that follow from the ages of the periods alone."""


def weights_function(model: StepModel) -> ca.Function:
    """Return the weights that follow from the ages alone, in scalars.

    Returns:
        Function ``(ages, idle, dt) -> (own, of_plan, present, remaining, period, dt_ok, aged,
        idled, fits, parked)``. `of_plan` (n, 2) holds the weights at the end of this period, and
        seconds. `present` (n,) holds the weights now. `remaining` (k,) holds the seconds for which
        each sent twist still acts. `aged` holds the ages at the end of this period.
    """
    problem, history = model.problem, model.history
    sx = model.symbols(("ages", "idle", "dt"))
    robot, stop = model.robot(sx), sx.of("stop")
    ages, idle, given = sx["ages"], sx["idle"], sx["dt"]
    dt_ok = ca.logic_and(given >= SHORTEST_DT, given <= LONGEST_DT)
    dt = ca.if_else(dt_ok, given, sx["task_dt"])
    ends, n = ca.vertcat(0, ages), history.planned
    # Without averaging there are no weights, and without delay or lag no remaining seconds.
    own, of_plan, now, remaining = ca.SX(1), ca.SX(), ca.SX(), ca.SX()
    if problem.average:
        own, weights, now, left = _mean(ends[:n], dt, stop.average)
        of_plan = ca.horzcat(weights, left)
    if problem.robot.owes:
        remaining = remaining_seconds(
            ends[: history.sent], ends[1 : history.sent + 1], robot.dead_time, robot.lag
        )
        remaining *= sx["history_sent"] if history.sent > 1 else 1
    parked = idle >= stop.parked
    outputs = [own, of_plan, now, remaining, dt, dt_ok, (ages + dt)[: history.ages - 1], idle + dt]
    outputs += [_holds_all(model, sx, dt), parked]
    names = ["own", "of_plan", "present", "remaining", "period", "dt_ok", "aged", "idled"]
    names += ["fits", "parked"]
    return sx.function("weights", dict(zip(names, outputs, strict=True)))


def _mean(ages: ca.SX, dt: ca.SX, W: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """Return the mean of the plan over W seconds as weights of its twists.

    Returns:
        At the end of this period: the weight of the new twist, and those of the earlier ones (n,).
        Now: their weights (n,), and the seconds for which each of them still acts because it is not
        sent yet (n,), including the half of this period in which the plan leaves the last one.
    """
    n = ages.numel()
    length, share = _segments(ages + dt, W)
    far = length * share / 2
    # The oldest twist counts as having lasted for ever: before the first step the plan was at rest.
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


def _segments(ages: ca.SX, W: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return the part of each segment between two ages below W [s], and its share."""
    ends = ca.fmin(ages, W)
    length = ends[1:] - ends[:-1]
    # Segments before the first step have zero length.
    return length, length / ca.fmax(ages[1:] - ages[:-1], AT_ALL)


def _holds_all(model: StepModel, sx: Signals, dt: ca.SX) -> ca.SX:
    """Return whether the entries that count are older than what they have to cover."""
    found, ages, ends = ca.SX(1), sx["ages"], sx["history_ends"]
    if model.problem.average:
        # A mean over a history that was too short a period ago has its jerk in this period.
        now, last = ends[0, :] @ ages, ends[1, :] @ ages + dt
        found = ca.logic_and(now >= sx["stop_average"], last >= sx["stop_average"])
    if model.problem.robot.dead_time:
        found = ca.logic_and(found, ends[2, :] @ ages + dt >= sx["robot_dead_time"])
    return found


def under_way(
    model: StepModel,
    history: ca.MX,
    dt: ca.MX,
    shape: Shape = vectors,
    known: Mapping[str, ca.MX] | None = None,
) -> dict[str, ca.MX]:
    """Return the motion of the object from its measured pose to the landing pose.

    The object comes to rest there if the planned twist is zero from now on. The parts are:

    - ``total``: displacement (6,) [m, rad].
    - ``twists``: the pieces of the motion under way (6, k).
    - ``seconds``: for how long each piece still acts (k,) [s].
    - ``weights``: weights of the planned twists in the mean, which are the first pieces (n,). Left
      out if every twist is sent as planned.
    - ``tail``: part of what is older than the pieces, positive and negative (6, 2) [m, rad]. Left
      out where it is zero.
    - ``clung``: what a lagging robot may still have to do of one hold of older twists, along each
      axis and against it (6, 2) [m, rad]. Left out where it is zero.
    - ``turn``: largest angle of the part that the robot may have done already [rad]. Left out where
      it is zero.
    - ``owed``: displacement of the part that was sent (6,) [m, rad].
    - ``up``: largest displacement that the robot may still do along each axis (6,) [m, rad].
    - ``down``: the same against each axis (6,) [m, rad].
    - ``previous``: twist that was planned last (6,).
    - ``sent``: twist that was sent last (6,).
    - ``lasted``: how long it was sent [s].
    - ``changed``: decrease of ``owed`` since a period ago (6,) [m, rad].
    - ``slowest``: smallest twist (6,) in the last period of a robot that does no more than it was
      sent.
    - ``fastest``: its largest twist (6,).
    - ``swift``: its largest possible speed now, along each axis and against it (6, 2). Left out if
      that is the speed of the sent twists.
    - ``period``: the period [s].
    - ``dt_ok``: whether the given period was usable.
    - ``aged``: ages of the ends of the earlier periods at the end of this one, as many as are kept
      (k,) [s].
    - ``idled``: how long everything will have stood still then, if it does [s].
    - ``begun``: part of the sent twist that does not depend on the new plan (6,).
    - ``own``: share of the new planned twist in the sent twist.
    - ``fits``: whether the history is still long enough after the period. It is not if periods are
      too short.
    - ``parked``: whether only zeros were planned and sent for at least W and the dead time.

    Args:
        model: model of the step.
        history: the history as one vector of `History.sizes`.
        dt: given period; if it is not usable, that of the problem is used [s].
        shape: how functions are written, see `ergoqp.expressions`.
        known: the constants of the model, if they are inputs.
    """
    mx = model.symbols(("history", "dt"), ca.MX)
    parts = _under_way(model, split(model.history.sizes, mx["history"]), mx)
    given = {**(known or {}), "history": history, "dt": dt}
    return call_by_name(shape(mx.function("under_way", parts)), given, written=True)


def _under_way(model: StepModel, part: Mapping[str, ca.MX], mx: Signals) -> dict[str, ca.MX]:
    robot, lag = model.problem.robot, model.problem.robot.lag
    weights = weights_function(model)
    by_ages = call_by_name(weights, mx, ages=part["ages"], idle=part["idle"])
    of_plan, remaining = by_ages["of_plan"], by_ages["remaining"]
    optional = {"clung": part["clung"]} if "clung" in part else {}
    pieces, seconds = [], []
    begun = owed = up = down = total = ca.MX(ca.DM.zeros(6))
    if model.problem.average:
        optional["weights"] = by_ages["present"]
        sums = part["planned"] @ of_plan
        begun, total = sums[:, 0], sums[:, 1]
        pieces, seconds = [part["planned"]], [of_plan[:, 1]]
    if robot.owes:
        owed = part["sent"] @ remaining
        up, down = (ca.fmax(way, 0) @ remaining for way in (part["sent"], -part["sent"]))
        optional["turn"] = ca.sqrt(ca.sum1(part["sent"][3:, :] ** 2)) @ remaining
        if lag:
            tail = optional["tail"] = part["tail"]
            up, down = up + tail[:, 0], down + tail[:, 1]
            owed += tail[:, 0] - tail[:, 1]
            optional["turn"] += ca.norm_2(tail[3:, 0] + tail[3:, 1])
        total = total + owed
        pieces, seconds = [*pieces, part["sent"]], [*seconds, remaining]
    slowest, fastest = _extremes(part["sent"], mx["history_sent"])
    if lag:
        optional["swift"] = ca.horzcat(fastest, -slowest) + part["tail"] / mx["robot_lag"]
        fastest = ca.fmax(fastest, part["swift"][:, 0])
        slowest = ca.fmin(slowest, -part["swift"][:, 1])
    stretch = 1 + model.robot(mx).gain_error
    return optional | {
        "total": total,
        "twists": ca.horzcat(*pieces) if pieces else ca.MX(6, 0),
        "seconds": ca.vertcat(*seconds) if seconds else ca.MX(0, 1),
        "owed": owed,
        "up": up,
        "down": down,
        "previous": part["planned"][:, 0],
        "sent": part["sent"][:, 0],
        "lasted": part["ages"][0],
        "changed": part["owed"] - owed if "owed" in part else owed,
        "slowest": stretch * slowest,
        "fastest": stretch * fastest,
        "begun": begun,
        **{name: by_ages[name] for name in _BY_AGES},
    }


def _extremes(twists: ca.MX, counted: ca.MX) -> tuple[ca.MX, ca.MX]:
    """Return the smallest and the largest entry of each row that count, zero included."""
    given, weights = ca.SX.sym("twists", *twists.shape), ca.SX.sym("counted", counted.shape[0])
    low = high = ca.SX(twists.shape[0], 1)
    several = twists.shape[1] > 1
    for number, twist in enumerate(ca.horzsplit(given)):
        counts = weights[number] * twist if several else twist
        low, high = ca.fmin(low, counts), ca.fmax(high, counts)
    function = ca.Function("extremes", [given, weights], dense([low, high]))
    low, high = function.call([twists, counted])
    return low, high


def next_history(
    model: StepModel,
    history: ca.MX,
    found: Mapping[str, ca.MX],
    planned: ca.MX,
    sent: ca.MX,
    still: ca.MX,
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
    kept, declared = model.history, model.problem.robot
    numbers = model.numbers(found)
    robot = model.robot(numbers)
    first = 6 * kept.planned
    after = [planned, history[: first - 6], sent, history[first : first + 6 * kept.sent - 6]]
    after += [found["period"], *([found["aged"]] if kept.ages > 1 else [])]
    after += [still * found["idled"]]
    if declared.lag:
        dt, lag = found["period"], robot.lag
        # The oldest twist leaves the history; what is still to come of it goes on decaying.
        part = split(kept.sizes, history)
        gone, ends = part["sent"], ca.vertcat(0, part["ages"])
        younger, older = ends[: kept.sent], ends[1 : kept.sent + 1]
        if kept.sent > 1:
            oldest = numbers["history_oldest"]
            gone, younger, older = gone @ oldest, oldest.T @ younger, oldest.T @ older
        seconds = remaining_seconds(younger + dt, older + dt, robot.dead_time, lag)
        fades = ca.exp(-dt / lag) * part["tail"]
        after.append(ca.vec(fades + seconds * ca.horzcat(ca.fmax(gone, 0), ca.fmax(-gone, 0))))
        after.append(ca.vec(found["swift"]))
        if declared.longest_hold:
            # What a hold of the oldest leaves decays as slowly, and there is only one hold.
            left = robot.clinging * ca.horzcat(ca.fmax(gone, 0), ca.fmax(-gone, 0))
            after.append(ca.vec(ca.fmax(ca.exp(-dt / lag) * part["clung"], left)))
    return [*after, found["owed"]] if declared.owes else after


def landing(
    model: StepModel,
    found: Mapping[str, ca.MX],
    signals: Mapping[str, ca.MX],
    shape: Shape = vectors,
) -> dict[str, ca.MX]:
    """Return ``landed`` (4, 4), the landing pose, and ``way``: see `PendingMotionLayout`.

    The declared values of a robot are upper bounds: any share of each piece may be done already. So
    a piece that leads away from an end does not count, and a piece that leads to it counts in full.

    Args:
        model: model of the step.
        found: the motion under way.
        signals: ``readings``; ``pose`` as measured, or as far as it is known (4, 4), and
            ``astray``: how far the object may be from it, see `ergoqp.step.layout.ASTRAY`. If the
            declared
            robot may be late also ``doubt``: how far the object may be behind this pose, along each
            axis and against it (6, 2) [m, rad].
        shape: how functions are written, see `ergoqp.expressions`.
    """
    if not model.under_way.count:
        return {"landed": signals["pose"], "way": found["total"]}
    given = {name: part for name, part in found.items() if name in _PARTS}
    if "doubt" in signals:
        given["doubt"] = signals["doubt"]
    given |= {name: signals[name] for name in ("astray", "readings")}
    mx = model.symbols(("pose",), ca.MX)
    symbols = {name: ca.MX.sym(name, part.sparsity()) for name, part in given.items()}
    mx |= symbols
    mx.inputs |= symbols
    landed, way = _counted(model, mx["pose"], symbols, mx)
    function = mx.function("way", {"landed": landed, "way": way})
    return call_by_name(shape(function), {**signals, **given}, written=True)


_PARTS: Final = ("total", "twists", "seconds", "weights", "tail", "clung", "turn")


def _counted(
    model: StepModel, pose: ca.MX, found: Mapping[str, ca.MX], mx: Signals
) -> tuple[ca.MX, ca.MX]:
    declared, robot, parts_of = model.problem.robot, model.robot(mx), model.under_way
    hard = call_by_name(_hard_rows(model), mx, pose=pose, pending=found["total"])
    landed, rows, off = hard.values()
    done = rows @ found["twists"]
    # The part of each piece that leads to the upper ends, and to the lower ends.
    toward = ca.fmax(done, 0)
    toward = ca.vertcat(toward, toward - done)
    sums, many = toward @ found["seconds"], rows.shape[0]
    if "tail" in found:
        sums += _along(rows, found["tail"])
    # A piece that leads to one end does not count at the other end.
    up, down = sums[:many], sums[many:]
    below, above = up, down
    n = found["weights"].numel() if "weights" in found else 0
    if n:
        # The addition of a mean that still rises toward the last planned twist, see
        # `ergoqp.limits.twist_and_stopping.Stop`.
        rises = ca.fmax(ca.repmat(toward[:, 0], 1, n) - toward[:, :n], 0)
        rise = rises @ (mx["stop_mean_rise"] * found["weights"])
        below, above = below + rise[many:], above + rise[:many]
    angles = stray = raised = ca.MX(0)
    if declared.longest_hold or parts_of.strays:
        angles = ca.sqrt(ca.sum1(found["twists"][3:, :] ** 2))
    if parts_of.strays:
        # A path of length L with a chord c deviates from the chord by at most sqrt(L^2 - c^2) / 2.
        # Turns do not commute: one after the other, they differ from the turn of their sum by the
        # area between path and chord.
        length = angles @ found["seconds"]
        if "tail" in found:
            length += ca.norm_2(found["tail"][3:, 0] + found["tail"][3:, 1])
        chord = ca.sumsqr(found["total"][3:])
        stray = (1 + robot.gain_error) / 2 * ca.sqrt(ca.fmax(length**2 - chord, 0))
        bent = ca.DM(limit_values(parts_of.limits, "curvature") > 0)
        above += (1 + robot.gain_error) * stray * length * bent
        turns = found["twists"][3:, :n]
        rises = ca.sqrt(ca.sum1((ca.repmat(turns[:, 0], 1, n) - turns) ** 2))
        raised = mx["stop_mean_rise"] * (rises @ found["weights"])
    if "doubt" in found:
        # The object may be behind its computed pose by this much along each axis.
        back = _along(rows, found["doubt"])
        below, above = below + back[:many], above + back[many:]
    if declared.gain_error:
        below, above = below + robot.gain_error * down, above + robot.gain_error * up
    if declared.noise.any():
        # The noise counts twice for a row that touches a region at the point nearest to the pose:
        # for the distance and for the direction. With both, it is never measured inside.
        tangent = ca.DM(limit_values(parts_of.limits, "tangent"))
        aside = ca.fabs(rows) @ robot.noise + robot.distance_noise * tangent
        below, above = below + aside, above + aside
    parts = [found["total"], below + off[many:], above + off[:many]]
    # The error of a measured turn counts like a turn that may be done already or not.
    turn = found.get("turn", 0) + ca.MX(robot.turn_noise if declared.noise.any() else 0)
    if "doubt" in found:
        turn += ca.norm_2(ca.fmax(found["doubt"][3:, 0], found["doubt"][3:, 1]))
    if parts_of.turns:
        parts.append(turn)
    if parts_of.strays:
        parts += [stray, raised]
    if declared.longest_hold:
        hold = robot.longest_hold * (1 + robot.gain_error)
        counted = _counting(model, mx)
        held, turned = hold * _most(toward, counted), hold * _most(angles, counted)
        if "clung" in found:
            clung = (1 + robot.gain_error) * found["clung"]
            held = ca.fmax(held, _along(rows, clung))
            turned = ca.fmax(turned, ca.norm_2(clung[3:, 0] + clung[3:, 1]))
        parts += [below + held[many:], above + held[:many], turn + turned]
    return landed, ca.vertcat(*parts)


def off_rows(rows: ca.SX, astray: ca.SX, limits: Sequence[Limit]) -> tuple[ca.SX, ca.SX]:
    """Return how much nearer to the ends (upper, lower) of rows (m, 6) an object may be.

    An object that is turned by an angle, and turns on as commanded, keeps this angle to the
    computed one. So no row of its orientation changes by more; an angle neither where it has no
    slope, in the middle of a cone. The direction of a row that touches a region follows from the
    computed position, and its distance changes by at most the way to the true one.

    Args:
        rows: rows at the computed pose.
        astray: how far the object may be from there, see `ergoqp.step.layout.ASTRAY`.
        limits: the limits of these rows, in order.
    """
    along, against, angle = astray[:3], astray[3:6], astray[6]
    farthest = ca.norm_2(ca.fmax(along, against))
    of_rows = [limit for limit in limits for _ in limit.names]
    upper, lower = [], []
    for row, limit in zip(ca.vertsplit(rows), of_rows, strict=True):
        turn = angle * ca.norm_2(row[3:]) if row[3:].nnz() else 0
        if getattr(limit, "curvature", 0.0) and limit.unit == "rad":
            turn = angle
        ahead, back = ca.fmax(row[:3], 0), ca.fmax(-row[:3], 0)
        for ends, one, other in ((upper, along, against), (lower, against, along)):
            tangent = getattr(limit, "tangent", False)
            ends.append(turn + (farthest if tangent else ahead @ one + back @ other))
    return ca.vertcat(*upper), ca.vertcat(*lower)


def _along(rows: ca.MX, ways: ca.MX) -> ca.MX:
    """Return how far displacements (6, 2) lead to the ends of rows (m, 6), upper ends first.

    The displacements are those along each axis and against it.
    """
    ahead, back = ca.fmax(rows, 0), ca.fmax(-rows, 0)
    return ca.vertcat(
        ahead @ ways[:, 0] + back @ ways[:, 1], ahead @ ways[:, 1] + back @ ways[:, 0]
    )


def _counting(model: StepModel, mx: Signals) -> ca.MX:
    """Return which pieces of the motion under way count (k,)."""
    parts = ["history_planned"] if model.problem.average else []
    parts += ["history_sent"] if model.problem.robot.owes else []
    return ca.vertcat(ca.MX(0, 1), *(mx[name] for name in parts))


def _most(values: ca.MX, counted: ca.MX) -> ca.MX:
    """Return the largest positive entry of each row that counts, or 0."""
    most = ca.MX(ca.DM.zeros(values.shape[0]))
    for column in ca.horzsplit(values * ca.repmat(counted.T, values.shape[0], 1)):
        most = ca.fmax(most, column)
    return most


def _hard_rows(model: StepModel) -> ca.Function:
    """Return the hard rows where the object lands.

    Returns:
        Function ``(pose, displacement under way (6,), readings, astray) -> (landed, matrices (h,
        6), distance (2 h,) that cannot be counted on, to the upper ends and then to the lower
        ones)``.
    """
    n, sx = len(model.problem.coordinates), model.symbols(("pose", "pending", "readings", "astray"))
    posture, S = ca.SX.sym("posture", n), ca.SX.sym("S", n, 6)
    landed, still = shifted(sx["pose"], sx["pending"]), ca.SX(6, 1)
    where: dict[str, Any] = {"readings": model.by_limit(sx["readings"])}
    where |= {"surface": model.surface(sx), "pending_displacement": sx["pending"]}
    where |= {"numbers": partial(model.numbers_of, sx)}
    context = LimitContext(posture, ca.SX.ones(n), landed, S, still, still, **where)
    rows = ca.vertcat(*(limit.rows(context).matrix for limit in model.under_way.limits))
    if ca.depends_on(rows, ca.vertcat(posture, ca.vec(S))):
        names = ", ".join(model.under_way.names)
        raise ProblemError(
            f"limits: got a hard row among {names} that follows the posture, allowed rows of the"
            " object only"
        )
    lost = ca.vertcat(*off_rows(rows, sx["astray"], model.under_way.limits))
    return sx.function("hard_rows", {"landed": landed, "rows": rows, "lost": lost})
