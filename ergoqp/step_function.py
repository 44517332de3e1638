"""The control step as one pure CasADi function: posture, pose and last twist in; a certified twist and its account out."""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, Final

import casadi as ca
import numpy as np

from ergoqp.joints import JOINTS
from ergoqp.limits import Situation
from ergoqp.linear import gram
from ergoqp.qp import FREE, TOLERANCE, build_qp
from ergoqp.rest import STATES, rest_update
from ergoqp.rigid import exp_rotation, rotation_error
from ergoqp.solvers import QpSolver
from ergoqp.step_rows import braking, driven, limit_values, movable_rows, patience, row_bounds, stop_displacement, unhurried

if TYPE_CHECKING:
    from ergoqp.problem import Problem

N: Final = len(JOINTS)
PASSES: Final = 3
"""Locking passes: solve, lock joints that would leave their range, solve again."""
HELD: Final = 1e-12
"""Rounding of a margin; far below what could add up over a day of steps [m, rad]."""
GIVES_WAY: Final = 1e-3
"""How much more than braking a posture row may give way that braking breaks already [rad]."""
_SHARES: Final = (1.0, 0.5, 0.25, 0.1)
_CAUTION_EPS: Final = 0.1
_STILL: Final = ca.SX(6, 1)


class Status(IntEnum):
    """What a step did; the order is the order of precedence."""

    optimal = 0
    settled = 1
    relaxed = 2
    recovering = 3
    braking = 4
    invalid = 5


class Cause(IntEnum):
    """Why a step did not use its inputs or its answer; bits of the function's output ``causes``."""

    posture = 0
    pose = 1
    twist = 2
    dt = 3
    age = 4
    disabled = 5
    no_frame = 6
    too_old = 7
    not_solved = 8
    not_certified = 9


INPUTS: Final = (
    *("posture", "observed", "pose", "has_pose", "stored_pose", "started", "executed", "sent", "dt", "age"),
    *("frame", "enable", "rest"),
)
OUTPUTS: Final = (
    *("twist", "pose_used", "next_pose", "posture_rate", "next_rest", "status", "causes", "cost", "gain", "margins"),
    *("slack", "multipliers", "locked", "outside", "residuals"),
)
_SIZES: Final = {
    **{"posture": (N, 1), "observed": (N, 1), "pose": (4, 4), "stored_pose": (4, 4), "executed": (6, 1), "sent": (6, 1)},
    "rest": (STATES, 1),
}


def build_step(problem: Problem, solver: QpSolver) -> ca.Function:
    """Return the step as a function of `INPUTS`, giving `OUTPUTS`, by these names.

    Inputs that may be absent come with a flag (``has_pose``, ``started``, ``frame``, ``enable``: 0 or 1). ``rest`` is the
    rest state and its timer. All state is passed in and out: the same inputs give the same outputs, always.

    ``residuals`` holds the QP's largest residual, the contact motion that the posture cannot follow [m/s, rad/s in one
    norm] and the share of the way from braking to the QP's answer that was accepted.
    """
    raw = {name: ca.MX.sym(name, *_SIZES.get(name, (1, 1))) for name in INPUTS}
    posture, pose, previous, dt, usable, causes = _checked(problem)(*(raw[name] for name in INPUTS))
    value, total, gradient = _cost(problem)(posture, raw["observed"])
    one_pass, movable = _one_pass(problem, solver)

    fixed = [posture, raw["observed"], pose, previous, dt, total, gradient]
    result = _further_passes(one_pass, 1)(*fixed, *one_pass(*fixed, ca.MX(ca.DM.zeros(N)), 0))
    xi, S, E, slack, multipliers, residual, locked, _ = result
    pattern = _pattern(problem)
    judge, shorten, account = _judge(problem, pattern), _shorten(problem, pattern), _account(problem, pattern, movable)
    seen = raw["observed"]
    gain = _gain(problem)(posture, total, xi, S)
    wanted, brake, now, solved, outside, rest, whole = judge(
        posture, seen, pose, previous, dt, gain, total, xi, S, residual, usable, raw["rest"]
    )
    nothing_to_shorten = ca.Function("whole", shorten.sx_in(), [ca.SX(1)])
    share = ca.Function.if_else("shorten_or_not", nothing_to_shorten, shorten)(
        whole, posture, seen, pose, dt, S, wanted, brake, now
    )
    known = (posture, seen, pose, dt, S, residual, usable, E, slack, multipliers, causes)
    twist, moved, rate, status, causes, slack, multipliers, residuals = account(
        *known, wanted, brake, now, solved, outside, rest, share
    )
    outputs = [twist, pose, moved, rate, rest, status, causes, value, gain, now, slack, multipliers, locked, outside, residuals]
    return ca.Function("step", list(raw.values()), outputs, list(INPUTS), list(OUTPUTS))


