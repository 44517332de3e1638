"""What the step minimises: cost, a little comfort, effort, smoothing and lost contact.

Cost and comfort are those over the look-ahead.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import casadi as ca
import numpy as np

from ergoqp.expressions.linear import is_set
from ergoqp.problem.problem import Problem
from ergoqp.step.model import StepModel
from ergoqp.step.rest import HUNTING

CAUTION_EPS: Final = 0.1
"""Keeps the Gauss-Newton curvature finite where the cost is least."""

_HESITATES: Final = 0.25
"""Moving gets dearer after so many times `Control.stall_after` without an improvement.

After as long again it is twice as dear.

A cost with steps, a person who follows late, and an object that always goes as fast would swing
about the edge of a step."""

_LOOKS: Final = (0.1, 1.0)
"""Seconds at full speed after which the improvement is looked up.

Every look is as dear as the cost itself. The near one sees what lies within a few centimetres:
without it objects come to rest on the way.
"""

_DENSE_LOOKS: Final = (0.3, 1.0)
"""For costs of large matrices, which do not turn within a few centimetres."""


def cost_function(model: StepModel) -> ca.Function:
    """``(posture, observed) -> (value, total, gradient)``: V, V with comfort, and its gradient.

    What is not seen, or cannot be moved, does not pull.

    Comfort: where the sheet is flat, the posture that the person would relax to leads the way.
    """
    problem, n = model.problem, len(model.problem.coordinates)
    q, observed = ca.MX.sym("q", n), ca.MX.sym("observed", n)
    value, slope = _value_and_gradient(problem, q)
    weights, away = _comfort(problem), q - model.stand_in
    total = value + ca.dot(weights, away**2) / 2
    moved = [problem.coordinates.index(joint) for joint in problem.joints]
    gradient = ca.MX(n, 1)
    gradient[moved] = ((slope + weights * away) * is_set(observed))[moved]
    names = (["posture", "observed"], ["value", "total", "gradient"])
    function = ca.Function("cost", [q, observed], [value, total, ca.densify(gradient)], *names)
    if _is_dense(problem):
        return function
    # As scalars the value and its gradient share what they have in common.
    inputs = [ca.SX.sym("q", n), ca.SX.sym("observed", n)]
    return ca.Function("cost", inputs, ca.cse(list(function.expand()(*inputs))), *names)


def _value_and_gradient(problem: Problem, q: ca.MX) -> tuple[ca.MX, ca.MX]:
    if _is_dense(problem):
        # What dense costs have.
        return problem.cost.value_and_gradient(q)  # pyright: ignore[reportAttributeAccessIssue]
    value = problem.cost.expression(q)
    return value, ca.gradient(value, q)


def _values(problem: Problem, states: ca.MX) -> ca.MX:
    """V (1, k) at several states (n, k)."""
    if _is_dense(problem) and hasattr(problem.cost, "values"):
        return problem.cost.values(states[problem.cost.coordinates.indices, :])  # pyright: ignore
    return ca.horzcat(*(problem.cost.expression(state) for state in ca.horzsplit(states)))


def _is_dense(problem: Problem) -> bool:
    """Whether the cost is made of large matrices, which stay matrices.

    See `ergoqp.costs.learned.LearnedCost`.
    """
    return getattr(problem.cost, "dense", False)


def _comfort(problem: Problem) -> ca.DM:
    moved = np.array([joint in problem.joints for joint in problem.coordinates], dtype=float)
    return ca.DM(problem.control.comfort * moved * problem.response.weight_vector)


def objective(
    model: StepModel, known: Mapping[str, ca.MX], S: ca.MX, E: ca.MX
) -> tuple[ca.MX, ca.MX]:
    """Gauss-Newton on V - V_min over the look-ahead, effort, smoothing and contact.

    The contact is the one that the person could not keep.

    Args:
        model: of the step.
        known: ``total``, ``gradient``, ``previous``, ``dt`` and ``stalled`` of this step.
        S: sensitivity (n, 6).
        E: contact motion that the posture cannot follow (k, 6).

    Returns:
        (H, g) of the QP.
    """
    problem, control, moved = model.problem, model.problem.control, model.moved
    waits = max(_HESITATES * control.stall_after, 1e-6)
    hesitates = ca.fmax(ca.fmin(known["stalled"], HUNTING * control.stall_after) / waits - 1, 0)
    effort = ca.DM(np.repeat([control.effort_linear, control.effort_angular], 3))
    smoothing = control.smoothing / known["dt"]
    ahead = control.look_ahead
    S = S[moved, :]
    slope = S.T @ known["gradient"][moved]
    excess = ca.fmax(known["total"] - problem.cost.minimum, 0) + CAUTION_EPS
    weighted = S * ca.repmat(
        ca.DM(ahead * np.sqrt(control.caution * problem.response.weight_vector[moved])), 1, 6
    )
    # Products of a matrix with its own transpose: symmetric to the last bit.
    H = (
        weighted.T @ weighted
        + control.contact * (E.T @ E)
        + (ahead**2 / 2 / excess) * (slope @ slope.T)
    )
    return (
        H + ca.diag(effort * (1 + hesitates**2 + smoothing)),
        ahead * slope - smoothing * effort * known["previous"],
    )


def gain_function(model: StepModel) -> ca.Function:
    """``(posture, total, xi, S) -> gain``: the best improvement along the answer [points].

    It is within one second at full speed.

    The cost itself is looked up on the way: its slope alone would promise a point for every band
    end within the noise.
    """
    problem = model.problem
    n, speed = len(problem.coordinates), problem.twist_limit.speed
    q, xi, S = ca.SX.sym("q", n), ca.SX.sym("xi", 6), ca.SX.sym("S", n, 6)
    free = [axis for axis in range(6) if speed[axis] > 0]
    relative = ca.mmax(ca.fabs(xi[free]) / ca.DM(speed[free]))
    # Joints that the object cannot move stay the same expression at every look, and what the cost
    # makes of them is shared.
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
    function = ca.Function("gain", inputs, [gain], *names)
    if _is_dense(problem):
        return function
    scalars = [ca.SX.sym("q", n), ca.SX.sym("V"), ca.SX.sym("xi", 6), ca.SX.sym("S", n, 6)]
    return ca.Function("gain", scalars, [ca.cse(function.expand()(*scalars))], *names)


def _reached(problem: Problem, q: ca.SX, way: ca.SX) -> ca.SX:
    """The state at the end of a straight way, or of its projection onto the state's surface."""
    if problem.surface is None:
        return q + way
    return q + problem.surface.retract(q, way, ca.SX(1), ca.DM([0.0]))
