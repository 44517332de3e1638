"""The objective of the step: cost, comfort, effort, smoothing and lost contact.

Cost and comfort are those over the look-ahead.
"""

from __future__ import annotations

from typing import Any, Final

import casadi as ca
import numpy as np

from ergoqp.expressions import call_by_name, is_set, scalars
from ergoqp.problem.problem import Problem
from ergoqp.step.model import Signals, StepModel
from ergoqp.step.rows import STEADY_RETURN

_LEADS: Final = 10.0
"""Price of a speed other than that of the way out of a region [points/(m/s)^2]."""

CAUTION_EPS: Final = 0.1
"""Offset that keeps the Gauss-Newton curvature finite where the cost is minimal."""

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
    mx = model.symbols(("posture", "observed"), ca.MX)
    q, observed = mx["posture"], mx["observed"]
    none = ca.MX(np.nan), ca.MX(ca.DM.zeros(n))
    value, slope = none if model.spare else _value_and_gradient(model, mx, q)
    weights, away = mx["task_comfort"], q - mx["task_stand_in"]
    total = value + ca.dot(weights, away**2) / 2
    moved = [problem.coordinates.index(joint) for joint in problem.joints]
    gradient = ca.MX(n, 1)
    gradient[moved] = ((slope + weights * away) * is_set(observed))[moved]
    found = {"value": value, "total": total, "gradient": ca.densify(gradient)}
    found |= {"slope": ca.densify(slope * is_set(observed))} if with_slope else {}
    function = mx.function("cost", found)
    # As scalars, the value and its gradient share common subexpressions.
    return function if _is_dense(problem) else scalars(function)


def _value_and_gradient(model: StepModel, mx: Signals, q: ca.MX) -> tuple[ca.MX, ca.MX]:
    if _is_dense(model.problem):
        cost: Any = model.problem.cost
        return cost.value_and_gradient(q)
    value = model.cost(mx, q)
    return value, ca.gradient(value, q)


def _values(model: StepModel, mx: Signals, states: ca.MX) -> ca.MX:
    """Return V (1, k) at several states (n, k)."""
    problem = model.problem
    if _is_dense(problem) and hasattr(problem.cost, "values"):
        return problem.cost.values(states[problem.cost.coordinates.indices, :])  # pyright: ignore
    return ca.horzcat(*(model.cost(mx, state) for state in ca.horzsplit(states)))


def _is_dense(problem: Problem) -> bool:
    """Return whether the cost has large matrices, which are not expanded to scalars.

    See `ergoqp.costs.cost.LearnedCost`.
    """
    return getattr(problem.cost, "dense", False)


def objective(model: StepModel, signals: Signals) -> dict[str, ca.MX]:
    """Return the objective of the QP: ``H`` (6, 6) and ``g`` (6,).

    Its terms are Gauss-Newton of V - V_min over the look-ahead, effort, smoothing, and the contact
    motion that the person cannot follow.

    Args:
        model: model of the step.
        signals: ``total``, ``gradient``, ``previous``, ``dt``, ``stalled``, ``readings``, ``S`` and
            ``E`` of this step.
    """
    task, control, moved = signals.of("task"), signals.of("control"), model.moved
    hesitates = ca.fmax(ca.fmin(signals["stalled"], task.hunts) / task.waits - 1, 0)
    effort = task.effort
    smoothing = control.smoothing / signals["dt"]
    ahead = control.look_ahead
    S, E = signals["S"][moved, :], signals["E"]
    slope = S.T @ signals["gradient"][moved]
    excess = ca.fmax(signals["total"] - task.minimum, 0) + CAUTION_EPS
    weighted = S * task.cautious[moved, :]
    # Products of a matrix with its own transpose are symmetric to the last bit: where every
    # operation is written on its own, what stands above the diagonal need not be computed.
    H = (
        weighted.T @ weighted
        + control.contact * (E.T @ E)
        + (task.second_order / excess) * (slope @ slope.T)
    )
    H = ca.reshape(H[_LOWER], 6, 6)
    H += ca.diag(effort * (1 + hesitates**2 + smoothing))
    g = ahead * slope - smoothing * effort * signals["previous"]
    way = model.way_out(signals["readings"])
    if way is None:
        return {"H": H, "g": g}
    led = call_by_name(_led_function(model), signals, H=H, g=g, way_out=way[:4])
    return {"H": led["led_H"], "g": led["led_g"]}