def _further_passes(one_pass: ca.Function, number: int) -> ca.Function:
    """``(inputs of a pass, its result) -> result`` after the further passes that joints to be locked ask for.

    Each is inside the branch of the one before, so that a step without such a joint only looks once.
    """
    inputs = [ca.MX.sym("i", one_pass.sparsity_in(i)) for i in range(one_pass.n_in() - 2)]
    result = [ca.MX.sym("r", one_pass.sparsity_out(i)) for i in range(one_pass.n_out())]
    last = number == PASSES - 1
    next_one = list(one_pass(*inputs, result[6], float(last)))
    after = next_one if last else list(_further_passes(one_pass, number + 1)(*inputs, *next_one))
    again = ca.Function("again", [*inputs, *result], after)
    enough = ca.Function("enough", [*inputs, *result], result)
    choose = ca.Function.if_else("next_pass", again, enough)
    return ca.Function("further_passes", [*inputs, *result], list(choose(result[7], *inputs, *result)))


def _checked(problem: Problem) -> ca.Function:
    """Judge every input; replace what cannot be used by what was known before, so that no NaN goes further."""
    raw = {name: ca.SX.sym(name, *_SIZES.get(name, (1, 1))) for name in INPUTS}
    seen = raw["observed"] > 0.5
    plausible = ca.fabs(raw["posture"]) <= np.pi
    posture_ok = ca.sum1(ca.if_else(seen, plausible, 1)) >= N - 0.5
    rotation = raw["pose"][:3, :3]
    bottom = ca.sumsqr(raw["pose"][3, :] - ca.DM([[0, 0, 0, 1]])) < 1e-6
    pose_ok = ca.logic_and(ca.logic_and(rotation_error(rotation) < 1e-3, bottom), ca.sumsqr(raw["pose"][:3, 3]) < 1e4)
    twist_ok = ca.sumsqr(raw["executed"]) < 1e4
    dt_ok = ca.logic_and(raw["dt"] >= 1e-5, raw["dt"] <= 0.5)
    age_ok = raw["age"] >= 0
    fresh = raw["age"] <= problem.control.max_age

    comfort = ca.SX(ca.DM(_stand_in(problem)))
    known = ca.if_else(ca.logic_and(seen, plausible), raw["posture"], comfort)
    from_posture = problem.response.contact()(known)[0]
    given = ca.logic_and(raw["has_pose"] > 0.5, pose_ok)
    stored = ca.if_else(raw["started"] > 0.5, raw["stored_pose"], from_posture)
    pose = ca.if_else(given, raw["pose"], stored)
    previous = ca.if_else(twist_ok, raw["executed"], raw["sent"])
    dt = ca.if_else(dt_ok, raw["dt"], problem.dt)

    bad = {
        Cause.posture: ca.logic_and(ca.logic_not(posture_ok), raw["frame"] > 0.5),
        Cause.pose: ca.logic_and(raw["has_pose"] > 0.5, ca.logic_not(pose_ok)),
        Cause.twist: ca.logic_not(twist_ok),
        Cause.dt: ca.logic_not(dt_ok),
        Cause.age: ca.logic_not(age_ok),
        Cause.disabled: raw["enable"] < 0.5,
        Cause.no_frame: raw["frame"] < 0.5,
        Cause.too_old: ca.logic_and(age_ok, ca.logic_not(fresh)),
    }
    causes = sum((2.0**cause * flag for cause, flag in bad.items()), ca.SX(0))
    return ca.Function("checked", list(raw.values()), [known, ca.densify(pose), previous, dt, causes < 0.5, causes])


