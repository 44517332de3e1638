"""The data of the step's QP, with a given set of locked joints: what every solver and every other formulation starts from."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import casadi as ca

from ergoqp.step_objective import cost_function, objective, sensitivity_pattern, with_pattern
from ergoqp.step_readings import readings_function, readings_size, situation_of
from ergoqp.step_rows import braking, movable_rows, on_surface, patience, row_bounds, unhurried

if TYPE_CHECKING:
    from ergoqp.problem import Problem


QP_DATA: Final = ("H", "g", "A", "lower", "upper", "side", "cap", "low", "high")
"""What `ergoqp.qp.build_qp` takes, in its order."""


def qp_data(problem: Problem) -> ca.Function:
    """Return the QP of a control step as a function of what the step knows.

    Returns:
        Function ``(posture (n,), observed (n,), pose (4, 4), previous (6,), dt, locked (n,), final) -> (*QP_DATA, S, E)``, by
        these names. `locked` is 1 for joints that do not follow; `final` 1 makes joints close to their end rows like all others
        (the last locking pass), 0 lets them be locked instead. The rows of `A` are those of `movable_names`.
    """
    n = len(problem.coordinates)
    sizes = {"posture": (n, 1), "observed": (n, 1), "pose": (4, 4), "previous": (6, 1), "dt": (1, 1), "locked": (n, 1)}
    sizes |= {"final": (1, 1)}
    given = {name: ca.MX.sym(name, *size) for name, size in sizes.items()}
    data, _ = pass_data(problem)
    _, value, gradient = cost_function(problem)(given["posture"], given["observed"])
    known = given | {"readings": readings_function(problem)(given["posture"]), "value": value, "gradient": gradient}
    parts = data(*(known[data.name_in(i)] for i in range(data.n_in())))
    return ca.Function("qp_data", list(given.values()), list(parts), list(given), [*QP_DATA, "S", "E"])


def movable_names(problem: Problem) -> tuple[str, ...]:
    """Return the names of the rows in the step's QP: those that some twist can move."""
    return tuple(problem.row_names[i] for i in pass_data(problem)[1])


def pass_data(problem: Problem) -> tuple[ca.Function, list[int]]:
    """Return the QP of one locking pass and the rows in it.

    The function is ``(posture, observed, readings, pose, previous, dt, value, gradient, locked, final) -> (*QP_DATA, S, E)``.
    """
    names = ("posture", "observed", "readings", "pose", "previous", "dt", "value", "gradient", "locked", "final", "S", "E")
    unmet, N = problem.response.sensitivity().size_out(1), len(problem.coordinates)
    measured = (readings_size(problem), 1)
    sizes = ((N, 1), (N, 1), measured, (4, 4), (6, 1), (1, 1), (1, 1), (N, 1), (N, 1), (1, 1), (N, 6), unmet)
    sx = {name: ca.SX.sym(name, *size) for name, size in zip(names, sizes, strict=True)}
    S = with_pattern(sx["S"], sensitivity_pattern(problem))
    brake = braking(problem.twist_limit, sx["previous"], sx["dt"])
    situation = situation_of(problem, sx, S, brake)
    brake = on_surface(brake, situation)
    brake = unhurried(brake, patience(problem.row_limits, situation, sx["previous"], sx["dt"]))
    movable = movable_rows(problem.twist_limit, problem.row_limits, situation)
    bounds = row_bounds(problem.twist_limit, problem.row_limits, situation, brake, sx["final"], movable)
    H, g = objective(problem, sx, S)
    parts = [H, g, bounds.matrix, bounds.lower, bounds.upper, bounds.side, bounds.cap, brake.low, brake.high]
    prepare = ca.Function("prepare", list(sx.values()), ca.cse([ca.densify(part) for part in parts]))

    mx = {name: ca.MX.sym(name, *size) for name, size in zip(names[:-2], sizes[:-2], strict=True)}
    S_value, E_value = problem.response.sensitivity()(mx["posture"], mx["locked"])
    data = prepare(*mx.values(), S_value, E_value)
    outputs = [*data, ca.densify(S_value), ca.densify(E_value)]
    return ca.Function("pass_data", list(mx.values()), outputs, list(mx), [*QP_DATA, "S", "E"]), movable
