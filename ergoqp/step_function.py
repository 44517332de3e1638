"""The control step as one pure CasADi function: posture, pose and last twist in; a certified twist and its account out."""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, Final

import casadi as ca
import numpy as np

from ergoqp.joints import JOINTS
from ergoqp.limits import Situation
from ergoqp.qp import TOLERANCE, build_qp
from ergoqp.rest import rest_update
from ergoqp.rigid import exp_rotation, rotation_error
from ergoqp.solvers import QpSolver
from ergoqp.step_rows import braking, limit_values, movable_rows, row_bounds, stop_displacement

if TYPE_CHECKING:
    from ergoqp.problem import Problem

N: Final = len(JOINTS)
PASSES: Final = 3
"""Locking passes: solve, lock joints that would leave their range, solve again."""
HELD: Final = 1e-9
"""A hard margin above minus this counts as held [m, rad]."""
_SHARES: Final = (1.0, 0.5, 0.25, 0.1)
_CAUTION_EPS: Final = 0.1


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
    "rest": (2, 1),
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
    value, gradient = _cost(problem)(posture, raw["observed"])
    one_pass, movable = _one_pass(problem, solver)

    fixed = [posture, raw["observed"], pose, previous, dt, value, gradient]
    result = one_pass(*fixed, ca.MX(ca.DM.zeros(N)), 0)
    # Result: xi, S, E, slack, multipliers, residual, locked, again. A further pass only where a joint has to be locked.
    shapes = [ca.MX.sym("r", part.sparsity()) for part in result]
    symbols = [ca.MX.sym("f", part.sparsity()) for part in fixed]
    for number in range(1, PASSES):
        last = float(number == PASSES - 1)
        again = ca.Function("again", [*symbols, *shapes], list(one_pass(*symbols, shapes[6], last)))
        enough = ca.Function("enough", [*symbols, *shapes], shapes)
        result = ca.Function.if_else("next_pass", again, enough)(result[7], *fixed, *result)
    finish = _finish(problem, movable)
    # result[6] is the lock set of the answer when no further pass was asked for, and the one it was solved with otherwise.
    outputs = finish(*fixed, *result[:7], usable, causes, raw["rest"])
    return ca.Function("step", list(raw.values()), list(outputs), list(INPUTS), list(OUTPUTS))


def _checked(problem: Problem) -> ca.Function:
    """Judge every input; replace what cannot be used by what was known before, so that no NaN goes further."""
    raw = {name: ca.SX.sym(name, *_SIZES.get(name, (1, 1))) for name in INPUTS}
    seen = raw["observed"] > 0.5
    plausible = ca.fabs(raw["posture"]) <= np.pi
    posture_ok = ca.sum1(ca.if_else(seen, plausible, 1)) >= N - 0.5
    rotation = raw["pose"][:3, :3]
    pose_ok = ca.logic_and(rotation_error(rotation) < 1e-3, ca.sumsqr(raw["pose"][:3, 3]) < 1e4)
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


def _cost(problem: Problem) -> ca.Function:
    """V and its gradient; joints that are not seen do not pull."""
    q, observed = ca.MX.sym("q", N), ca.MX.sym("observed", N)
    value = problem.cost.expression(q)
    gradient = ca.gradient(value, q) * (observed > 0.5)
    return ca.Function("cost", [q, observed], [value, gradient])


def _one_pass(problem: Problem, solver: QpSolver) -> tuple[ca.Function, list[int]]:
    """One QP with a given lock set: ``(posture, observed, pose, previous, dt, V, dV, locked, final) -> result``."""
    names = ("posture", "observed", "pose", "previous", "dt", "value", "gradient", "locked", "final", "S", "E")
    unmet = problem.response.sensitivity().size_out(1)
    sizes = ((N, 1), (N, 1), (4, 4), (6, 1), (1, 1), (1, 1), (N, 1), (N, 1), (1, 1), (N, 6), unmet)
    sx = {name: ca.SX.sym(name, *size) for name, size in zip(names, sizes, strict=True)}
    pattern = problem.response.sensitivity()(ca.SX.sym("q", N), ca.SX.sym("l", N))[0]
    S = _with_pattern(sx["S"], pattern)
    situation = Situation(sx["posture"], sx["observed"], sx["pose"], S)
    movable = movable_rows(problem.row_limits, situation)
    brake = braking(problem.twist_limit, sx["previous"], sx["dt"])
    bounds = row_bounds(problem.row_limits, situation, brake, sx["final"], movable)
    H, g = _objective(problem, sx, S)
    data = [H, g, bounds.matrix, bounds.lower, bounds.upper, bounds.side, bounds.cap, brake.low, brake.high]
    prepare = ca.Function("prepare", list(sx.values()), ca.cse([ca.densify(part) for part in data]))

    mx = {name: ca.MX.sym(name, *size) for name, size in zip(names[:-2], sizes[:-2], strict=True)}
    S_value, E_value = problem.response.sensitivity()(mx["posture"], mx["locked"])
    xi, slack, multipliers, residual = build_qp(solver, len(movable))(*prepare(*mx.values(), S_value, E_value))
    newly = _newly_locked(problem)(mx["posture"], mx["observed"], mx["locked"], S_value, xi, residual)
    locked = ca.fmax(mx["locked"], newly)
    again = ca.mmax(newly)
    parts = [xi, ca.densify(S_value), ca.densify(E_value), slack, multipliers, residual, locked, again]
    return ca.Function("one_pass", list(mx.values()), parts), movable


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
    weights = ca.DM(problem.response.weight_vector)
    curvature = slope @ slope.T / (2 * excess) + control.caution * (S.T @ ca.diag(weights) @ S)
    H = ahead**2 * curvature + ca.diag(effort * (1 + smoothing)) + control.contact * (sx["E"].T @ sx["E"])
    return H, ahead * slope - smoothing * effort * sx["previous"]


