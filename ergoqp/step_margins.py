"""All rows of a step at once, as vectors; what is curved goes through functions of scalars.

An interpreter runs a vector of forty numbers in the time of four scalars, and a curved row's few dozen operations as scalars in
the time of one vector.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import casadi as ca

from ergoqp.limits import Limit, Situation
from ergoqp.linear import dense
from ergoqp.step_objective import sensitivity_pattern, with_pattern
from ergoqp.step_readings import here, readings_size, situation_of
from ergoqp.step_way import way_size

if TYPE_CHECKING:
    from ergoqp.problem import Problem

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
            known: ``posture``, ``observed``, ``readings`` and ``pose`` of this step; for `margins` also ``landed``, ``way``
                and ``shift``.
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

    def margins(self, displacement: ca.MX) -> ca.MX:
        """Return the smallest margin (r,) of every row on the straight way to a further displacement (6,) [m, rad]."""
        situation = situation_of(self._problem, self._known, self._S)
        place = [*(self._known[name] for name in _LANDED), self._S]
        found = []
        for limit in self._problem.row_limits:
            if _linear(limit):
                found.append(limit.margins(situation, displacement))  # pyright: ignore[reportArgumentType]
            else:
                found.append(_curved_ahead(self._problem, limit)(*place, displacement))
        return ca.vertcat(*found)


def _linear(limit: Limit) -> bool:
    """Whether a limit's rows and margins may be asked for as matrices: see `ergoqp.limits.limit.Limit`."""
    return getattr(limit, "linear", False)


def _curved_here(problem: Problem, limit: Limit) -> ca.Function:
    """``(*_HERE, S) -> (matrix, rate, margins as they are)`` of one limit."""
    place, situation = _scalars(problem, _HERE)
    rows = limit.rows(situation)
    still = [rows.matrix, rows.rate, limit.margins(situation, ca.SX(6, 1))]
    return ca.Function("curved_here", place, ca.cse(dense(still)))


def _curved_ahead(problem: Problem, limit: Limit) -> ca.Function:
    """``(*_LANDED, S, displacement) -> margins`` of one limit."""
    place, situation = _scalars(problem, _LANDED)
    displacement = ca.SX.sym("displacement", 6)
    return ca.Function("curved_ahead", [*place, displacement], ca.cse(dense([limit.margins(situation, displacement)])))


def _scalars(problem: Problem, names: tuple[str, ...]) -> tuple[list[ca.SX], Situation]:
    """Symbols of a place and of S, and the situation there."""
    n = len(problem.coordinates)
    sizes = {"readings": (readings_size(problem), 1), "pose": (4, 4), "landed": (4, 4), "way": (way_size(problem), 1)}
    known = {name: ca.SX.sym(name, *sizes.get(name, (n, 1))) for name in names}
    S = ca.SX.sym("S", n, 6)
    return [*known.values(), S], situation_of(problem, known, with_pattern(S, sensitivity_pattern(problem)))
