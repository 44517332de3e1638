"""The control step as one pure CasADi function.

Posture, pose and last twist go in; a certified twist and its account come out.
"""

from __future__ import annotations

from typing import Final

import casadi as ca
import numpy as np

from ergoqp.errors import InputError
from ergoqp.expressions.linear import Shape, is_set, once, scalars, vectors, written_out
from ergoqp.native.compiled import compiled as machine_code
from ergoqp.problem.problem import Problem
from ergoqp.solvers import QpSolver, solver_named
from ergoqp.step.asked import asked_update, still_asks
from ergoqp.step.bounds import limit_values
from ergoqp.step.certification import account_function, judge_function, shorten_function
from ergoqp.step.data import away_function, pass_data
from ergoqp.step.guide import GUIDE_INPUTS, GUIDE_OUTPUTS, guide_sizes, pull_function
from ergoqp.step.inputs import INPUTS, OUTPUTS, input_sizes, known_of
from ergoqp.step.objective import cost_function, gain_function, sensitivity_pattern
from ergoqp.step.parts import joined, split
from ergoqp.step.qp import TOLERANCE, build_qp
from ergoqp.step.readings import readings_function, readings_size, situation_of
from ergoqp.step.rest import stalled
from ergoqp.step.state import asks_back, state_sizes
from ergoqp.step.way import next_history

PASSES: Final = 3
"""Locking passes: solve, lock joints that would leave their range, solve again."""


def step_function(
    problem: Problem, solver: str = "daqp", compiled: bool = False, *, guided: bool = False
) -> ca.Function:
    """Return the whole control step of a problem as one pure CasADi function; see `build_step`.

    Args:
        problem: the task.
        solver: name of the QP solver, see `ergoqp.solvers`.
        compiled: through the C compiler into the user's cache; the solver is then DAQP.
        guided: with the inputs of a step that can be drawn toward a given place, see
            `ergoqp.step.guide`.

    Raises:
        InputError: if the solver is unknown, or not the one that is compiled.
        CompilerError: if there is no C compiler.
    """
    chosen = solver_named(solver)
    if not compiled:
        return build_step(problem, chosen, guided=guided)
    if chosen.name != "daqp":
        raise InputError(f"compiled: got the solver {solver!r}, allowed only 'daqp'")
    return machine_code(lambda native: build_step(problem, native, guided=guided, unrolled=True))


def build_step(
    problem: Problem,
    solver: QpSolver,
    name: str = "step",
    guided: bool = False,
    unrolled: bool = False,
) -> ca.Function:
    """Return the step as a function of `INPUTS`, giving `OUTPUTS`, by these names.

    Inputs that may be absent come with a flag (``has_pose``, ``has_twist``, ``frame``, ``enable``:
    0 or 1); ``ask`` is 1 when only the braking twist is wanted. All state is passed in and out, see
    `ergoqp.step.state`: the same inputs give the same outputs, always.

    ``residuals`` holds the QP's largest residual, the contact motion that the posture cannot follow
    [m/s, rad/s in one norm] and the share of the way from braking to the QP's answer that was
    accepted.

    Args:
        problem: the task.
        solver: of the QP.
        name: of the function.
        guided: whether the step can be drawn toward a given place: it then has `GUIDE_INPUTS` and
            `GUIDE_OUTPUTS` too, and is the same step to the last bit where ``guided`` is 0. See
            `ergoqp.step.guide`.
        unrolled: every operation on its own instead of vectors: what a compiler makes the fastest
            code of, and an interpreter the slowest.
    """
    shape = scalars if unrolled else vectors
    raw = {key: ca.MX.sym(key, *size) for key, size in input_sizes(problem, guided).items()}
    lead = {key: ca.MX.sym(key, *size) for key, size in guide_sizes().items()} if guided else {}
    sizes = state_sizes(problem, guided)
    state = split(sizes, raw["state"])
    known = known_of(problem, raw, state, shape)
    posture, seen, dt, usable = (
        known.posture,
        raw["observed"],
        known.dt,
        ca.logic_not(is_set(known.causes)),
    )
    value, total, gradient = cost_function(problem)(posture, seen)
    one_pass, movable = _one_pass(problem, solver, guided, shape)
    readings = readings_function(problem)(posture)
    asks = still_asks(state["asked"]) if asks_back(problem) else ca.MX(1.0)
    away = shape(away_function(problem))(posture, seen, readings, known.pose, asks)

    place = [posture, seen, readings, known.landed, known.way]
    fixed = [*place, known.previous, dt, away, total, gradient, stalled(state["rest"])]
    trial, drawn = [], None
    if guided:
        *pull, distance, on, drawn = pull_function(problem)(
            known.landed, lead["guide"], lead["guided"], state["trial"]
        )
        fixed, trial = [*fixed, *pull], [lead["promise"], value, state["trial"], distance, on]
    first = written_out(one_pass, *fixed, ca.MX(ca.DM.zeros(posture.numel())), 0)
    result = written_out(_further_passes(one_pass, 1), *fixed, *first)
    xi, S, E, slack, multipliers, residual, locked, _, shift = result
    pattern = sensitivity_pattern(problem)
    judge, shorten = (
        shape(judge_function(problem, pattern, guided)),
        shorten_function(problem, pattern),
    )
    account = shape(account_function(problem, pattern, movable))
    gain = gain_function(problem)(posture, total, xi, S)
    judged = (
        posture,
        seen,
        readings,
        known.pose,
        known.landed,
        known.way,
        shift,
        known.previous,
        dt,
        away,
        gain,
        total,
        xi,
        S,
    )
    judged = (*judged, residual, usable, state["rest"], *trial)
    wanted, brake, now, solved, outside, rest, whole, *next_trial = written_out(judge, *judged)
    nothing_to_shorten = ca.Function("whole", shorten.sx_in(), [ca.SX.ones(6)])
    share = ca.Function.if_else("shorten_or_not", nothing_to_shorten, shorten)(
        whole, *place, shift, dt, S, wanted, brake, now
    )
    here = (
        posture,
        seen,
        readings,
        known.pose,
        dt,
        S,
        residual,
        usable,
        E,
        slack,
        multipliers,
        known.causes,
    )
    under_way = known.under_way
    here = (
        *here,
        wanted,
        brake,
        now,
        solved,
        outside,
        rest,
        share,
        under_way.begun,
        under_way.own,
        under_way.sent,
    )
    planned, twist, still, rate, status, causes, slack, multipliers, residuals = written_out(
        account, *here
    )
    after = {
        "history": ca.vertcat(
            *next_history(problem, state["history"], under_way, planned, twist, still)
        )
    }
    after |= {"stored": known.pose, "started": known.started, "rest": rest, **known.watched}
    if asks_back(problem):
        after["asked"] = asked_update(problem, state["asked"], now, dt)
    if guided:
        after["trial"] = next_trial[0]
    outputs = [
        twist,
        known.pose,
        joined(sizes, after),
        rate,
        status,
        causes,
        known.watched["said"][-2:],
    ]
    outputs += [value, gain, now, slack, multipliers, locked, outside, residuals]
    if drawn is None:
        return ca.Function(name, list(raw.values()), once(outputs), list(INPUTS), list(OUTPUTS))
    outputs = once([*outputs, drawn])
    return ca.Function(
        name,
        [*raw.values(), *lead.values()],
        outputs,
        [*INPUTS, *GUIDE_INPUTS],
        [*OUTPUTS, *GUIDE_OUTPUTS],
    )