def _stand_in(problem: Problem) -> np.ndarray:
    """Posture that stands in for joints that are not seen: the comfort posture, where the response has one."""
    return np.asarray(getattr(problem.response, "comfort", np.zeros(N)), dtype=float)


def _total(problem: Problem, q: ca.MX) -> ca.MX:
    """V, and a little comfort: where the sheet is flat, the posture that the person would relax to leads the way."""
    away = q - ca.DM(_stand_in(problem))
    moved = np.array([joint in problem.joints for joint in problem.coordinates], dtype=float)
    weights = problem.control.comfort * moved * problem.response.weight_vector
    return problem.cost.expression(q) + ca.dot(ca.DM(weights), away**2) / 2


def _cost(problem: Problem) -> ca.Function:
    """``(posture, observed) -> (V, total, its gradient)``; what is not seen, or cannot be moved, does not pull."""
    q, observed = ca.MX.sym("q", N), ca.MX.sym("observed", N)
    total = _total(problem, q)
    moved = [problem.coordinates.index(joint) for joint in problem.joints]
    gradient = ca.MX(N, 1)
    gradient[moved] = (ca.gradient(total, q) * (observed > 0.5))[moved]
    # As scalars the value and its gradient share what they have in common.
    scalar = ca.Function("cost", [q, observed], [problem.cost.expression(q), total, ca.densify(gradient)]).expand()
    inputs = [ca.SX.sym("q", N), ca.SX.sym("observed", N)]
    return ca.Function("cost", inputs, ca.cse(list(scalar(*inputs))))


def _one_pass(problem: Problem, solver: QpSolver) -> tuple[ca.Function, list[int]]:
    """One QP with a given lock set: ``(posture, observed, pose, previous, dt, V, dV, locked, final) -> result``."""
    names = ("posture", "observed", "pose", "previous", "dt", "value", "gradient", "locked", "final", "S", "E")
    unmet = problem.response.sensitivity().size_out(1)
    sizes = ((N, 1), (N, 1), (4, 4), (6, 1), (1, 1), (1, 1), (N, 1), (N, 1), (1, 1), (N, 6), unmet)
    sx = {name: ca.SX.sym(name, *size) for name, size in zip(names, sizes, strict=True)}
    S = _with_pattern(sx["S"], _pattern(problem))
    brake = braking(problem.twist_limit, sx["previous"], sx["dt"])
    situation = Situation(sx["posture"], sx["observed"], sx["pose"], S, sx["previous"] * brake.reach, brake.sway)
    brake = unhurried(brake, patience(problem.row_limits, situation, sx["previous"], sx["dt"]))
    movable = movable_rows(problem.twist_limit, problem.row_limits, situation)
    bounds = row_bounds(problem.twist_limit, problem.row_limits, situation, brake, sx["final"], movable)
    H, g = _objective(problem, sx, S)
    parts = [H, g, bounds.matrix, bounds.lower, bounds.upper, bounds.side, bounds.cap, brake.low, brake.high]
    prepare = ca.Function("prepare", list(sx.values()), ca.cse([ca.densify(part) for part in parts]))

    mx = {name: ca.MX.sym(name, *size) for name, size in zip(names[:-2], sizes[:-2], strict=True)}
    S_value, E_value = problem.response.sensitivity()(mx["posture"], mx["locked"])
    data = prepare(*mx.values(), S_value, E_value)
    xi, slack, multipliers, residual = build_qp(solver, len(movable))(*data)
    # Solvers keep bounds to their tolerance; the twist bounds hold to the last bit.
    xi = ca.fmin(ca.fmax(xi, data[7]), data[8])
    newly = _newly_locked(problem)(mx["posture"], mx["observed"], mx["locked"], S_value, xi, residual)
    locked = ca.fmax(mx["locked"], newly)
    again = ca.mmax(newly)
    parts = [xi, ca.densify(S_value), ca.densify(E_value), slack, multipliers, residual, locked, again]
    return ca.Function("one_pass", list(mx.values()), parts), movable


def _pattern(problem: Problem) -> ca.SX:
    return problem.response.sensitivity()(ca.SX.sym("q", N), ca.SX.sym("locked", N))[0]


