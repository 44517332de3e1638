"""The data of the step's QP, with a given set of locked joints.

Every solver and every other formulation starts from them.
"""

from __future__ import annotations

from typing import Final

import casadi as ca
import numpy as np

from ergoqp.expressions.linear import dense, written_out
from ergoqp.limits import Rows
from ergoqp.limits.stop import Braking, on_surface
from ergoqp.problem.problem import Problem
from ergoqp.step.bounds import movable_rows, no_further, patience, row_bounds, unhurried
from ergoqp.step.counted import way_size
from ergoqp.step.objective import cost_function, objective, sensitivity_pattern, with_pattern
from ergoqp.step.qp import FREE
from ergoqp.step.readings import readings_function, readings_size, situation_of

QP_DATA: Final = ("H", "g", "A", "lower", "upper", "side", "cap", "low", "high")
"""What `ergoqp.step.qp.build_qp` takes, in its order."""


def qp_data(problem: Problem) -> ca.Function:
    """Return the QP of a control step as a function of what the step knows.

    It is for an object with nothing under way.

    That is so where every twist is sent as planned (`Control.average` 0) and no robot is declared.

    Returns:
        Function ``(posture (n,), observed (n,), pose (4, 4), previous (6,), dt, stalled, locked
        (n,), final) -> (*QP_DATA, S, E)``, by these names. `stalled`: for how long nothing has
        improved [s]; `locked` is 1 for joints that do not follow; `final` 1 makes joints close to
        their end rows like all others (the last locking pass), 0 lets them be locked instead. The
        rows of `A` are those of `movable_names`.
    """
    names = ("posture", "observed", "pose", "previous", "dt", "stalled", "locked", "final")
    given = {name: ca.MX.sym(name, *_size(problem, name)) for name in names}
    data, _ = pass_data(problem)
    _, value, gradient = cost_function(problem)(given["posture"], given["observed"])
    known = given | {
        "readings": readings_function(problem)(given["posture"]),
        "value": value,
        "gradient": gradient,
    }
    known |= {"landed": given["pose"], "way": ca.MX(ca.DM.zeros(way_size(problem)))}
    known |= {"away": away_function(problem)(*(known[name] for name in AWAY[:-1]), 1)}
    parts = data(*(known[data.name_in(i)] for i in range(data.n_in())))
    return ca.Function(
        "qp_data", list(given.values()), list(parts)[:-1], list(given), [*QP_DATA, "S", "E"]
    )


def _size(problem: Problem, name: str) -> tuple[int, int]:
    n = len(problem.coordinates)
    sizes = dict.fromkeys(
        ("posture", "observed", "gradient", "locked", "shift"), (n, 1)
    ) | dict.fromkeys(("pose", "landed"), (4, 4))
    sizes |= {"away": (2 * len(problem.row_names), 1)}
    sizes |= {
        "readings": (readings_size(problem), 1),
        "way": (way_size(problem), 1),
        "previous": (6, 1),
        "S": (n, 6),
    }
    return sizes.get(name, (1, 1))


def movable_names(problem: Problem) -> tuple[str, ...]:
    """Return the names of the rows in the step's QP: those that some twist can move."""
    return tuple(problem.row_names[i] for i in pass_data(problem)[1])


_PLACE: Final = ("posture", "observed", "readings", "landed", "way", "previous", "dt")

AWAY: Final = ("posture", "observed", "readings", "pose", "asks")
"""What `away_function` takes."""


def pass_data(problem: Problem) -> tuple[ca.Function, list[int]]:
    """Return the QP of one locking pass and the numbers of the rows in it.

    The function is ``(*_PLACE, away, value, gradient, stalled, locked, final) -> (*QP_DATA, S, E,
    shift)``; `away` is that of `away_function`. What is geometry is scalars; what is the same for
    every row is vectors, which an interpreter runs many times faster.
    """
    names = (*_PLACE, "away", "value", "gradient", "stalled", "locked", "final")
    mx = {name: ca.MX.sym(name, *_size(problem, name)) for name in names}
    S, E = written_out(problem.response.sensitivity(), mx["posture"], mx["locked"])
    terms, kept, follows = _terms(problem)
    shift = S @ mx["way"][:6]
    own, below, above, rate, reserve, twist, low, high, reach = terms(
        *(mx[name] for name in _PLACE), shift, S
    )
    away = mx["away"][[*kept, *(len(problem.row_names) + row for row in kept)]]
    brake = Braking(twist, low, high, reach, mx["dt"], problem.stop)
    rows = Rows(_gathered(S, own, follows), below, above, rate, reserve)
    bounds = row_bounds(
        problem.twist_limit, problem.row_limits, rows, kept, away, brake, mx["final"]
    )
    H, g = objective(problem, mx, S, E)
    data = [
        H,
        g,
        bounds.matrix,
        bounds.lower,
        bounds.upper,
        bounds.side,
        bounds.cap,
        low,
        high,
        S,
        E,
        shift,
    ]
    outputs = [ca.densify(part) for part in data]
    return ca.Function(
        "pass_data", list(mx.values()), outputs, list(mx), [*QP_DATA, "S", "E", "shift"]
    ), kept