def _led_function(model: StepModel) -> ca.Function:
    """``(H, g, way_out (4,), previous, dt) -> (led_H, led_g)`` of an object led out of a region.

    See `ergoqp.limits.keep_out`. Only its turning is left to the cost, or the object would leave
    the straight way. Its speed is that of every return from outside. Where no way is needed,
    nothing changes.
    """
    sx = model.symbols(("H", "g", "way_out", "previous", "dt"))
    H, g, way, previous, dt = sx.values()
    acceleration, recovery_time = sx["task_linear_acceleration"], sx["task_way_out_time"]
    # No faster than all axes together can within a period, to keep to the way. Where a row of the
    # region asks for more, each axis speeds up at its own limit; each step finds its way anew.
    along = ca.fmax(ca.dot(way[:3], previous[:3]), 0)
    pace = ca.fmin(ca.fmax(way[3] / recovery_time, STEADY_RETURN), along + acceleration * dt)
    led_H, led_g = ca.SX(H), ca.SX(g)
    led_H[:3, :], led_H[:, :3] = 0, 0
    led_H[:3, :3] = _LEADS * ca.SX.eye(3)
    led_g[:3] = -_LEADS * pace * way[:3]
    # What is replaced may hold no number, which has to show.
    led_g = ca.if_else(ca.sumsqr(H) + ca.sumsqr(g) < ca.inf, led_g, np.nan)
    led = way[3] > 0
    found = {"led_H": ca.if_else(led, led_H, H), "led_g": ca.if_else(led, led_g, g)}
    return sx.function("led", found)


def gain_function(model: StepModel) -> ca.Function:
    """``(posture, total, xi, S) -> gain``: the largest improvement along the answer [points].

    It is the improvement within one second at full speed.

    The cost itself is evaluated on the way. Its slope alone would promise a point for every band
    end within the noise.
    """
    problem = model.problem
    sx = model.symbols(("posture", "xi", "S"))
    q, xi, S = sx["posture"], sx["xi"], sx["S"]
    free = np.flatnonzero(problem.twist_limit.speed > 0).tolist()
    relative = ca.mmax(ca.fabs(xi[free]) / sx["stop_speed"][free])
    # Joints that the object cannot move keep the same expression at every time, so the cost shares
    # their subexpressions.
    full = model.sparse(S) @ (xi / (relative + 1e-9))
    looks = _DENSE_LOOKS if _is_dense(problem) else _LOOKS
    surface = model.surface(sx)
    places = [_reached(surface, q, seconds * full) for seconds in looks]
    look = sx.function("look", {"seen": ca.horzcat(*places), "pace": relative})

    mx = model.symbols(("posture", "total", "xi", "S"), ca.MX)
    if model.spare:
        return mx.function("gain", {"gain": ca.MX(0)})
    seen, pace = call_by_name(look, mx).values()
    away = seen - ca.repmat(mx["task_stand_in"], 1, len(looks))
    ahead = _values(model, mx, seen) + ca.mtimes(mx["task_comfort"].T, away**2) / 2
    gain = ca.if_else(pace > 1e-6, mx["total"] - ca.mmin(ahead), 0)
    function = mx.function("gain", {"gain": gain})
    return function if _is_dense(problem) else scalars(function)


def _reached(surface: Any, q: ca.SX, way: ca.SX) -> ca.SX:
    """Return the end of a straight path, projected onto the surface if there is one."""
    return q + way if surface is None else q + surface.retract(q, way, ca.SX(1), ca.DM([0.0]))