def _with_pattern(dense: ca.SX, pattern: ca.SX) -> ca.SX:
    """Return `dense` with the entries that are zero in `pattern` dropped: rows of joints that never move vanish."""
    kept = ca.SX(*pattern.shape)
    for row in range(pattern.shape[0]):
        if not all(pattern[row, column].is_zero() for column in range(pattern.shape[1])):
            kept[row, :] = dense[row, :]
    return kept


def _objective(problem: Problem, sx: dict[str, ca.SX], S: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Gauss-Newton on V - V_min over the look-ahead, effort, smoothing, and the contact that the person could not keep."""
    control = problem.control
    effort = ca.DM(np.repeat([control.effort_linear, control.effort_angular], 3))
    smoothing = control.smoothing / sx["dt"]
    ahead = control.look_ahead
    slope = S.T @ sx["gradient"]
    excess = ca.fmax(sx["value"] - problem.cost.minimum, 0) + _CAUTION_EPS
    scaled = ca.diag(ca.DM(np.sqrt(control.caution * problem.response.weight_vector))) @ S
    # One tall matrix, so that its Gram matrix is all there is to compute, and one half of that.
    tall = ca.vertcat(ahead * slope.T / ca.sqrt(2 * excess), ahead * scaled, np.sqrt(control.contact) * sx["E"])
    H = gram(tall) + ca.diag(effort * (1 + smoothing))
    return H, ahead * slope - smoothing * effort * sx["previous"]


def _newly_locked(problem: Problem) -> ca.Function:
    """Joints that are at their end, not yet locked, and would move outward."""
    q, observed, locked = ca.SX.sym("q", N), ca.SX.sym("observed", N), ca.SX.sym("locked", N)
    S, xi, residual = ca.SX.sym("S", N, 6), ca.SX.sym("xi", 6), ca.SX.sym("residual")
    situation = Situation(q, observed, ca.SX.eye(4), S, _STILL, ca.SX(0))
    outward = ca.SX(N, 1)
    for limit in problem.row_limits:
        if not limit.yield_zone:
            continue
        rows = limit.rows(situation)
        rate = rows.matrix @ xi
        up = ca.logic_and(_near(rows.above, limit.yield_zone, limit.tolerance), rate > 1e-6)
        down = ca.logic_and(_near(rows.below, limit.yield_zone, limit.tolerance), rate < -1e-6)
        outward = ca.fmax(outward, ca.logic_or(up, down))
    newly = ca.logic_and(ca.logic_and(outward, locked < 0.5), residual < TOLERANCE)
    return ca.Function("newly_locked", [q, observed, locked, S, xi, residual], [ca.densify(newly)])


def _near(distance: ca.SX, zone: float, tolerance: float) -> ca.SX:
    return ca.logic_and(distance < zone, distance >= -tolerance)


def _judge(problem: Problem, pattern: ca.SX) -> ca.Function:
    """What the object should do by this answer, and whether all of it can be certified as it is."""
    sx = {name: ca.SX.sym(name, *size) for name, size in _JUDGED.items()}
    S = _with_pattern(sx["S"], pattern)
    limits, dt = problem.row_limits, sx["dt"]
    situation = Situation(sx["posture"], sx["observed"], sx["pose"], S, _STILL, ca.SX(0))
    brake = braking(problem.twist_limit, sx["previous"], dt)
    now = _margins(problem, situation, ca.SX(6, 1), dt)
    solved = sx["residual"] < TOLERANCE
    outside = ca.logic_and(now < -ca.DM(limit_values(limits, "tolerance")), _moves(problem, situation))
    must_move = ca.mmax(outside)
    counts = ca.logic_and(sx["usable"], solved)
    rest = rest_update(problem.control, sx["rest"], sx["gain"], sx["value"], must_move, dt, counts)
    wanted = ca.if_else(ca.logic_and(rest[0] > 0.5, ca.logic_not(must_move)), brake.twist, sx["xi"])
    # The answer of a failed QP may be NaN; it goes no further. And with no time left there is nothing to choose.
    in_time = patience(limits, situation, sx["previous"], dt) > 0
    wanted = ca.if_else(ca.logic_and(solved, in_time), wanted, brake.twist)
    through = _margins(problem, situation, wanted, dt)
    whole = ca.mmin(through - _floor(problem, now)) >= 0
    outputs = [wanted, brake.twist, now, solved, outside, rest, whole]
    return ca.Function("judge", list(sx.values()), ca.cse([ca.densify(part) for part in outputs]))


def _shorten(problem: Problem, pattern: ca.SX) -> ca.Function:
    """The largest share of the way from braking to the wanted twist that can be certified; 0: only braking itself.

    What held before holds through the stop, what did not gets no worse, and nothing is asked beyond what braking does.
    """
    names = ("posture", "observed", "pose", "dt", "S", "wanted", "brake", "now")
    sizes = {**_JUDGED, "wanted": (6, 1), "brake": (6, 1), "now": (len(problem.row_names), 1)}
    sx = {name: ca.SX.sym(name, *sizes[name]) for name in names}
    situation = Situation(sx["posture"], sx["observed"], sx["pose"], _with_pattern(sx["S"], pattern), _STILL, ca.SX(0))
    at_braking = _margins(problem, situation, sx["brake"], sx["dt"])
    floor = _floor(problem, sx["now"], at_braking)
    share = ca.SX(0)
    for candidate in reversed(_SHARES):
        twist = sx["brake"] + candidate * (sx["wanted"] - sx["brake"])
        holds = ca.mmin(_margins(problem, situation, twist, sx["dt"]) - floor) >= 0
        share = ca.if_else(holds, candidate, share)
    return ca.Function("shorten", list(sx.values()), ca.cse([share]))


def _account(problem: Problem, pattern: ca.SX, movable: list[int]) -> ca.Function:
    """The twist that is sent, and the account of it."""
    m, rows_in_all = len(movable), len(problem.row_names)
    sizes = {
        **{name: _JUDGED[name] for name in ("posture", "observed", "pose", "dt", "S", "residual", "usable")},
        **{"E": problem.response.sensitivity().size_out(1), "slack": (m, 1), "multipliers": (m, 1), "causes": (1, 1)},
        **{"wanted": (6, 1), "brake": (6, 1), "now": (rows_in_all, 1), "solved": (1, 1), "outside": (rows_in_all, 1)},
        **{"rest": (STATES, 1), "share": (1, 1)},
    }
    sx = {name: ca.SX.sym(name, *size) for name, size in sizes.items()}
    limits, dt, share = problem.row_limits, sx["dt"], sx["share"]
    situation = Situation(sx["posture"], sx["observed"], sx["pose"], _with_pattern(sx["S"], pattern), _STILL, ca.SX(0))
    accepted = ca.logic_and(ca.logic_and(sx["usable"], sx["solved"]), share > 0)
    twist = sx["brake"] + ca.if_else(accepted, share, 0) * (sx["wanted"] - sx["brake"])
    rate = _model_rate(limits, situation, situation.sensitivity @ twist, dt)
    failed = ca.if_else(sx["solved"], 2.0**Cause.not_certified * (share <= 0), 2.0**Cause.not_solved)
    causes = sx["causes"] + ca.if_else(sx["usable"], failed, 0)

    tolerance = ca.DM(limit_values(limits, "tolerance"))
    # Slack of a row on the object side only says that the QP asked for more than needed: the certificate is exact there.
    soft = ca.DM(1 - limit_values(limits, "hard"))[movable]
    used = ca.mmax(soft * sx["slack"] * (sx["now"][movable] >= -tolerance[movable])) > 10 * TOLERANCE
    status = ca.if_else(sx["rest"][0] > 0.5, int(Status.settled), int(Status.optimal))
    status = ca.if_else(used, int(Status.relaxed), status)
    status = ca.if_else(ca.mmax(sx["outside"]), int(Status.recovering), status)
    status = ca.if_else(accepted, status, int(Status.braking))
    wrong = ca.fmod(causes, 2.0 ** (Cause.age + 1)) > 0.5
    status = ca.if_else(wrong, int(Status.invalid), status)

    full_slack, full_multipliers = ca.SX(rows_in_all, 1), ca.SX(rows_in_all, 1)
    full_slack[movable], full_multipliers[movable] = sx["slack"], sx["multipliers"]
    contact = ca.sqrt(ca.sumsqr(sx["E"] @ twist))
    residuals = ca.vertcat(sx["residual"], contact, ca.if_else(accepted, share, 0))
    outputs = [twist, exp_rotation(sx["pose"], twist * dt), rate, status, causes, full_slack, full_multipliers, residuals]
    return ca.Function("account", list(sx.values()), ca.cse([ca.densify(part) for part in outputs]))


_JUDGED: Final = {
    **{
        "posture": (N, 1),
        "observed": (N, 1),
        "pose": (4, 4),
        "previous": (6, 1),
        "dt": (1, 1),
        "gain": (1, 1),
        "value": (1, 1),
    },
    **{"xi": (6, 1), "S": (N, 6), "residual": (1, 1), "usable": (1, 1), "rest": (STATES, 1)},
}


def _margins(problem: Problem, situation: Situation, twist: ca.SX, dt: ca.SX) -> ca.SX:
    """Smallest margins of all rows through a period at `twist` and the stop after it."""
    displacement = stop_displacement(problem.twist_limit, twist, dt) if twist.nnz() else twist
    return ca.vertcat(*(limit.margins(situation, displacement) for limit in problem.row_limits))


def _floor(problem: Problem, now: ca.SX, at_braking: ca.SX | None = None) -> ca.SX:
    """Margins that an accepted twist must keep through its stop, given those of now and of braking.

    Hard rows: what held holds, what did not gets no worse, and nothing is asked beyond what braking does. Rows through S: what
    held holds, to the accuracy of the QP; where braking itself breaks it, it gives way by about as much; what does not hold is
    left to the QP, which never lets it further out.
    """
    hard = ca.DM(limit_values(problem.row_limits, "hard"))
    braked = now if at_braking is None else at_braking
    given_way = ca.if_else(braked < 0, braked - GIVES_WAY, -1e-7)
    soft_floor = ca.if_else(now < 0, -FREE, given_way)
    return ca.if_else(hard, ca.fmin(ca.fmin(now, braked), 0) - HELD, soft_floor)


def _moves(problem: Problem, situation: Situation) -> ca.SX:
    """Whether some twist that the object can do moves each row."""
    matrices = [driven(problem.twist_limit, limit.rows(situation).matrix) for limit in problem.row_limits]
    return ca.vertcat(*(ca.sum2(ca.fabs(ca.densify(matrix))) > 1e-6 for matrix in matrices))


_LOOKS: Final = (0.1, 0.5)
"""Seconds at full speed after which the improvement is looked up."""


def _gain(problem: Problem) -> ca.Function:
    """``(posture, V, xi, S) -> best improvement within half a second at full speed along the answer [points]``.

    The cost itself is looked up on the way: its slope alone would promise a point for every band end within the noise.
    """
    q, value, xi, S = ca.SX.sym("q", N), ca.SX.sym("V"), ca.SX.sym("xi", 6), ca.SX.sym("S", N, 6)
    speed = problem.twist_limit.speed
    free = [axis for axis in range(6) if speed[axis] > 0]
    relative = ca.mmax(ca.fabs(xi[free]) / ca.DM(speed[free]))
    # Joints that the object cannot move stay the same expression at every look, and what the cost makes of them is shared.
    full = _with_pattern(S, _pattern(problem)) @ (xi / (relative + 1e-9))
    symbol = ca.MX.sym("q", N)
    total = ca.Function("total", [symbol], [_total(problem, symbol)])
    ahead = [total(q + seconds * full) for seconds in _LOOKS]
    gain = value - ca.mmin(ca.vertcat(*ahead))
    return ca.Function("gain", [q, value, xi, S], ca.cse([ca.if_else(relative > 1e-6, gain, 0)]))


def _model_rate(limits: tuple, situation: Situation, rate: ca.SX, dt: ca.SX) -> ca.SX:
    """The model person's joint rates: joints at their end do not go beyond it, the object or not."""
    for limit in limits:
        if not limit.yield_zone:
            continue
        rows = limit.rows(situation)
        up = ca.if_else(rows.above < limit.yield_zone, 0.0, ca.fmax(rows.above, 0) / dt)
        down = ca.if_else(rows.below < limit.yield_zone, 0.0, ca.fmax(rows.below, 0) / dt)
        rate = ca.fmax(ca.fmin(rate, up), -down)
    return rate