def _terms(problem: Problem) -> tuple[ca.Function, list[int], list[int | None]]:
    """Return what the rows and braking are made of, and which rows some twist can move.

    Which of these are rows of S is returned last.

    The function is ``(*_PLACE, shift, S) -> (own, below, above, rate, reserve, twist, low, high,
    reach)``: of the movable rows, and of this period's braking. `own` (k, 6) are the rows that are
    not rows of S.
    """
    sx = {name: ca.SX.sym(name, *_size(problem, name)) for name in (*_PLACE, "shift", "S")}
    S, stop = with_pattern(sx["S"], sensitivity_pattern(problem)), problem.stop
    brake = stop.braking(sx["previous"], sx["dt"])
    situation = situation_of(problem, sx, S, brake)
    brake = on_surface(brake, situation)
    brake = unhurried(
        brake, patience(problem.row_limits, situation, sx["previous"], sx["dt"], stop)
    )
    kept = movable_rows(problem.twist_limit, problem.row_limits, situation)
    twist = problem.twist_limit
    rows = [no_further(twist, limit, limit.rows(situation), brake) for limit in problem.row_limits]
    numbered = [(each, i) for each in rows for i in range(each.matrix.shape[0])]
    follows = [
        i if each.matrix is situation.sensitivity else None
        for each, i in (numbered[k] for k in kept)
    ]
    own = [numbered[k] for k, of_S in zip(kept, follows, strict=True) if of_S is None]
    matrix = ca.vertcat(ca.SX(0, 6), *(each.matrix[i, :] for each, i in own))
    ends = [
        _stacked([getattr(each, part)[i] for each, i in (numbered[k] for k in kept)])
        for part in _VECTORS
    ]
    parts = [matrix, *ends, brake.twist, brake.low, brake.high, brake.reach]
    return ca.Function("terms", list(sx.values()), ca.cse(dense(parts))), kept, follows


def away_function(problem: Problem) -> ca.Function:
    """``AWAY -> away (2 r,)``: how far rows that ask to come back are beyond their ends.

    The upper ends come first, then the lower ones.

    It is 0 for rows that do not ask, and within the tolerance or the declared noise of the pose. It
    goes by where things are, not by where they land, so it does not depend on S. `asks` is 0 when
    rows of the posture have given up.
    """
    known = {name: ca.SX.sym(name, *_size(problem, name)) for name in AWAY}
    situation = situation_of(
        problem, known, with_pattern(ca.SX.ones(*_size(problem, "S")), sensitivity_pattern(problem))
    )
    above, below = [ca.SX(0, 1)], [ca.SX(0, 1)]
    for limit in problem.row_limits:
        rows = limit.rows(situation)
        allowed = limit.tolerance + (
            ca.fabs(rows.matrix) @ ca.DM(problem.robot.noise) if limit.hard else 0
        )
        returning = ca.DM(np.broadcast_to(limit.returns, rows.matrix.shape[0]).astype(float))
        asking = returning * (1 if limit.hard else known["asks"]) > 0.5
        for found, distance in ((above, rows.above), (below, rows.below)):
            distance = ca.fmin(distance, FREE)
            found.append(ca.if_else(ca.logic_and(asking, distance < -allowed), -distance, 0))
    away = ca.densify(ca.vertcat(*above, *below))
    return ca.Function("away", list(known.values()), [ca.cse(away)], list(known), ["away"])


_VECTORS: Final = ("below", "above", "rate", "reserve")


def _stacked(entries: list[ca.SX]) -> ca.SX:
    return ca.vertcat(ca.SX(0, 1), *entries)


def _gathered(S: ca.MX, own: ca.MX, follows: list[int | None]) -> ca.MX:
    """Return the QP's rows, those of S and the others in their places, by copying numbers once."""
    n, k = S.shape[0], own.shape[0]
    in_S, in_own = np.arange(6 * n).reshape(6, n).T, S.numel() + np.arange(6 * k).reshape(6, k).T
    others = iter(in_own)
    places = [in_S[row] if row is not None else next(others) for row in follows]
    everything = ca.vertcat(ca.vec(S), ca.vec(own)) if k else ca.vec(S)
    return (
        ca.reshape(everything[np.ravel(places, order="F").tolist()], len(follows), 6)
        if places
        else ca.MX(0, 6)
    )
