"""All rows of a step at once, as vectors; what is curved goes through functions of scalars.

An interpreter runs a vector of forty numbers in the time of four scalars, and a curved row's few
dozen operations as scalars in the time of one vector.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import casadi as ca

from ergoqp.expressions.linear import dense
from ergoqp.limits import Limit, Situation
from ergoqp.limits.limit import Expression
from ergoqp.problem.problem import Problem
from ergoqp.step.counted import way_size
from ergoqp.step.objective import sensitivity_pattern, with_pattern
from ergoqp.step.readings import here, readings_size, situation_of

_HERE = ("posture", "observed", "readings", "pose")
_LANDED = ("posture", "observed", "readings", "landed", "way", "shift")


class StepRows:
    """The rows of all limits where things are, and their margins from where they land.

    Attributes:
        matrices: rate of each quantity per twist, (m, 6) for each limit.
        rates: largest rate allowed, (m,) for each limit; inf without one.
        now: margin (r,) of every row as it is.
    """

    def __init__(self, problem: Problem, known: Mapping[str, ca.MX], S: ca.MX) -> None:
        """Look at all limits once.

        Args:
            problem: the task.
            known: ``posture``, ``observed``, ``readings`` and ``pose`` of this step; for `margins`
                also ``landed``, ``way`` and ``shift``.
            S: sensitivity (n, 6), dense.
        """
        self._problem, self._known, self._S = problem, known, S
        situation = situation_of(problem, here(known), S)
        place = [*(known[name] for name in _HERE), S]
        self.matrices, self.rates, still = [], [], []
        for limit in problem.row_limits:
            if _linear(limit):
                rows = limit.rows(situation)
                matrix, rate, margins = rows.matrix, rows.rate, ca.fmin(rows.below, rows.above)
            else:
                matrix, rate, margins = _curved_here(problem, limit)(*place)
            self.matrices.append(matrix)
            self.rates.append(rate)
            still.append(margins)
        self.now = ca.vertcat(*still)

    def margins(self, ways: ca.MX) -> ca.MX:
        """Return each row's smallest margin (r,) on the straight ways to further displacements.

        See `Stop.ways`.
        """
        situations = situations_of(self._problem, self._known, self._S, ways)
        place = [*(self._known[name] for name in _LANDED), self._S]
        found = []
        for limit in self._problem.row_limits:
            if _linear(limit):
                found.append(smallest_margins(limit, situations, ways))
            else:
                found.append(_curved_ahead(self._problem, limit, ways.shape[1])(*place, ways))
        return ca.vertcat(*found)


def _linear(limit: Limit) -> bool:
    """Whether rows and margins may be asked for as matrices: see `ergoqp.limits.limit.Limit`."""
    return getattr(limit, "linear", False)


def _curved_here(problem: Problem, limit: Limit) -> ca.Function:
    """``(*_HERE, S) -> (matrix, rate, margins as they are)`` of one limit."""
    place, known, S = _scalars(problem, _HERE)
    situation = situation_of(problem, known, S)
    rows = limit.rows(situation)
    still = [rows.matrix, rows.rate, limit.margins(situation, ca.SX(6, 1))]
    return ca.Function("curved_here", place, ca.cse(dense(still)))


def _curved_ahead(problem: Problem, limit: Limit, count: int) -> ca.Function:
    """``(*_LANDED, S, ways) -> margins`` of one limit; ways are (6, count)."""
    ways = ca.SX.sym("ways", 6, count)
    place, known, S = _scalars(problem, _LANDED)
    margins = smallest_margins(limit, situations_of(problem, known, S, ways), ways)
    return ca.Function("curved_ahead", [*place, ways], ca.cse(dense([margins])))


def situations_of(
    problem: Problem, known: Mapping[str, Expression], S: Expression, ways: Expression
) -> tuple[Situation, ...]:
    """Return the situation for each of `Stop.ways`.

    A robot that holds on does so with what is under way, or with the twist.
    """
    law = problem.stop
    found = [
        situation_of(problem, known, S, held=held) for held in (True, False)[: 1 + bool(law.hold)]
    ]
    if law.average:
        found = [replace(situation, lead=ways[:, -2], most=ways[:, -1]) for situation in found]
    return tuple(found)


def smallest_margins(
    limit: Limit, situations: tuple[Situation, ...], ways: Expression
) -> Expression:
    """Return a limit's smallest margins (m,) on `Stop.ways`.

    The posture of the model is not held on to.
    """
    margins = None
    for column, situation in enumerate(situations if limit.hard else situations[:1]):
        on = limit.margins(situation, ways[:, column])
        margins = on if margins is None else ca.fmin(margins, on)
    return margins


def _scalars(
    problem: Problem, names: tuple[str, ...]
) -> tuple[list[ca.SX], dict[str, ca.SX], ca.SX]:
    """Symbols as inputs, the same by name, and S with its pattern."""
    n = len(problem.coordinates)
    sizes = {
        "readings": (readings_size(problem), 1),
        "pose": (4, 4),
        "landed": (4, 4),
        "way": (way_size(problem), 1),
    }
    known = {name: ca.SX.sym(name, *sizes.get(name, (n, 1))) for name in names}
    S = ca.SX.sym("S", n, 6)
    return [*known.values(), S], known, with_pattern(S, sensitivity_pattern(problem))
