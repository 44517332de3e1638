"""The objective of the step: cost, comfort, effort, smoothing and lost contact.

Cost and comfort are those over the look-ahead.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.expressions import dense, is_set
from ergoqp.limits.keep_out import WayOut
from ergoqp.problem.problem import Problem
from ergoqp.step.model import StepModel
from ergoqp.step.rest import HUNTING
from ergoqp.step.rows import STEADY_RETURN

_LEADS: Final = 10.0
"""Price of a speed other than that of the way out of a region [points/(m/s)^2]."""

CAUTION_EPS: Final = 0.1
"""Offset that keeps the Gauss-Newton curvature finite where the cost is minimal."""

_HESITATES: Final = 0.25
"""Effort grows after this many times `Control.stall_after` without an improvement.

After the same time again it is doubled. Without this, an object that always moves at the same speed
would oscillate about a step of the cost, because the person follows late.
"""

_LOOKS: Final = (0.1, 1.0)
"""Times at full speed for which the improvement is evaluated [s].

Each evaluation takes as long as the cost itself. The first one finds improvements within a few
centimetres. Without it, objects come to rest on the way.
"""

_DENSE_LOOKS: Final = (0.3, 1.0)
"""The same for costs with large matrices, which do not change within a few centimetres."""


_LOWER: Final = [max(i, j) + 6 * min(i, j) for j in range(6) for i in range(6)]
"""For each entry of a symmetric matrix (6, 6), column by column, the one below the diagonal."""


def cost_function(model: StepModel, with_slope: bool = False) -> ca.Function:
    """``(posture, observed) -> (value, total, gradient)``: V, V with comfort, and its gradient.

    The gradient is zero for joints that are not seen or that the object cannot move.

    Where the sheet is flat, the comfort posture sets the direction.

    Args:
        model: model of the step.
        with_slope: whether the function also gives ``slope``, the gradient of V itself. It is zero
            for joints that are not seen.
    """
    problem, n = model.problem, len(model.problem.coordinates)
    q, observed = ca.MX.sym("q", n), ca.MX.sym("observed", n)
    none = ca.MX(np.nan), ca.MX(ca.DM.zeros(n))
    value, slope = none if model.spare else _value_and_gradient(problem, q)
    weights, away = _comfort(problem), q - model.stand_in
    total = value + ca.dot(weights, away**2) / 2
    moved = [problem.coordinates.index(joint) for joint in problem.joints]
    gradient = ca.MX(n, 1)
    gradient[moved] = ((slope + weights * away) * is_set(observed))[moved]
    found = {"value": value, "total": total, "gradient": ca.densify(gradient)}
    found |= {"slope": ca.densify(slope * is_set(observed))} if with_slope else {}
    names = (["posture", "observed"], list(found))
    function = ca.Function("cost", [q, observed], list(found.values()), *names)
    if _is_dense(problem):
        return function
    # As scalars, the value and its gradient share common subexpressions.
    inputs = [ca.SX.sym("q", n), ca.SX.sym("observed", n)]
    return ca.Function("cost", inputs, ca.cse(list(function.expand()(*inputs))), *names)


def _value_and_gradient(problem: Problem, q: ca.MX) -> tuple[ca.MX, ca.MX]:
    if _is_dense(problem):
        # Dense costs have this member.
        return problem.cost.value_and_gradient(q)  # pyright: ignore[reportAttributeAccessIssue]
    value = problem.cost.expression(q)
    return value, ca.gradient(value, q)


def _values(problem: Problem, states: ca.MX) -> ca.MX:
    """Return V (1, k) at several states (n, k)."""
    if _is_dense(problem) and hasattr(problem.cost, "values"):
        return problem.cost.values(states[problem.cost.coordinates.indices, :])  # pyright: ignore
    return ca.horzcat(*(problem.cost.expression(state) for state in ca.horzsplit(states)))


def _is_dense(problem: Problem) -> bool:
    """Return whether the cost has large matrices, which are not expanded to scalars.

    See `ergoqp.costs.cost.LearnedCost`.
    """
    return getattr(problem.cost, "dense", False)


def _comfort(problem: Problem) -> ca.DM:
    moved = np.array([joint in problem.joints for joint in problem.coordinates], dtype=float)
    return ca.DM(problem.control.comfort * moved * problem.response.weight_vector)


def objective(model: StepModel, signals: Mapping[str, ca.MX]) -> dict[str, ca.MX]:
    """Return the objective of the QP: ``H`` (6, 6) and ``g`` (6,).

    Its terms are Gauss-Newton of V - V_min over the look-ahead, effort, smoothing, and the contact
    motion that the person cannot follow.

    Args:
        model: model of the step.
        signals: ``total``, ``gradient``, ``previous``, ``dt``, ``stalled``, ``readings``, ``S`` and
            ``E`` of this step.
    """
    problem, control, moved = model.problem, model.problem.control, model.moved
    waits = max(_HESITATES * control.stall_after, 1e-6)
    hesitates = ca.fmax(ca.fmin(signals["stalled"], HUNTING * control.stall_after) / waits - 1, 0)
    effort = ca.DM(np.repeat([control.effort_linear, control.effort_angular], 3))
    smoothing = control.smoothing / signals["dt"]
    ahead = control.look_ahead
    S, E = signals["S"][moved, :], signals["E"]
    slope = S.T @ signals["gradient"][moved]
    excess = ca.fmax(signals["total"] - problem.cost.minimum, 0) + CAUTION_EPS
    weighted = S * ca.repmat(
        ca.DM(ahead * np.sqrt(control.caution * problem.response.weight_vector[moved])), 1, 6
    )
    # Products of a matrix with its own transpose are symmetric to the last bit: where every
    # operation is written on its own, what stands above the diagonal need not be computed.
    H = (
        weighted.T @ weighted
        + control.contact * (E.T @ E)
        + (ahead**2 / 2 / excess) * (slope @ slope.T)
    )
    H = ca.reshape(H[_LOWER], 6, 6)
    H += ca.diag(effort * (1 + hesitates**2 + smoothing))
    g = ahead * slope - smoothing * effort * signals["previous"]
    way, out = model.way_out(signals["readings"]), problem.way_out
    if way is None or out is None:
        return {"H": H, "g": g}
    H, g = _led_function(problem, out)(H, g, way[:4], signals["previous"], signals["dt"])
    return {"H": H, "g": g}


def _led_function(problem: Problem, out: WayOut) -> ca.Function:
    """``(H, g, way (4,), previous, dt) -> (H, g)`` of an object that is led out of a region.

    See `ergoqp.limits.keep_out`. Only its turning is left to the cost, or the object would leave
    the straight way. Its speed is that of every return from outside. Where no way is needed,
    nothing changes.
    """
    acceleration = problem.twist_limit.linear_acceleration
    sizes = {"H": (6, 6), "g": (6, 1), "way": (4, 1), "previous": (6, 1), "dt": (1, 1)}
    sx = H, g, way, previous, dt = [ca.SX.sym(name, *size) for name, size in sizes.items()]
    # No faster than all axes together can within a period, to keep to the way. Where a row of the
    # region asks for more, each axis speeds up at its own limit; each step finds its way anew.
    along = ca.fmax(ca.dot(way[:3], previous[:3]), 0)
    pace = ca.fmin(ca.fmax(way[3] / out.recovery_time, STEADY_RETURN), along + acceleration * dt)
    led_H, led_g = ca.SX(H), ca.SX(g)
    led_H[:3, :], led_H[:, :3] = 0, 0
    led_H[:3, :3] = _LEADS * ca.SX.eye(3)
    led_g[:3] = -_LEADS * pace * way[:3]
    # What is replaced may hold no number, which has to show.
    led_g = ca.if_else(ca.sumsqr(H) + ca.sumsqr(g) < ca.inf, led_g, np.nan)
    led = way[3] > 0
    outputs = dense([ca.if_else(led, led_H, H), ca.if_else(led, led_g, g)])
    return ca.Function("led", sx, ca.cse(outputs))


def gain_function(model: StepModel) -> ca.Function:
    """``(posture, total, xi, S) -> gain``: the largest improvement along the answer [points].

    It is the improvement within one second at full speed.

    The cost itself is evaluated on the way. Its slope alone would promise a point for every band
    end within the noise.
    """
    problem = model.problem
    n, speed = len(problem.coordinates), problem.twist_limit.speed
    q, xi, S = ca.SX.sym("q", n), ca.SX.sym("xi", 6), ca.SX.sym("S", n, 6)
    free = [axis for axis in range(6) if speed[axis] > 0]
    relative = ca.mmax(ca.fabs(xi[free]) / ca.DM(speed[free]))
    # Joints that the object cannot move keep the same expression at every time, so the cost shares
    # their subexpressions.
    full = model.sparse(S) @ (xi / (relative + 1e-9))
    looks = _DENSE_LOOKS if _is_dense(problem) else _LOOKS
    places = [_reached(problem, q, seconds * full) for seconds in looks]
    look = ca.Function("look", [q, xi, S], [ca.densify(ca.horzcat(*places)), relative])

    inputs = [ca.MX.sym("q", n), ca.MX.sym("V"), ca.MX.sym("xi", 6), ca.MX.sym("S", n, 6)]
    seen, pace = look(inputs[0], inputs[2], inputs[3])
    away = seen - ca.repmat(model.stand_in, 1, len(looks))
    ahead = _values(problem, seen) + ca.mtimes(_comfort(problem).T, away**2) / 2
    gain = ca.if_else(pace > 1e-6, inputs[1] - ca.mmin(ahead), 0)
    names = (["posture", "total", "xi", "S"], ["gain"])
    if model.spare:
        return ca.Function("gain", inputs, [ca.MX(0)], *names)
    function = ca.Function("gain", inputs, [gain], *names)
    if _is_dense(problem):
        return function
    scalars = [ca.SX.sym("q", n), ca.SX.sym("V"), ca.SX.sym("xi", 6), ca.SX.sym("S", n, 6)]
    return ca.Function("gain", scalars, [ca.cse(function.expand()(*scalars))], *names)


def _reached(problem: Problem, q: ca.SX, way: ca.SX) -> ca.SX:
    """Return the end of a straight path, projected onto the surface if there is one."""
    if problem.surface is None:
        return q + way
    return q + problem.surface.retract(q, way, ca.SX(1), ca.DM([0.0]))
