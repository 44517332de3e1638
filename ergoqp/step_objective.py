"""What the step minimises: the cost and a little comfort over the look-ahead, effort, smoothing, and lost contact."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import casadi as ca
import numpy as np

from ergoqp.linear import gram
from ergoqp.step_inputs import N, stand_in

if TYPE_CHECKING:
    from ergoqp.problem import Problem


_CAUTION_EPS: Final = 0.1

_LOOKS: Final = (0.1, 0.3, 1.0)
"""Seconds at full speed after which the improvement is looked up."""


def sensitivity_pattern(problem: Problem) -> ca.SX:
    """Return S at a symbolic posture: which entries are zero whatever the posture."""
    return problem.response.sensitivity()(ca.SX.sym("q", N), ca.SX.sym("locked", N))[0]


def with_pattern(dense: ca.SX, pattern: ca.SX) -> ca.SX:
    """Return `dense` with the entries that are zero in `pattern` dropped: rows of joints that never move vanish."""
    kept = ca.SX(*pattern.shape)
    for row in range(pattern.shape[0]):
        if not all(pattern[row, column].is_zero() for column in range(pattern.shape[1])):
            kept[row, :] = dense[row, :]
    return kept


def total_cost(problem: Problem, q: ca.MX) -> ca.MX:
    """V, and a little comfort: where the sheet is flat, the posture that the person would relax to leads the way."""
    away = q - ca.DM(stand_in(problem))
    moved = np.array([joint in problem.joints for joint in problem.coordinates], dtype=float)
    weights = problem.control.comfort * moved * problem.response.weight_vector
    return problem.cost.expression(q) + ca.dot(ca.DM(weights), away**2) / 2


def cost_function(problem: Problem) -> ca.Function:
    """``(posture, observed) -> (V, total, its gradient)``; what is not seen, or cannot be moved, does not pull."""
    q, observed = ca.MX.sym("q", N), ca.MX.sym("observed", N)
    total = total_cost(problem, q)
    moved = [problem.coordinates.index(joint) for joint in problem.joints]
    gradient = ca.MX(N, 1)
    gradient[moved] = (ca.gradient(total, q) * (observed > 0.5))[moved]
    # As scalars the value and its gradient share what they have in common.
    scalar = ca.Function("cost", [q, observed], [problem.cost.expression(q), total, ca.densify(gradient)]).expand()
    inputs = [ca.SX.sym("q", N), ca.SX.sym("observed", N)]
    return ca.Function("cost", inputs, ca.cse(list(scalar(*inputs))))


def objective(problem: Problem, sx: dict[str, ca.SX], S: ca.SX) -> tuple[ca.SX, ca.SX]:
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


def gain_function(problem: Problem) -> ca.Function:
    """``(posture, V, xi, S) -> best improvement within one second at full speed along the answer [points]``.

    The cost itself is looked up on the way: its slope alone would promise a point for every band end within the noise.
    """
    q, value, xi, S = ca.SX.sym("q", N), ca.SX.sym("V"), ca.SX.sym("xi", 6), ca.SX.sym("S", N, 6)
    speed = problem.twist_limit.speed
    free = [axis for axis in range(6) if speed[axis] > 0]
    relative = ca.mmax(ca.fabs(xi[free]) / ca.DM(speed[free]))
    # Joints that the object cannot move stay the same expression at every look, and what the cost makes of them is shared.
    full = with_pattern(S, sensitivity_pattern(problem)) @ (xi / (relative + 1e-9))
    symbol = ca.MX.sym("q", N)
    total = ca.Function("total", [symbol], [total_cost(problem, symbol)])
    ahead = [total(q + seconds * full) for seconds in _LOOKS]
    gain = value - ca.mmin(ca.vertcat(*ahead))
    return ca.Function("gain", [q, value, xi, S], ca.cse([ca.if_else(relative > 1e-6, gain, 0)]))