def _further_passes(one_pass: ca.Function, number: int) -> ca.Function:
    """``(inputs of a pass, its result) -> result`` after further passes for joints to be locked.

    Each is inside the branch of the one before, so that a step without such a joint only looks
    once.
    """
    inputs = [ca.MX.sym("i", one_pass.sparsity_in(i)) for i in range(one_pass.n_in() - 2)]
    result = [ca.MX.sym("r", one_pass.sparsity_out(i)) for i in range(one_pass.n_out())]
    last = number == PASSES - 1
    next_one = list(one_pass(*inputs, result[6], float(last)))
    after = next_one if last else list(_further_passes(one_pass, number + 1)(*inputs, *next_one))
    again = ca.Function("again", [*inputs, *result], after)
    enough = ca.Function("enough", [*inputs, *result], result)
    choose = ca.Function.if_else("next_pass", again, enough)
    return ca.Function(
        "further_passes", [*inputs, *result], list(choose(result[7], *inputs, *result))
    )


def _one_pass(
    problem: Problem, solver: QpSolver, guided: bool, shape: Shape
) -> tuple[ca.Function, list[int]]:
    """One QP with a given lock set, of what `pass_data` takes.

    It is ``(..., stalled, locked, final) -> result``.

    Guided, ``(..., stalled, H, g, locked, final)``: the last two of these are added to the
    objective.
    """
    data, movable = pass_data(problem)
    data = shape(data)
    mx = {
        data.name_in(i): ca.MX.sym(data.name_in(i), data.sparsity_in(i)) for i in range(data.n_in())
    }
    *qp, S, E, shift = written_out(data, *mx.values())
    inputs = list(mx.values())
    if guided:
        pull = [ca.MX.sym("pull_H", 6, 6), ca.MX.sym("pull_g", 6)]
        qp[:2] = [qp[0] + pull[0], qp[1] + pull[1]]
        inputs[-2:-2] = pull
    exact = np.flatnonzero(limit_values(problem.row_limits, "hard")[movable])
    xi, slack, multipliers, residual = written_out(
        build_qp(solver, len(movable), shape, exact.tolist()), *qp
    )
    # Solvers keep bounds to their tolerance; the twist bounds hold to the last bit.
    xi = ca.fmin(ca.fmax(xi, qp[7]), qp[8])
    seen = (mx["posture"], mx["observed"], mx["readings"], mx["locked"], S, xi, residual)
    newly = written_out(shape(_newly_locked(problem)), *seen)[0]
    locked = ca.fmax(mx["locked"], newly)
    parts = [xi, S, E, slack, multipliers, residual, locked, ca.mmax(newly), shift]
    return ca.Function("one_pass", inputs, parts), movable


def _newly_locked(problem: Problem) -> ca.Function:
    """Joints that are at their end, not yet locked, and would move outward."""
    N = len(problem.coordinates)
    q, observed, locked = ca.MX.sym("posture", N), ca.MX.sym("observed", N), ca.MX.sym("locked", N)
    S, xi, residual = ca.MX.sym("S", N, 6), ca.MX.sym("xi", 6), ca.MX.sym("residual")
    readings = ca.MX.sym("readings", readings_size(problem))
    situation = situation_of(problem, {"posture": q, "observed": observed, "readings": readings}, S)
    outward = ca.MX(ca.DM.zeros(N))
    for limit in problem.row_limits:
        if not limit.yield_zone:
            continue
        rows = limit.rows(situation)
        rate = rows.matrix @ xi
        up = ca.logic_and(rows.above < limit.yield_zone, rate > 1e-6)
        down = ca.logic_and(rows.below < limit.yield_zone, rate < -1e-6)
        outward = ca.logic_or(outward, ca.logic_or(up, down))
    newly = ca.logic_and(ca.logic_and(outward, ca.logic_not(is_set(locked))), residual < TOLERANCE)
    return ca.Function(
        "newly_locked", [q, observed, readings, locked, S, xi, residual], [ca.densify(newly)]
    )