def _newly_locked(problem: Problem) -> ca.Function:
    """Joints that are at their end, not yet locked, and would move outward."""
    q, observed, locked = ca.SX.sym("q", N), ca.SX.sym("observed", N), ca.SX.sym("locked", N)
    S, xi, residual = ca.SX.sym("S", N, 6), ca.SX.sym("xi", 6), ca.SX.sym("residual")
    situation = Situation(q, observed, ca.SX.eye(4), S)
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


def _finish(problem: Problem, movable: list[int]) -> ca.Function:
    """Certify the answer, decide on rest, and account for everything."""
    m, limits = len(movable), problem.row_limits
    rows_in_all = len(problem.row_names)
    unmet = problem.response.sensitivity().size_out(1)
    names = ("posture", "observed", "pose", "previous", "dt", "value", "gradient")
    sizes = ((N, 1), (N, 1), (4, 4), (6, 1), (1, 1), (1, 1), (N, 1))
    fixed = [ca.SX.sym(name, *size) for name, size in zip(names, sizes, strict=True)]
    posture, observed, pose, previous, dt, value, gradient = fixed
    xi, S, E, slack, multipliers = (
        ca.SX.sym(name, *size) for name, size in zip("xSEsm", ((6, 1), (N, 6), unmet, (m, 1), (m, 1)), strict=True)
    )
    residual, locked = ca.SX.sym("residual"), ca.SX.sym("locked", N)
    usable, found, rest = ca.SX.sym("usable"), ca.SX.sym("causes"), ca.SX.sym("rest", 2)
    situation = Situation(posture, observed, pose, S)
    brake = braking(problem.twist_limit, previous, dt)

    def margins(twist: ca.SX) -> ca.SX:
        displacement = stop_displacement(problem.twist_limit, twist, dt)
        return ca.vertcat(*(limit.margins(situation, displacement) for limit in limits))

    now, at_braking = margins(ca.SX(6, 1)), margins(brake.twist)
    solved = residual < TOLERANCE
    tolerance = ca.DM(limit_values(limits, "tolerance"))
    outside = ca.logic_and(now < -tolerance, _moves(limits, situation))
    gain = _gain(problem, S.T @ gradient, xi)
    must_move = ca.mmax(outside)
    resting = rest_update(problem.control, rest, ca.if_else(must_move, ca.inf, gain), dt, ca.logic_and(usable, solved))
    wanted = ca.if_else(ca.logic_and(resting[0] > 0.5, ca.logic_not(must_move)), brake.twist, xi)

    # What held before holds through the stop; what did not gets no worse; nothing is asked beyond what braking itself does.
    floor = ca.fmin(ca.fmin(now, at_braking), 0) - HELD - 1e-7 * ca.DM(1 - limit_values(limits, "hard"))
    share = ca.SX(0)
    for candidate in reversed(_SHARES):
        twist = brake.twist + candidate * (wanted - brake.twist)
        share = ca.if_else(ca.mmin(margins(twist) - floor) >= 0, candidate, share)
    accepted = ca.logic_and(ca.logic_and(usable, solved), share > 0)
    share = ca.if_else(accepted, share, 0)
    # The answer of a failed QP may be NaN, and if_else selects without multiplying.
    twist = ca.if_else(accepted, brake.twist + share * (wanted - brake.twist), brake.twist)
    rate = _model_rate(limits, situation, S @ twist, dt)
    failed = ca.if_else(solved, 2.0**Cause.not_certified * (share <= 0), 2.0**Cause.not_solved)
    causes = found + ca.if_else(usable, failed, 0)
    used = ca.mmax(slack * (now[movable] >= -tolerance[movable])) > 10 * TOLERANCE
    status = ca.if_else(resting[0] > 0.5, int(Status.settled), int(Status.optimal))
    status = ca.if_else(used, int(Status.relaxed), status)
    status = ca.if_else(must_move, int(Status.recovering), status)
    status = ca.if_else(accepted, status, int(Status.braking))
    status = ca.if_else(_any_bit(causes, Cause.posture, Cause.age), int(Status.invalid), status)

    full_slack, full_multipliers = ca.SX(rows_in_all, 1), ca.SX(rows_in_all, 1)
    full_slack[movable], full_multipliers[movable] = slack, multipliers
    contact = ca.sqrt(ca.sumsqr(E @ twist))
    outputs = [twist, pose, exp_rotation(pose, twist * dt), rate, resting, status, causes, value, gain, now]
    outputs += [full_slack, full_multipliers, locked, outside, ca.vertcat(residual, contact, share)]
    inputs = [*fixed, xi, S, E, slack, multipliers, residual, locked, usable, found, rest]
    return ca.Function("finish", inputs, ca.cse([ca.densify(part) for part in outputs]))


def _moves(limits: tuple, situation: Situation) -> ca.SX:
    return ca.vertcat(*(ca.sum2(ca.fabs(ca.densify(limit.rows(situation).matrix))) > 1e-6 for limit in limits))


def _gain(problem: Problem, slope: ca.SX, xi: ca.SX) -> ca.SX:
    """Improvement of one second at full speed along the answer [points]."""
    speed = problem.twist_limit.speed
    free = [axis for axis in range(6) if speed[axis] > 0]
    relative = ca.mmax(ca.fabs(xi[free]) / ca.DM(speed[free]))
    return -ca.dot(slope, xi) / (relative + 1e-9)


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


def _any_bit(causes: ca.SX, *bits: Cause) -> ca.SX:
    return ca.mmax(ca.vertcat(*(ca.fmod(ca.floor(causes / 2.0**bit), 2) > 0.5 for bit in bits)))
