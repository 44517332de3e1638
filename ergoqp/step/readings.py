"""What the limits measure at a posture, and the situations in which they are asked.

They measure once per step, at the posture as it is.
"""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from ergoqp.limits import Limit, Situation
from ergoqp.limits.limit import Expression
from ergoqp.limits.stop import Braking
from ergoqp.problem.problem import Problem
from ergoqp.step.counted import split_way


def readings_function(problem: Problem) -> ca.Function:
    """Return ``posture -> readings (r,)``: those of all limits, one below the other."""
    posture = ca.MX.sym("posture", len(problem.coordinates))
    measured = [measure(posture) for _, measure in _measures(problem)]
    return ca.Function(
        "readings", [posture], [ca.densify(ca.vertcat(*measured)) if measured else ca.MX(0, 1)]
    )


def readings_size(problem: Problem) -> int:
    """Return how many numbers all limits measure."""
    return sum(measure.numel_out(0) for _, measure in _measures(problem))


def situation_of(
    problem: Problem,
    known: Mapping[str, Expression],
    S: Expression,
    brake: Braking | None = None,
    held: bool = False,
) -> Situation:
    """Return where things are, from the symbols of a function of the step.

    Args:
        problem: the task.
        known: symbols by name: ``posture``, ``observed``, ``readings``, and if there are
            ``previous``, and either ``pose`` for where things are, or ``landed``, ``way`` and
            ``shift`` for where they come to rest.
        S: sensitivity, only with the entries that can differ from zero.
        brake: of this period, for how far rows must look ahead; None: only the moment counts.
        held: whether the robot holds on once with what is under way, if that is declared.
    """
    still = ca.SX(6, 1)
    swing, change = (
        (still, still) if brake is None else (known["previous"] * brake.swing, brake.change)
    )
    readings, start = {}, 0
    for limit, measure in _measures(problem):
        size = measure.numel_out(0)
        readings[limit.names[0]] = known["readings"][start : start + size]
        start += size
    now = (known["posture"], known["observed"])
    if "landed" not in known:
        still, stays = type(S)(6, 1), type(S)(S.shape[0], 1)
        return Situation(
            *now,
            known.get("pose", ca.SX.eye(4)),
            S,
            swing,
            change,
            readings,
            problem.surface,
            still,
            stays,
        )
    way = split_way(problem, known["way"])
    lost, turn = (
        (way.lost_held, way.turn_held)
        if held
        else (way.lost, way.turn_held if brake is not None else way.turn)
    )
    place = (
        known["landed"],
        S,
        swing,
        change,
        readings,
        problem.surface,
        way.ahead,
        known["shift"],
    )
    most = brake.stop.most(brake.dt) if brake is not None and problem.average else None
    return Situation(*now, *place, lost, turn, way.stray, way.raised, most=most)


def here(known: Mapping[str, Expression]) -> dict[str, Expression]:
    """Return the symbols that say where things are, and not where they land."""
    return {name: value for name, value in known.items() if name not in ("landed", "way", "shift")}


def _measures(problem: Problem) -> list[tuple[Limit, ca.Function]]:
    found = [(limit, limit.measure()) for limit in problem.row_limits]
    return [(limit, measure) for limit, measure in found if measure is not None]
